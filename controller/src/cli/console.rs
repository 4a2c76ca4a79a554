//! Lines for a person: see [`controller::console`], which never waits for a terminal that nobody reads.

pub(super) use controller::console::notice as tell;
pub(super) use controller::console::result as say;

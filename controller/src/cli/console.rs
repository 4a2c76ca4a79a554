//! Lines for a person: see [`controller::operator::console`], which never waits for a terminal that nobody reads.

pub(super) use controller::operator::console::notice as tell;
pub(super) use controller::operator::console::result as say;

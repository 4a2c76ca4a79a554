//! Free parameters of a rig: which, how they are scaled, what is known of them beforehand.
//!
//! | file | subject |
//! | --- | --- |
//! | `path` | a number of a rig by its dotted key |
//! | `parameter` | transform, prior, bounds of one number |
//! | `set` | several of them: from coordinates to rigs and back |
//! | `nominal` | the parameters of the paper's physics, with priors from what such parts scatter by |

mod nominal;
mod parameter;
mod path;
mod set;

pub use nominal::{Scatter, nominal};
pub use parameter::{End, Knowledge, Parameter, SearchRange, Transform};
pub use path::{set_value, value};
pub use set::ParameterSet;

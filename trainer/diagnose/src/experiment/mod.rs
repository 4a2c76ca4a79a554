//! The next experiment: what to record so that rivals part.
//!
//! | file | subject |
//! | --- | --- |
//! | `menu` | programmes of commands to choose from |
//! | `separation` | how far apart rivals would be |
//! | `backwards` | programmes in which a vent passes backwards |
//! | `limits` | pressures that none of them may leave |
//! | `plan` | programmes chosen, joined, and checked to be safe |

mod backwards;
mod limits;
mod menu;
mod plan;
mod separation;

pub(crate) use menu::drives;
pub use menu::{Programme, Usage, can_be_shut_in, menu};
pub use plan::{Plan, plan};
pub use separation::{PairSums, Predicted};

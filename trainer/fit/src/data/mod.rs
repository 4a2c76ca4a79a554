//! Recordings as the fits see them.
//!
//! | file | subject |
//! | --- | --- |
//! | `record` | the columns a rig needs, as numbers |
//! | `bridged` | straight lines in place of numbers that are left out |
//! | `layout` | where a row of a channel lies in one long vector of readings |
//! | `noise` | what the readings scatter by when nothing happens |
//! | [`quality`] | what is wrong with recordings, in plain words |
//! | `repeated` | recordings that are given more than once |
//! | `ripple` | narrow lines: the pump's ripple, folded down by sampling |
//! | `split` | which rows are fitted, which choose between models, which are kept back |
//! | `steps` | rows in which a command steps, and those near to one |
//! | [`switched`] | recordings cut where a pump is switched or starts |

mod bridged;
mod layout;
mod noise;
pub mod quality;
mod record;
mod records;
mod repeated;
mod ripple;
mod split;
mod steps;
pub mod switched;

pub use layout::Layout;
pub use noise::{Noise, deviation, noise, rms_kpa};
pub use record::{Earlier, Record};
pub use records::Records;
pub use repeated::each_once;
pub use ripple::{Line, folded_hz, lines};
pub use split::{Role, Split, Stretch};

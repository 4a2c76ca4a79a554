//! The operator's side: the socket, what is asked and answered over it, and what a person is told.
//!
//! | module | subject |
//! | --- | --- |
//! | [`socket`] | many clients at once |
//! | `bound_socket` | the socket as a file |
//! | [`operator_protocol`] | what is said over it |
//! | [`running`] | names of what the daemon runs with |
//! | [`peer`] | who asks |
//! | [`mailbox`] | between the tick and everybody else |
//! | `stops` | what has stopped the rig, counted |
//! | [`latched_conditions`] | what waits for a person |
//! | [`desk`] | requests examined and carried out |
//! | [`notice`] | what the tick has to tell, without text |
//! | [`fault_text`] | each condition in words |
//! | [`console`] | lines for a person |
//! | [`reference_limits`] | how near a reference may come to the safety envelope |

pub(crate) mod bound_socket;
pub mod console;
pub mod desk;
pub mod fault_text;
pub mod latched_conditions;
pub mod mailbox;
pub mod notice;
pub mod operator_protocol;
pub mod peer;
pub mod reference_limits;
pub mod running;
pub mod socket;
mod stops;

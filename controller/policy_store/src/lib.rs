//! The watched directory of policies, beside the tick.
//!
//! ```text
//!  folder thread ◀─ jobs, outcomes ─▶ examiner thread        audit thread ─▶ file
//!       │                                                         ▲
//!       └──▶ board ◀── rounds thread, operators ◀── tick          └── whoever notes something
//! ```
//!
//! The folder's, the examiner's and the audit's threads read and write files, and may hang with a disk that does not answer.
//! All others touch no file, and take no lock that is held while a file is waited for.
//!
//! | module | subject |
//! | --- | --- |
//! | [`watch`] | which files of the directory are whole: renamed into place, or unchanged for a while |
//! | [`entry`] | what is known of a policy: state, provenance, figures, why it was refused |
//! | [`board`] | all entries, by name |
//! | [`flying`] | the rig as the tick describes it, the orders to it and its answers |
//! | [`audit`] | who did what to which policy, line by line |
//! | [`examination`] | the thread that examines what is published, and what controls on each model |
//! | [`refusal_file`] | the file beside a policy that says why it was refused |
//! | [`store`] | settings of the store, and its threads |
//! | `chronicle`, `following`, `folder` | where changes are told; what the tick says is taken in; the directory is read |
//! | [`desk`] | what operators ask: list, swap, rollback |
//! | [`orders`] | the way into the tick, and of each order into the recording |
//!
//! Nothing of it runs in the tick; to the tick it is two queues ([`mod@handover::channel`]).

use std::sync::{Mutex, MutexGuard, PoisonError};

pub mod audit;
pub mod board;
mod chronicle;
pub mod desk;
pub mod entry;
pub mod examination;
pub mod flying;
mod folder;
mod following;
pub mod orders;
pub mod refusal_file;
pub mod store;
pub mod watch;

pub use desk::PolicyDesk;
pub use entry::{Entry, EntryState};
pub use examination::Examination;
pub use orders::KeepOrder;
pub use store::{ActivePolicy, Adoption, PolicyStore, StoreSettings, Voices, WhenBehind};

/// A lock that a panic elsewhere does not take away.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

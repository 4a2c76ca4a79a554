//! The watched directory of policies, beside the tick.
//!
//! | module | subject |
//! | --- | --- |
//! | [`watch`] | which files of the directory are whole: renamed into place, or unchanged for a while |
//! | [`entry`] | what is known of a policy: state, provenance, figures, why it was refused |
//! | [`board`] | all entries, and what flies |
//! | [`audit`] | who did what to which policy, line by line |
//! | [`examination`] | the thread that examines what is published, and what controls on each model |
//! | [`refusal_file`] | the file beside a policy that says why it was refused |
//! | [`store`] | the thread that reads the directory and follows what becomes of each policy in the tick |
//! | [`desk`] | what operators ask: list, swap, rollback |
//! | [`orders`] | the way into the tick, and of each order into the recording |
//!
//! Nothing of it runs in the tick; to the tick it is two queues ([`mod@handover::channel`]).

pub mod audit;
pub mod board;
pub mod desk;
pub mod entry;
pub mod examination;
pub mod orders;
pub mod refusal_file;
pub mod store;
pub mod watch;

pub use desk::PolicyDesk;
pub use entry::{Entry, EntryState};
pub use examination::Examination;
pub use orders::KeepOrder;
pub use store::{ActivePolicy, Adoption, PolicyStore, StoreSettings, Voices, WhenBehind};

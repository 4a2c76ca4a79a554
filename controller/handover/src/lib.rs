//! From one policy to the next while the rig is controlled, without a bump and with a way back.
//!
//! ```text
//!            250 ticks and a record     4 levels, each passed    the incumbent measured anew     500 ticks in full
//!  candidate ── SHADOW ──────▶ RAMP 5 … 40 % ──────▶ RECHECK ──────▶ RAMP 70, 100 % ──▶ PROBATION ──────▶ active
//!                 ▲               ▲  │                                    │                  │
//!                 │               └──┼──── RETRIAL ◀── erred more, ───────┤                  │
//!                 │                  │                 a few times        │                  │
//!                 │                  └──── refused: the incumbent alone decides from this very tick
//!                 └──── something went wrong that the candidate had no part in
//! ```
//!
//! | module | subject |
//! | --- | --- |
//! | [`conditions`] | what kind of tick it is: rest, motion, a jump; errors are only compared in like conditions |
//! | [`record`] | the incumbent's own errors, by condition |
//! | [`sequential_test`] | Wald's test: as good as the incumbent, or worse than may be? |
//! | [`stage_now`], [`stages`] | shadow, ramp, recheck, retrial, probation: how much authority a candidate has |
//! | [`conduct`] | interventions, far-off pressures, hunting, and whether the candidate had a part in them |
//! | [`loss`] | why a candidate loses its authority |
//! | [`arbiter`] | incumbent and candidate side by side; who decides, and what came of it for the policies |
//! | `share`, `retrials` | whether a candidate's part in the commands can explain the errors; how often it is tried again |
//! | `seat`, `blend`, `remainder` | a policy in its law; two decisions in one; what is left of a bump decays |
//! | [`exploration`] | bounded noise on the active policy's answer |
//! | [`permit`] | until when a request counts that takes work before it is handed over |
//! | [`succession`] | who controls, who is on its way and who controlled before; what an order makes of them |
//! | [`crossing`] | ways between the tick and other threads on which the tick waits for nobody |
//! | [`mod@channel`] | queues between the tick and the thread that publishes: policies in, retired ones out |
//!
//! All of it but the making of queues and policies runs in the tick: no allocation, no waiting, bounded time. Every policy
//! that goes is handed back through a queue, to be dropped elsewhere.

pub mod arbiter;
mod blend;
pub mod channel;
pub mod conditions;
pub mod conduct;
pub mod crossing;
pub mod exploration;
pub mod loss;
pub mod permit;
pub mod record;
mod remainder;
mod retrials;
mod seat;
pub mod sequential_test;
mod share;
pub mod stage_now;
pub mod stages;
pub mod succession;

pub use arbiter::{Arbiter, ArbitratedCommand, Trust};
pub use channel::{Candidate, Command, Haste, PolicyEvent, PolicyTag, Snapshot, StoreEnd, TickEnd, Told, channel};
pub use exploration::{ExplorationRules, ExplorationShown, Noise, StdOrigin};
pub use loss::Loss;
pub use permit::{NoLongerWanted, Permit};
pub use seat::PolicyAnswer;
pub use stage_now::StageNow;
pub use succession::{Succession, WayBack};

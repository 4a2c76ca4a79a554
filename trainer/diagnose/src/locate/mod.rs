//! Where the mismatch lives: which balance or reading, in which operating region, when, and how fast.
//!
//! | file | subject |
//! | --- | --- |
//! | `smoother` | a Kalman smoother for what is missing |
//! | `missing` | missing flows along the recordings; suspects weighed |
//! | `region` | the operating region that holds most of it, in words |

mod missing;
pub mod region;
pub mod smoother;

pub use missing::{Missing, MissingFlow, Suspect, Suspicion, capacity_kg_per_kpa, reconstruct};

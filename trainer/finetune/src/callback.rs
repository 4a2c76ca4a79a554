//! Where a run stands, for whoever looks on, and how it ends.

use serde::Serialize;

use crate::transitions::Tally;

/// Where transitions come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// Recordings alone: the run ends with them.
    Recordings,
    /// A daemon that goes on writing: the run waits.
    Daemon,
}

/// End of a sitting.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// All steps are done.
    Finished,
    /// The recordings are used up.
    UsedUp,
    /// The callback asked for it.
    Stopped,
}

/// Progress of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Progress {
    /// Transitions done.
    pub steps: u64,
    /// Transitions planned.
    pub steps_planned: u64,
    /// Updates a second in this sitting; 0 until it is known.
    pub updates_per_s: f64,
    /// RMSE of the last 20 s under control, in kPa; nothing where too few of them are known.
    pub rmse_kpa: Option<[f64; 2]>,
    /// Words on what is being done.
    pub doing: &'static str,
}

/// Whoever looks on.
pub trait FinetuneCallback {
    /// Callback after each transition and while waiting.
    fn progress(&mut self, progress: &Progress);
    /// Tells whether to stop; a checkpoint is written then.
    fn stop(&self) -> bool;
    /// Callback once everything so far is on the disk.
    fn is_kept(&mut self);
    /// Callback with what a person should know, in one line.
    fn say(&mut self, text: &str);
}

/// Figures of a run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Transitions done.
    pub steps: u64,
    /// Transitions planned.
    pub steps_planned: u64,
    /// Updates made.
    pub updates: u64,
    /// λ_T as it stands.
    pub lambda_temporal: f64,
    /// Policies published.
    pub published: u64,
    /// The last of them.
    pub last_published: Option<String>,
    /// RMSE of the last 20 s under control, in kPa, the first 5 s after an arming or a jump of the goal left out; nothing
    /// where less than 1 s of them is known.
    pub rmse_kpa: Option<[f64; 2]>,
    /// Time that this error is taken over, in s: 20, or less soon after an arming or a jump of the goal; 0 where there is
    /// none.
    pub rmse_over_s: f64,
    /// Seconds of work.
    pub wall_s: f64,
    /// Counts of what in the recordings was of use.
    pub tally: Tally,
    /// Times that a law had to be joined late.
    pub joined: u64,
}

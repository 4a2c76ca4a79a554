//! Requests that the tick is asked for, and what they leave to be freed elsewhere.

use handover::ExplorationRules;
use proto::reference::Reference;

use crate::experiment::open_loop_playback::OpenLoopPlayback;

/// Order of an operator to the tick.
#[derive(Debug)]
pub enum Request {
    /// Control the pressures.
    Arm,
    /// Open the vents.
    Disarm,
    /// A person has looked at what was wrong; what still holds goes on waiting.
    Acknowledge,
    /// Follow another reference.
    Reference(Box<Reference>),
    /// Play an experiment, and go on afterwards.
    Experiment(Box<OpenLoopPlayback>),
    /// Explore around the active policy, or no more.
    Explore(Option<ExplorationRules>),
}

/// Memory that the tick must not free.
#[derive(Debug)]
pub enum Spent {
    /// A reference that is no longer followed, or never was.
    Reference(Box<Reference>),
    /// An experiment that was not begun.
    Experiment(Box<OpenLoopPlayback>),
}

impl Request {
    /// Tells whether it falls with a venting that came after it was asked for. An experiment arms by itself once the rig is at rest
    /// again; all others move nothing by themselves on a rig that was vented.
    pub(super) fn falls_with_venting(&self) -> bool {
        matches!(self, Request::Experiment(_))
    }

    /// Memory that a request which is not carried out leaves to be freed.
    pub(super) fn spent(self) -> Option<Spent> {
        match self {
            Request::Reference(reference) => Some(Spent::Reference(reference)),
            Request::Experiment(playback) => Some(Spent::Experiment(playback)),
            Request::Arm | Request::Disarm | Request::Acknowledge | Request::Explore(_) => None,
        }
    }
}

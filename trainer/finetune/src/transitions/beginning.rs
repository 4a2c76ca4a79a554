//! Beginning of a recording: a run anew, the next part of the run before it, or a later part whose run nobody has read.
//!
//! A daemon that goes on writes its run in parts, and each of them begins with the files that took over in the parts before. So a loop can
//! be taken up in the middle of a run: with the last of these files, from the first tick on in which nothing controls, since law and
//! reference begin anew when the rig is armed.

use law::{AfterEnd, RepetitionLearning};
use model::observation::ObservationLayout;
use proto::recording::{McapFollower, attached};

use crate::FinetuneError;
use crate::files_inside::{ChosenReference, parsed_reference, rig};
use crate::loop_rebuild::LoopRebuild;

/// A recording as a part of its run.
#[derive(Debug)]
pub(super) struct Part {
    file: String,
    /// Number from 1.
    number: u32,
    /// Name that the part before had when this one was begun.
    previous: Option<String>,
}

/// A loop at the beginning of a recording.
pub(super) struct Begun {
    /// The loop, where the files inside say it.
    pub(super) rebuild: Option<LoopRebuild>,
    /// References and models inside that have taken over.
    pub(super) known: [usize; 2],
    /// Remark on the parts that are missing.
    pub(super) note: Option<String>,
}

impl Part {
    /// The part that a recording of this name is.
    pub(super) fn of(file: String, recording: &McapFollower) -> Self {
        let number = recording.metadata("part").and_then(|part| part.parse().ok()).unwrap_or(1);
        Part { file, number, previous: recording.metadata("previous_file").map(str::to_owned) }
    }

    /// Tells whether it is a later part of a run.
    pub(super) fn is_later(&self) -> bool {
        self.number > 1
    }

    /// Tells whether it names another one as the part before it.
    pub(super) fn names(&self, before: &Part) -> bool {
        self.number == before.number.saturating_add(1) && self.previous.as_ref() == Some(&before.file)
    }

    /// Begins the loop of this recording, of which no part before it was read.
    ///
    /// # Errors
    /// It lacks its model or reference, or holds one that cannot be used.
    pub(super) fn begin(&self, recording: &McapFollower, layout: ObservationLayout) -> Result<Begun, FinetuneError> {
        let lost = [attached::REFERENCE, attached::MODEL].into_iter().find(|name| recording.has_lost(name));
        let note = self.is_later().then(|| self.missing(lost));
        if self.is_later() && lost.is_some() {
            return Ok(Begun { rebuild: None, known: [0; 2], note });
        }
        let in_force = |name| match self.number {
            1 => recording.attachments(name).next().map(|file| (file, 1)),
            _ => recording.first_attachments(name).zip(1..).last(),
        };
        let lacks = |name| FinetuneError::Lacks { file: self.file.clone(), name };
        let (model, models) = in_force(attached::MODEL).ok_or_else(|| lacks(attached::MODEL))?;
        let (reference, references) = in_force(attached::REFERENCE).ok_or_else(|| lacks(attached::REFERENCE))?;
        let (model, reference) = (rig(&self.file, model)?, parsed_reference(&self.file, reference)?);
        let mut rebuild = LoopRebuild::new(model, reference, layout)?;
        // Recordings of daemons that knew of no repetition hold no such choice.
        let chosen = recording.attachments(attached::EFFECTIVE).next().map(ChosenReference::parse).unwrap_or_default();
        let learns = if chosen.learn { RepetitionLearning::On } else { RepetitionLearning::Off };
        rebuild.repeat(if chosen.repeat { AfterEnd::Repeat } else { AfterEnd::Hold }, learns)?;
        Ok(Begun { rebuild: Some(rebuild), known: [references, models], note })
    }

    /// Remark on the part before it, which is missing, and on a file inside that is lost.
    fn missing(&self, lost: Option<&'static str>) -> String {
        let Part { file, number, previous } = self;
        let before = previous.as_ref().map_or_else(String::new, |name| format!(", {name},"));
        let then = match lost {
            None => {
                "its ticks are left out until the rig stands by, and learned from when it is armed again".to_owned()
            }
            Some(name) => format!("a {name} inside is damaged: its ticks are left out until the next run begins"),
        };
        format!(
            "{file}: part {number} of a run, and the part before it{before} is not in the folder; {then}; put that part beside it to learn from all of it"
        )
    }
}

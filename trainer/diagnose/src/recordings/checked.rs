//! Recordings, checked, and in pieces where no run goes through them in one.

use fit::data::quality::Quality;
use fit::data::switched::{BehindChanges, Change};
use fit::data::{Records, each_once, noise};
use model::rig::Rig;
use proto::recording::Recording;

use crate::error::DiagnoseError;
use crate::event::{self, Event};
use crate::recordings::closed_volumes;
use crate::recordings::long_gaps;
use crate::recordings::pieces::{pieces, taken};
use crate::recordings::unmovable_pressure::refuse_what_nothing_moves;

/// Recordings that can be used.
pub(crate) struct Recorded {
    pub(crate) records: Records,
    /// By reading: 1 where it counts.
    pub(crate) usable: Vec<f64>,
    /// True where a pump was switched in them, as experiments do.
    pub(crate) switched: bool,
    /// Notes on what is doubtful about them, and on how they are run.
    pub(crate) notes: Vec<String>,
}

impl Recorded {
    /// Checks recordings of `rig`.
    ///
    /// # Errors
    /// They cannot be used, and why.
    pub(crate) fn of(rig: &Rig, recordings: &[Recording]) -> Result<Self, DiagnoseError> {
        let (recordings, copies) = each_once(recordings.to_vec());
        let records = Records::new(rig, &recordings)?;
        let noise = noise(&records);
        let quality = Quality::of(rig, &records, &noise)?;
        if let Some(refusal) = quality.refusal() {
            return Err(fit::FitError::Unusable(refusal).into());
        }
        let (quality, records) = quality.sound(records);
        refuse_what_nothing_moves(rig, &records, &noise)?;
        let mut notes: Vec<String> = recordings.iter().flat_map(|r| r.notes().to_vec()).collect();
        notes.extend(copies);
        notes.extend(quality.doubts().map(ToString::to_string));
        // Quality and noise were asked of whole files; what follows runs through no long gap.
        let (records, usable) = match long_gaps::apart(&records) {
            Some((parts, places)) => (parts, taken(&quality.usable, &places)),
            None => (records, quality.usable.clone()),
        };
        // What was checked whole is run in pieces where a meter's error would add up.
        if let Some(source) = closed_volumes::accumulates(rig) {
            notes.push(format!(
                "{source} fills a closed volume, in which an error of its meter adds up: simulations start anew every 4 s"
            ));
            let (pieces, places) = pieces(&records);
            let mut usable = taken(&usable, &places);
            closed_volumes::without_starts(&pieces, &mut usable);
            return Ok(Recorded { records: pieces, usable, switched: false, notes });
        }
        let Some(behind) = BehindChanges::of(rig, &records) else {
            return Ok(Recorded { records, usable, switched: false, notes });
        };
        notes.push(behind.change.note().to_owned());
        let usable = taken(&usable, &behind.places);
        Ok(Recorded { records: behind.records, usable, switched: behind.change == Change::Switched, notes })
    }
}

/// The recordings without the span in which something happened, and which of their readings count.
pub(crate) fn without(event: &Event, rig: &Rig, records: &Records, usable: &[f64]) -> (Records, Vec<f64>) {
    let (rest, places) = event::without(records, event);
    let mut usable = taken(usable, &places);
    if closed_volumes::accumulates(rig).is_some() {
        closed_volumes::without_starts(&rest, &mut usable);
    }
    (rest, usable)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::made::{made, moved};

    #[test]
    fn a_copy_of_a_recording_is_told_and_counts_once() {
        let (rig, truth) = moved(&[]);
        let mut recordings = made(&truth, 2, 3);
        recordings.push(recordings[0].clone());
        let recorded = Recorded::of(&rig, &recordings).unwrap();
        assert_eq!(recorded.records.records().len(), 2);
        assert!(recorded.notes.iter().any(|note| note.contains("counts once")), "{:?}", recorded.notes);
    }
}

//! The worst pressures of a rig while it was being adapted to, and who was in control there.
//!
//! Every tick counts from the first to the last of a sitting: flights along the reference, experiments, and what lies
//! between them. Recordings of runs and of experiments are both read, since an experiment is in one or in both.

use std::path::Path;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use proto::recording::TickRecord;
use serde::{Deserialize, Serialize};

use crate::AdaptError;
use crate::recorded::{self, Holding, RUN};

/// Between the times of two clocks that mean the same moment: a file system keeps whole seconds at the worst.
const CLOCKS_DIFFER: Duration = Duration::from_secs(2);

/// The moment at which a sitting began.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Since {
    /// Session and tick.
    pub at: (u32, u32),
    /// Time of day, in s since 1970.
    pub unix_s: u64,
}

impl Since {
    /// Now, at this session and tick.
    pub fn now(at: (u32, u32)) -> Self {
        let unix_s = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
        Since { at, unix_s }
    }

    fn is_behind(&self, tick: &TickRecord) -> bool {
        tick.session != self.at.0 || tick.tick >= self.at.1
    }
}

/// The worst pressures of one recording.
#[derive(Debug, Default)]
struct OfRecording {
    /// Pressures that count, by channel.
    worst: [Option<Worst>; 2],
    /// Says whether the session in which the sitting began has come.
    session: Session,
}

/// The session in which a sitting began, in a recording that is read.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
enum Session {
    #[default]
    NotYet,
    Begun,
}

impl OfRecording {
    /// Counts a tick. Sessions before that in which the sitting began are not of it, and one that the recording has without that session
    /// came later.
    fn add(&mut self, since: &Since, tick: &TickRecord) {
        if tick.session == since.at.0 && self.session == Session::NotYet {
            *self = OfRecording { session: Session::Begun, ..OfRecording::default() };
        }
        if since.is_behind(tick) {
            add_worse(&mut self.worst, of_tick(tick));
        }
    }
}

/// A pressure that no other was worse than.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Worst {
    /// The pressure, in kPa gauge.
    pub kpa: f64,
    /// Name of who was in control in that tick: `experiment`, `policy`, `fallback`, or `nobody`.
    pub by: String,
}

/// The highest positive and the lowest negative pressure since a moment, from all recordings of a folder; nothing where
/// no tick was recorded since.
///
/// # Errors
/// A recording that cannot be read.
pub fn since(folder: &Path, since: &Since) -> Result<Option<[Worst; 2]>, AdaptError> {
    let mut worst = [None, None];
    let began = UNIX_EPOCH + Duration::from_secs(since.unix_s);
    for (changed, path) in recorded::newest_first(folder, Holding::Everything)? {
        // What was written last before the sitting began holds no tick of it.
        if changed + CLOCKS_DIFFER < began {
            break;
        }
        let mut here = OfRecording::default();
        recorded::each_tick(&path, |tick| here.add(since, tick))?;
        add_worse(&mut worst, here.worst);
    }
    let [pos, neg] = worst;
    Ok(pos.zip(neg).map(|(pos, neg)| [pos, neg]))
}

/// The worse of two pairs, channel by channel.
pub fn worse_of(one: Option<[Worst; 2]>, other: Option<[Worst; 2]>) -> Option<[Worst; 2]> {
    let channels = |both: Option<[Worst; 2]>| both.map_or([None, None], |both| both.map(Some));
    let mut worst = channels(one);
    add_worse(&mut worst, channels(other));
    let [pos, neg] = worst;
    pos.zip(neg).map(|(pos, neg)| [pos, neg])
}

/// Puts the worse of each channel in the place of what is there.
fn add_worse(worst: &mut [Option<Worst>; 2], others: [Option<Worst>; 2]) {
    for ((worst, other), sign) in worst.iter_mut().zip(others).zip([1.0, -1.0]) {
        let is_worse = |other: &Worst| worst.as_ref().is_none_or(|worst| sign * other.kpa > sign * worst.kpa);
        if let Some(other) = other.filter(is_worse) {
            *worst = Some(other);
        }
    }
}

/// The readings of a tick; nothing of a sensor that has none.
fn of_tick(tick: &TickRecord) -> [Option<Worst>; 2] {
    let in_control = by(tick);
    [tick.p_pos_kpa, tick.p_neg_kpa].map(|kpa| kpa.is_finite().then(|| Worst { kpa, by: in_control.to_owned() }))
}

fn by(tick: &TickRecord) -> &'static str {
    if tick.experiment != 0 {
        "experiment"
    } else if tick.state != RUN {
        "nobody"
    } else if tick.observation_hash != 0 && tick.authority > 0.0 {
        "policy"
    } else {
        "fallback"
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::recording::{RecordingInfo, RecordingWriter};

    fn record(path: &Path, ticks: impl IntoIterator<Item = TickRecord>) {
        let mut writer = RecordingWriter::create(path, &RecordingInfo::new("test", 0), &[]).unwrap();
        for tick in ticks {
            writer.write(&tick).unwrap();
        }
        writer.finish().unwrap();
    }

    #[test]
    fn the_worst_is_taken_from_every_tick_since_the_beginning_with_who_was_in_control() {
        let folder = std::env::temp_dir().join(format!("adapt-worst-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let tick = |tick: u32| TickRecord {
            session: 5,
            tick,
            state: RUN,
            p_pos_kpa: 90.0,
            p_neg_kpa: -70.0,
            ..TickRecord::default()
        };
        // Worse still, but before the beginning.
        let early = TickRecord { p_pos_kpa: 200.0, p_neg_kpa: -99.0, ..tick(10) };
        let earlier = TickRecord { session: 4, tick: 90, ..early };
        let by_policy = TickRecord { p_neg_kpa: -78.0, observation_hash: 1, authority: 1.0, ..tick(60) };
        record(&folder.join("run-1.mcap"), [earlier, early, tick(50), by_policy]);
        let played = TickRecord { p_pos_kpa: 117.9, experiment: 2, ..tick(70) };
        // A sensor that broke says nothing, and nothing against the other.
        let broken = TickRecord { p_pos_kpa: f64::NAN, p_neg_kpa: -79.5, ..tick(71) };
        record(&folder.join("experiment-1.mcap"), [played, broken]);
        let later = TickRecord { session: 6, p_pos_kpa: 118.5, state: 0, ..tick(3) };
        record(&folder.join("run-2.mcap"), [later]);
        let worst = since(&folder, &Since { at: (5, 40), unix_s: 0 }).unwrap().unwrap();
        assert_eq!(worst[0], Worst { kpa: 118.5, by: "nobody".to_owned() });
        assert_eq!(worst[1], Worst { kpa: -79.5, by: "fallback".to_owned() });
        // Whatever was written long before the sitting began is not even looked at.
        let later = Since { at: (6, 0), unix_s: Since::now((6, 0)).unix_s + 3600 };
        assert_eq!(since(&folder, &later).unwrap(), None);
        std::fs::remove_dir_all(folder).unwrap();
    }
}

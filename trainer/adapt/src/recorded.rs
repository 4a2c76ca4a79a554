//! Ticks of a daemon's recordings: what was flown from one tick to another, and what diagnosis is given.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use proto::atomic_file;
use proto::recording::{FollowEnd, McapFollower, TickRecord, attached};

use crate::AdaptError;
use crate::rig_time::TICK_S;

/// The state's code of a rig that is being controlled.
pub(crate) const RUN: u8 = 1;
/// Recordings that are looked through for a run, newest first.
const LOOKED_THROUGH: usize = 4;
/// Stretches shorter than this say nothing of a rig, in ticks.
const SHORTEST: usize = 250;

/// Files inside the newest recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Inside {
    /// The model in force.
    pub model: Vec<u8>,
    /// The reference that is followed.
    pub reference: Vec<u8>,
    /// The daemon's configuration, where the recording has it.
    pub config: Option<Vec<u8>>,
    /// The policy that the daemon began with, where there was one.
    pub policy: Option<Vec<u8>>,
}

/// Kind of recordings that are meant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Holding {
    /// Recordings of runs, in which the rig is controlled.
    Runs,
    /// Recordings of experiments as well.
    Everything,
}

/// Recordings of a folder with the times of their last changes, newest first.
///
/// # Errors
/// The folder cannot be read.
pub(crate) fn newest_first(folder: &Path, holding: Holding) -> Result<Vec<(SystemTime, PathBuf)>, AdaptError> {
    let entries = match std::fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(AdaptError::file(folder, format!("cannot be read: {error}"))),
    };
    let mut found: Vec<(SystemTime, PathBuf)> = Vec::new();
    for entry in entries.flatten() {
        let path = entry.path();
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let is_meant = holding == Holding::Everything || !name.starts_with("experiment");
        if !name.ends_with(".mcap") || !is_meant || name.starts_with('.') {
            continue;
        }
        let changed = entry.metadata().and_then(|about| about.modified()).unwrap_or(SystemTime::UNIX_EPOCH);
        found.push((changed, path));
    }
    found.sort();
    found.reverse();
    Ok(found)
}

/// Looks at every tick of a recording, as far as it has been written.
///
/// # Errors
/// A recording that cannot be read.
pub(crate) fn each_tick(path: &Path, mut look: impl FnMut(&TickRecord)) -> Result<(), AdaptError> {
    let mut follower = McapFollower::open(path)?;
    loop {
        follower.read_on()?.iter().for_each(&mut look);
        if follower.end() != FollowEnd::More {
            follower.give_up()?.iter().for_each(&mut look);
            return Ok(());
        }
    }
}

/// The ticks of a recording that are wanted, as far as it has been written.
fn ticks_of(path: &Path, wanted: impl Fn(&TickRecord) -> bool) -> Result<Vec<TickRecord>, AdaptError> {
    let mut ticks = Vec::new();
    each_tick(path, |tick| {
        if wanted(tick) {
            ticks.push(*tick);
        }
    })?;
    Ok(ticks)
}

/// Ticks of a flight that is under way, read on as they are recorded.
#[derive(Debug)]
pub(crate) struct FlightTicks {
    folder: PathBuf,
    session: u32,
    ticks: Range<u32>,
    /// The recording that is followed, with its path.
    open: Option<(PathBuf, McapFollower)>,
    taken: Vec<TickRecord>,
    /// Lines on what of the recordings was lost.
    notes: Vec<String>,
}

impl FlightTicks {
    /// Ticks of a session from one number up to another.
    pub(crate) fn new(folder: &Path, session: u32, ticks: Range<u32>) -> Self {
        FlightTicks { folder: folder.to_owned(), session, ticks, open: None, taken: Vec::new(), notes: Vec::new() }
    }

    /// All that are recorded by now, in their order.
    ///
    /// # Errors
    /// A recording that cannot be read.
    pub(crate) fn so_far(&mut self) -> Result<&[TickRecord], AdaptError> {
        let before = self.taken.len();
        self.read_on()?;
        // Nothing more comes of one that is finished, or was cut off and is not gone on with.
        if self.taken.len() == before {
            let newest = newest_first(&self.folder, Holding::Runs)?.into_iter().next().map(|(_, path)| path);
            let is_another = |path: &PathBuf| self.open.as_ref().is_none_or(|(open, _)| open != path);
            if let Some(path) = newest.filter(is_another) {
                let next = McapFollower::open(&path)?;
                if let Some((_, mut left)) = self.open.replace((path, next)) {
                    self.take(left.give_up()?);
                    self.notes.extend(left.take_notes());
                }
                self.read_on()?;
            }
        }
        Ok(&self.taken)
    }

    /// Takes the lines on what of the recordings was lost.
    pub(crate) fn take_notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notes)
    }

    /// Reads on in the open recording as far as it is written.
    fn read_on(&mut self) -> Result<(), AdaptError> {
        while let Some((_, open)) = &mut self.open {
            let (ticks, end) = (open.read_on()?, open.end());
            self.notes.extend(open.take_notes());
            self.take(ticks);
            if end != FollowEnd::More {
                break;
            }
        }
        Ok(())
    }

    /// Takes the ticks of the flight that are new: a recording that was renamed at its end is read again.
    fn take(&mut self, ticks: Vec<TickRecord>) {
        for tick in ticks {
            let is_new = self.taken.last().is_none_or(|last| tick.tick > last.tick);
            if tick.session == self.session && self.ticks.contains(&tick.tick) && is_new {
                self.taken.push(tick);
            }
        }
    }
}

/// Files inside the newest recording; nothing where there is none yet.
///
/// # Errors
/// A recording that cannot be read.
pub fn newest(folder: &Path) -> Result<Option<Inside>, AdaptError> {
    let Some((_, path)) = newest_first(folder, Holding::Runs)?.into_iter().next() else { return Ok(None) };
    let mut follower = McapFollower::open(&path)?;
    follower.read_on()?;
    let last = |name: &str| follower.attachments(name).last().map(<[u8]>::to_vec);
    let lacks = |name: &str| AdaptError::file(&path, format!("holds no {name} yet; a running daemon's recording does"));
    Ok(Some(Inside {
        model: last(attached::MODEL).ok_or_else(|| lacks(attached::MODEL))?,
        reference: last(attached::REFERENCE).ok_or_else(|| lacks(attached::REFERENCE))?,
        config: last(attached::CONFIG),
        // Those that were tried since stand behind it.
        policy: follower.attachments(attached::POLICY).next().map(<[u8]>::to_vec),
    }))
}

/// The ticks of a session from one number up to another, as far as they are recorded.
///
/// # Errors
/// A recording that cannot be read.
pub fn between(folder: &Path, session: u32, ticks: Range<u32>) -> Result<Vec<TickRecord>, AdaptError> {
    let mut parts = Vec::new();
    for (_, path) in newest_first(folder, Holding::Runs)?.into_iter().take(LOOKED_THROUGH) {
        let part = ticks_of(&path, |tick| tick.session == session && ticks.contains(&tick.tick))?;
        let reaches_back = part.first().is_some_and(|first| first.tick <= ticks.start);
        parts.push(part);
        if reaches_back {
            break;
        }
    }
    Ok(parts.into_iter().rev().flatten().collect())
}

/// The newest stretches of a session up to a tick in which the rig was controlled, in all at most so many seconds, oldest first.
///
/// # Errors
/// A recording that cannot be read.
pub fn stretches(folder: &Path, session: u32, until: u32, most_s: f64) -> Result<Vec<Vec<TickRecord>>, AdaptError> {
    let most = (most_s / TICK_S) as u32;
    let ticks = between(folder, session, until.saturating_sub(most)..until)?;
    let mut stretches: Vec<Vec<TickRecord>> = Vec::new();
    for tick in ticks.into_iter().filter(|tick| tick.state == RUN && tick.p_pos_kpa.is_finite()) {
        match stretches.last_mut() {
            Some(stretch) if stretch.last().is_some_and(|last| last.tick.wrapping_add(1) == tick.tick) => {
                stretch.push(tick);
            }
            _ => stretches.push(vec![tick]),
        }
    }
    stretches.retain(|stretch| stretch.len() >= SHORTEST);
    Ok(stretches)
}

/// Writes stretches as recordings in CSV, which `trainer diagnose` reads.
///
/// # Errors
/// A file that cannot be written.
pub fn write_csv(folder: &Path, stretches: &[Vec<TickRecord>]) -> Result<Vec<PathBuf>, AdaptError> {
    let mut paths = Vec::new();
    for (number, stretch) in stretches.iter().enumerate() {
        let mut text = "time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa,ref_pos_kpa,ref_neg_kpa,pump_on\n".to_owned();
        for (row, tick) in stretch.iter().enumerate() {
            text += &format!(
                "{:.2},{},{},{},{},{},{},{}\n",
                row as f64 * TICK_S,
                tick.u_pos,
                tick.u_neg,
                tick.p_pos_kpa,
                tick.p_neg_kpa,
                tick.ref_pos_kpa,
                tick.ref_neg_kpa,
                u8::from(tick.pump_on)
            );
        }
        let path = folder.join(format!("run-{}.csv", number + 1));
        atomic_file::write(&path, text.as_bytes())?;
        paths.push(path);
    }
    Ok(paths)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::recording::{RecordingInfo, RecordingWriter, unfinished_path};

    #[test]
    fn stretches_are_parted_where_the_rig_was_not_controlled() {
        let folder = std::env::temp_dir().join(format!("adapt-recorded-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let mut writer =
            RecordingWriter::create(&folder.join("run-1.mcap"), &RecordingInfo::new("test", 0), &[]).unwrap();
        for tick in 0..1000 {
            let state = if (300..310).contains(&tick) { 2 } else { RUN };
            let record =
                TickRecord { session: 5, tick, state, p_pos_kpa: 1.0, p_neg_kpa: -1.0, ..TickRecord::default() };
            writer.write(&record).unwrap();
        }
        writer.flush().unwrap();
        let found = stretches(&folder, 5, 900, 1000.0).unwrap();
        let lengths: Vec<usize> = found.iter().map(Vec::len).collect();
        assert_eq!(lengths, [300, 590]);
        let found = stretches(&folder, 5, 900, 8.0).unwrap();
        assert_eq!(found.iter().map(|s| s.len()).collect::<Vec<_>>(), [400], "no more than was asked for");
        assert!(stretches(&folder, 6, 900, 8.0).unwrap().is_empty(), "another session");
        assert_eq!(between(&folder, 5, 995..2000).unwrap().len(), 5);
        assert_eq!(newest(&folder.join("nowhere")).unwrap(), None);
        std::fs::remove_dir_all(folder).unwrap();
    }

    /// A recording that was cut off by a crash is left for the one that goes on.
    #[test]
    fn a_flight_is_followed_from_a_recording_that_was_cut_off_into_the_next() {
        let folder = std::env::temp_dir().join(format!("adapt-followed-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let begin = |name: &str, ticks: Range<u32>, changed_s: u64| {
            let path = folder.join(name);
            let mut writer = RecordingWriter::create(&path, &RecordingInfo::new("test", 0), &[]).unwrap();
            for tick in ticks {
                writer.write(&TickRecord { session: 5, tick, state: RUN, ..TickRecord::default() }).unwrap();
            }
            writer.flush().unwrap();
            let changed = SystemTime::UNIX_EPOCH + std::time::Duration::from_secs(changed_s);
            std::fs::File::options().append(true).open(unfinished_path(&path)).unwrap().set_modified(changed).unwrap();
            writer
        };
        let mut flight = FlightTicks::new(&folder, 5, 50..250);
        let cut = begin("run-1.mcap", 0..100, 1000);
        assert_eq!(flight.so_far().unwrap().len(), 50);
        assert_eq!(flight.so_far().unwrap().len(), 50, "nothing is taken twice");
        let next = begin("run-2.mcap", 100..300, 2000);
        assert_eq!(flight.so_far().unwrap().len(), 200);
        drop((cut, next));
        std::fs::remove_dir_all(folder).unwrap();
    }
}

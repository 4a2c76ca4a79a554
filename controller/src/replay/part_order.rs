//! Order of the parts of a run, by what stands in them: a shell sorts `run-…-2.mcap` before `run-….mcap`.

use std::cmp::Reverse;
use std::path::{Path, PathBuf};

use proto::recording::ReadMcapError;

use super::run_file::{RunFile, RunFileError};

/// Recordings in the order in which they are replayed.
#[derive(Debug, Default)]
pub struct Ordered {
    /// Those that hold ticks.
    pub recordings: Vec<PathBuf>,
    /// Notes on each that holds none, as where the disk was full when it was begun.
    pub without_ticks: Vec<String>,
}

/// Recordings with the parts of each run one after the other, at the place of the first of them that was given; all else stays where it is.
///
/// # Errors
/// A file cannot be read, or is no recording; none of several holds a tick.
pub fn in_order(recordings: Vec<PathBuf>) -> Result<Ordered, RunFileError> {
    if recordings.len() < 2 {
        return Ok(Ordered { recordings, without_ticks: Vec::new() });
    }
    let (mut held, mut parts, mut without_ticks) = (Vec::new(), Vec::new(), Vec::new());
    for path in recordings {
        // One at a time: together they may be larger than memory.
        match RunFile::read(&path) {
            Ok(run) => {
                parts.push(Part::of(&run));
                held.push(path);
            }
            Err(RunFileError::Mcap(empty @ ReadMcapError::NoTicks { .. })) => without_ticks.push(empty),
            Err(error) => return Err(error),
        }
    }
    if parts.is_empty()
        && let Some(empty) = without_ticks.pop()
    {
        return Err(empty.into());
    }
    let recordings = order(&parts).into_iter().filter_map(|index| held.get(index).cloned()).collect();
    Ok(Ordered { recordings, without_ticks: without_ticks.iter().map(ToString::to_string).collect() })
}

/// A recording as a part of its run.
#[derive(Debug, Clone, Default)]
struct Part {
    folder: PathBuf,
    name: String,
    /// Number, from 1.
    number: u32,
    /// The name that the part before had when this one was begun.
    previous: Option<String>,
    /// Session and number of the first tick, and of the last.
    ends: Option<[(u32, u32); 2]>,
}

impl Part {
    fn of(run: &RunFile) -> Self {
        let ticks = &run.content.ticks;
        let ends = ticks.first().zip(ticks.last()).map(|ends| <[_; 2]>::from(ends).map(|t| (t.session, t.tick)));
        Part {
            folder: run.path.parent().unwrap_or(Path::new("")).to_owned(),
            name: file_name(&run.path),
            number: run.part(),
            previous: run.content.metadata.get("previous_file").cloned(),
            ends,
        }
    }

    /// Tells whether the ticks of this part go on where those of the other end.
    fn goes_on(&self, other: &Part) -> bool {
        match (other.ends, self.ends) {
            (Some([_, (session, last)]), Some([first, _])) => (session, last.wrapping_add(1)) == first,
            _ => false,
        }
    }

    /// Index of the part that comes right before this one. Ticks tell more than names: runs in two folders may have the same names,
    /// and files may be renamed. Among equals a part in the same folder is the one.
    fn before(&self, parts: &[Part]) -> Option<usize> {
        parts
            .iter()
            .enumerate()
            .filter(|(_, other)| self.number > 1 && self.number == other.number + 1)
            .map(|(index, other)| {
                let is_named = self.previous.as_deref() == Some(&other.name);
                (index, [self.goes_on(other), is_named, self.folder == other.folder])
            })
            .filter(|(_, [goes_on, is_named, _])| *goes_on || *is_named)
            .min_by_key(|(_, agreeing)| Reverse(*agreeing))
            .map(|(index, _)| index)
    }
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Indices of the parts in their order.
fn order(parts: &[Part]) -> Vec<usize> {
    let before: Vec<Option<usize>> = parts.iter().map(|part| part.before(parts)).collect();
    let mut ordered = Vec::with_capacity(parts.len());
    // Numbers grow along a chain, so there is no circle.
    for (first, _) in before.iter().enumerate().filter(|(_, before)| before.is_none()) {
        let mut next = vec![first];
        while let Some(index) = next.pop() {
            ordered.push(index);
            let successors = (0..parts.len()).filter(|other| before.get(*other) == Some(&Some(index)));
            next.extend(successors.rev());
        }
    }
    ordered
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part(name: &str, number: u32, previous: &str, ends: [u32; 2]) -> Part {
        let previous = (!previous.is_empty()).then(|| previous.to_owned());
        Part { folder: PathBuf::new(), name: name.to_owned(), number, previous, ends: Some(ends.map(|tick| (7, tick))) }
    }

    fn names(parts: &[Part]) -> Vec<&str> {
        order(parts).into_iter().map(|index| parts[index].name.as_str()).collect()
    }

    #[test]
    fn parts_come_in_the_order_of_their_run_and_runs_in_that_of_the_command() {
        // As a shell sorts them, a second run behind.
        let parts = [
            part("run-1-2.mcap", 2, "run-1.mcap", [50, 99]),
            part("run-1-3.mcap", 3, "run-1-2.mcap", [100, 149]),
            part("run-1.mcap", 1, "", [0, 49]),
            part("run-2-2.mcap", 2, "run-2.mcap", [30, 59]),
            part("run-2.mcap", 1, "", [0, 29]),
        ];
        let sorted = ["run-1.mcap", "run-1-2.mcap", "run-1-3.mcap", "run-2.mcap", "run-2-2.mcap"];
        assert_eq!(names(&parts), sorted);
        let ordered: Vec<Part> = order(&parts).into_iter().map(|index| parts[index].clone()).collect();
        assert_eq!(names(&ordered), sorted, "what is in order stays so");
    }

    #[test]
    fn renamed_parts_are_known_by_their_ticks_and_what_is_missing_stays_missing() {
        let parts = [
            part("b.mcap", 2, "run-1.mcap", [50, 99]),
            part("d.mcap", 4, "run-1-3.mcap", [150, 199]),
            part("a.mcap", 1, "", [0, 49]),
        ];
        assert_eq!(names(&parts), ["d.mcap", "a.mcap", "b.mcap"]);
        let twice = [parts[2].clone(), parts[0].clone(), parts[0].clone()];
        assert_eq!(names(&twice), ["a.mcap", "b.mcap", "b.mcap"], "to be refused as given twice");
    }

    #[test]
    fn runs_of_the_same_names_in_two_folders_stay_apart() {
        let runs = |ends: [[u32; 2]; 4]| {
            let [a_1, a_2, b_1, b_2] = ends;
            [
                Part { folder: "a".into(), ..part("run-T.mcap", 1, "", a_1) },
                Part { folder: "a".into(), ..part("run-T-2.mcap", 2, "run-T.mcap", a_2) },
                Part { folder: "b".into(), ..part("run-T.mcap", 1, "", b_1) },
                Part { folder: "b".into(), ..part("run-T-2.mcap", 2, "run-T.mcap", b_2) },
            ]
        };
        let by_ticks = runs([[0, 49], [50, 99], [200, 229], [230, 259]]);
        assert_eq!(order(&by_ticks), [0, 1, 2, 3]);
        // A run and a copy of it that was cut off: the ticks of either go on in both folders.
        let alike = runs([[0, 49], [50, 99], [0, 49], [50, 79]]);
        assert_eq!(order(&alike), [0, 1, 2, 3]);
        // Ticks are missing between the parts of both.
        let torn = runs([[0, 40], [50, 99], [200, 220], [230, 259]]);
        assert_eq!(order(&torn), [0, 1, 2, 3]);
        // The second parts have changed places, and only the ticks tell.
        let crossed = runs([[0, 49], [230, 259], [200, 229], [50, 99]]);
        assert_eq!(order(&crossed), [0, 3, 2, 1]);
        // A name alone is better than nothing.
        let alone = [torn[1].clone(), torn[2].clone()];
        assert_eq!(order(&alone), [1, 0]);
    }
}

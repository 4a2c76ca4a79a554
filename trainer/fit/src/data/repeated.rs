//! Recordings that are given more than once, under one name or as copies: twice the rows are no more evidence, and rows that are fitted
//! test nothing.

use proto::recording::Recording;

/// Distance in s up to which times from the first row are the same.
const SAME_TIME_S: f64 = 1e-6;

/// The recordings without those that hold the rows of an earlier one, and a line about each that is left out.
pub fn each_once(recordings: Vec<Recording>) -> (Vec<Recording>, Vec<String>) {
    let (mut kept, mut notes): (Vec<Recording>, Vec<String>) = (Vec::with_capacity(recordings.len()), Vec::new());
    for recording in recordings {
        match kept.iter().find(|earlier| is_same(earlier, &recording)) {
            Some(earlier) if earlier.source() == recording.source() => {
                notes.push(format!("{}: is given more than once, and counts once", recording.source()));
            }
            Some(earlier) => notes.push(format!(
                "{}: holds the same rows as {}, and is left out",
                recording.source(),
                earlier.source()
            )),
            None => kept.push(recording),
        }
    }
    (kept, notes)
}

/// Tells whether two recordings have the same rows: times from the first, and the numbers of every column that both have.
fn is_same(one: &Recording, other: &Recording) -> bool {
    if one.rows() != other.rows() {
        return false;
    }
    let since = |recording: &Recording| recording.time_s().first().copied().unwrap_or(0.0);
    let (begun, other_begun) = (since(one), since(other));
    let mut times = one.time_s().iter().zip(other.time_s());
    let alike = times.all(|(a, b)| ((a - begun) - (b - other_begun)).abs() <= SAME_TIME_S);
    let columns = one.names().filter_map(|name| Some((one.column(name)?, other.column(name)?)));
    let shared: Vec<(&[f64], &[f64])> = columns.collect();
    let same = |(a, b): &(&[f64], &[f64])| a.iter().zip(*b).all(|(a, b)| a == b || a.is_nan() && b.is_nan());
    alike && !shared.is_empty() && shared.iter().all(same)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // a test that cannot set up its case must fail

    use super::*;

    #[test]
    fn copies_count_once_and_like_runs_each() {
        let with = |name: &str, start_s: f64, kpa: f64| {
            let row = |k: u32| format!("{:.2},0.5,{}\n", start_s + 0.02 * f64::from(k), kpa + f64::from(k % 7));
            let text = "time_s,u,p\n".to_owned() + &(0..40).map(row).collect::<String>();
            Recording::parse_csv(name, text.as_bytes()).unwrap()
        };
        let all = vec![
            with("a.csv", 0.0, 5.0),
            with("b.csv", 0.0, 6.0),
            with("a.csv", 0.0, 5.0),
            with("copy.csv", 100.0, 5.0),
        ];
        let (kept, notes) = each_once(all);
        assert_eq!(kept.iter().map(Recording::source).collect::<Vec<_>>(), ["a.csv", "b.csv"]);
        let said = [
            "a.csv: is given more than once, and counts once",
            "copy.csv: holds the same rows as a.csv, and is left out",
        ];
        assert_eq!(notes, said);
    }
}

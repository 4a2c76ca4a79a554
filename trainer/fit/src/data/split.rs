//! Rows that are fitted, that choose between models, and that are kept back for the final figures.
//!
//! With five recordings or more, whole recordings are given away (about 60 : 20 : 20 by rows); what is tested is
//! then another day's run. With fewer, each recording is cut into contiguous stretches of at least 10 s, for a
//! model that fits neighbouring rows says nothing about others, and each recording gives its share to every role, so that
//! every kind of excitation is in all three. The rows that choose lie elsewhere in every second recording: what happens at
//! the same time in all of them (a tank that joins, a supply that is switched) is then in rows that are fitted, and in rows
//! that are not.
//!
//! Of a recording that comes in pieces (a pump that was switched) beside whole ones three quarters of each piece are
//! fitted and the rest chooses.
//!
//! A stretch that is not fitted is simulated along with its recording from the recording's start (commands only),
//! so slow states are right where it begins; it is the *readings* of it that no fit sees.

use std::ops::Range;

use super::{Layout, Records};

/// Purpose of a stretch of rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Parameters are fitted to it.
    Fit,
    /// Models are compared on it.
    Select,
    /// Final figures come from it and nothing else does.
    HeldOut,
}

/// Contiguous rows of one recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stretch {
    /// Index of the recording.
    pub record: usize,
    /// Rows of the stretch.
    pub rows: Range<usize>,
    /// Purpose of the rows.
    pub role: Role,
}

/// Rows of recordings with their roles. [`Split::of`] gives none to leads ([`super::Record::lead_rows`]).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Split {
    stretches: Vec<Stretch>,
}

/// The shortest stretch, in rows: 10 s.
const SHORTEST_ROWS: usize = 500;
/// Number of recordings from which on they are given away whole.
const WHOLE_FROM: usize = 5;

impl Split {
    /// Splits recordings, without their leads, into 60 : 20 : 20.
    pub fn of(records: &Records) -> Self {
        let mut split = Self::of_every_row(records);
        for stretch in &mut split.stretches {
            stretch.rows.start += records.records().get(stretch.record).map_or(0, |r| r.lead_rows(stretch.rows.start));
        }
        split
    }

    fn of_every_row(records: &Records) -> Self {
        let all = records.records();
        let in_pieces: Vec<bool> =
            all.iter().map(|one| all.iter().filter(|other| other.source == one.source).count() > 1).collect();
        let of = |pieces: bool| -> Vec<(usize, Vec<Range<usize>>)> {
            let those = all.iter().zip(&in_pieces).enumerate().filter(|(_, (_, p))| **p == pieces);
            those.map(|(index, (r, _))| (index, r.segments.clone())).collect()
        };
        let whole = of(false);
        if whole.is_empty() || whole.len() == all.len() {
            let rows: Vec<Vec<Range<usize>>> = all.iter().map(|r| r.segments.clone()).collect();
            return Self::of_segments(&rows);
        }
        let (places, rows): (Vec<usize>, Vec<_>) = whole.into_iter().unzip();
        let mut split = Self::of_segments(&rows);
        for stretch in &mut split.stretches {
            stretch.record = places.get(stretch.record).copied().unwrap_or(stretch.record);
        }
        // Beside whole recordings, pieces are what an experiment showed where nothing else does: nothing of that is kept back.
        for (record, segments) in of(true) {
            for rows in segments {
                let cut = rows.start + rows.len() * 3 / 4;
                split.stretches.push(Stretch { record, rows: rows.start..cut, role: Role::Fit });
                split.stretches.push(Stretch { record, rows: cut..rows.end, role: Role::Select });
            }
        }
        split.stretches.sort_by_key(|s| (s.record, s.rows.start));
        split
    }

    /// The stretches, in order.
    pub fn stretches(&self) -> &[Stretch] {
        &self.stretches
    }

    /// Stretches of one role.
    pub fn of_role(&self, role: Role) -> impl Iterator<Item = &Stretch> {
        self.stretches.iter().filter(move |stretch| stretch.role == role)
    }

    /// Rows of one role, all recordings together.
    pub fn rows(&self, role: Role) -> usize {
        self.of_role(role).map(|stretch| stretch.rows.len()).sum()
    }

    /// 1 at the readings of a role, 0 elsewhere.
    pub fn weights(&self, layout: &Layout, role: Role) -> Vec<f64> {
        let mut weights = vec![0.0; layout.len()];
        for stretch in self.of_role(role) {
            for channel in 0..layout.channels() {
                if let Some(part) = weights.get_mut(layout.stretch(stretch.record, channel, stretch.rows.clone())) {
                    part.fill(1.0);
                }
            }
        }
        weights
    }

    /// Stretches of a role cut into blocks of about `rows` rows (never shorter, unless the stretch is).
    pub fn blocks(&self, role: Role, rows: usize) -> Vec<Stretch> {
        let mut blocks = Vec::new();
        for stretch in self.of_role(role) {
            let count = (stretch.rows.len() / rows.max(1)).max(1);
            for block in 0..count {
                let at = |k: usize| stretch.rows.start + stretch.rows.len() * k / count;
                blocks.push(Stretch { record: stretch.record, rows: at(block)..at(block + 1), role });
            }
        }
        blocks
    }

    fn of_segments(records: &[Vec<Range<usize>>]) -> Self {
        let mut stretches = Vec::new();
        if records.len() >= WHOLE_FROM {
            // One in five each for selection and the final figures, spread over the list.
            for (record, segments) in records.iter().enumerate() {
                let role = match record % 5 {
                    2 => Role::Select,
                    4 => Role::HeldOut,
                    _ => Role::Fit,
                };
                stretches.extend(segments.iter().map(|rows| Stretch { record, rows: rows.clone(), role }));
            }
        } else {
            for (record, segments) in records.iter().enumerate() {
                for rows in segments {
                    cut(record, rows, record % 2 == 1, &mut stretches);
                }
            }
            choose_too(&mut stretches);
        }
        Split { stretches }
    }
}

/// Where recordings are so short that none gave rows to choose by, every second of those held out does, from the first
/// on; of a single one the first half.
fn choose_too(stretches: &mut Vec<Stretch>) {
    if stretches.iter().any(|s| s.role == Role::Select) {
        return;
    }
    let held: Vec<usize> = (0..stretches.len()).filter(|i| stretches[*i].role == Role::HeldOut).collect();
    match held.as_slice() {
        [] => {}
        [only] => {
            let Stretch { record, rows, .. } = stretches[*only].clone();
            let middle = rows.start + rows.len() / 2;
            stretches[*only] = Stretch { record, rows: rows.start..middle, role: Role::Select };
            stretches.insert(only + 1, Stretch { record, rows: middle..rows.end, role: Role::HeldOut });
        }
        several => several.iter().step_by(2).for_each(|i| stretches[*i].role = Role::Select),
    }
}

/// Cuts one segment into stretches: fit, select, fit, held out, in shares of 3 : 2 : 3 : 2, or `early` of 1 : 2 : 5 : 2 where
/// that leaves 10 s for the first (from 80 s on; it is a little more than 1 below 100 s).
///
/// A segment too short for that gives less: below 20 s it is fitted as a whole, below 30 s its last third (at
/// least 10 s) is held out.
fn cut(record: usize, rows: &Range<usize>, early: bool, stretches: &mut Vec<Stretch>) {
    let n = rows.len();
    let mut add = |from: usize, to: usize, role: Role| {
        stretches.push(Stretch { record, rows: rows.start + from..rows.start + to, role });
    };
    if n < 2 * SHORTEST_ROWS {
        add(0, n, Role::Fit);
    } else if n < 3 * SHORTEST_ROWS {
        add(0, n - SHORTEST_ROWS, Role::Fit);
        add(n - SHORTEST_ROWS, n, Role::HeldOut);
    } else {
        let share = (n / 5).max(SHORTEST_ROWS);
        let fitted = n - 2 * share;
        // The first part holds the recording's start, whose pressures are guessed: it takes the larger half, or what is needed.
        let first = if early && n / 8 >= SHORTEST_ROWS { (n / 10).max(SHORTEST_ROWS) } else { fitted - fitted / 2 };
        if fitted < 2 * SHORTEST_ROWS {
            add(0, fitted, Role::Fit);
            add(fitted, fitted + share, Role::Select);
            add(fitted + share, n, Role::HeldOut);
        } else {
            add(0, first, Role::Fit);
            add(first, first + share, Role::Select);
            add(first + share, n - share, Role::Fit);
            add(n - share, n, Role::HeldOut);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Every row once, in order; nothing shorter than 10 s unless the segment is.
        #[test]
        fn stretches_tile_the_rows(lengths in prop::collection::vec(1_usize..20_000, 1..9)) {
            let records: Vec<Vec<Range<usize>>> = lengths.iter().map(|n| std::iter::once(0..*n).collect()).collect();
            let split = Split::of_segments(&records);
            // The only recording that has rows to hold out, 20 to 30 s of it, shares its last 10 s between two roles.
            let alone = lengths.iter().filter(|n| **n >= 2 * SHORTEST_ROWS).count() == 1;
            let shortest = if alone { SHORTEST_ROWS / 2 } else { SHORTEST_ROWS };
            for (record, n) in lengths.iter().enumerate() {
                let mut end = 0;
                for stretch in split.stretches().iter().filter(|s| s.record == record) {
                    prop_assert_eq!(stretch.rows.start, end);
                    end = stretch.rows.end;
                    prop_assert!(stretch.rows.len() >= shortest.min(*n));
                }
                prop_assert_eq!(end, *n);
            }
            let has = |role| split.rows(role) > 0;
            prop_assert!(has(Role::Select) || !has(Role::HeldOut));
        }
    }

    #[test]
    fn three_recordings_give_every_role_its_share() {
        let records: Vec<Vec<Range<usize>>> = [5000, 5000, 4000].map(|n| std::iter::once(0..n).collect()).to_vec();
        let split = Split::of_segments(&records);
        assert_eq!([Role::Fit, Role::Select, Role::HeldOut].map(|role| split.rows(role)), [8400, 2800, 2800]);
        let blocks = split.blocks(Role::Fit, 500);
        assert_eq!(blocks.iter().map(|b| b.rows.len()).sum::<usize>(), 8400);
        assert!(blocks.iter().all(|b| (500..1000).contains(&b.rows.len())));
        // But for the end, which is held out of all, every time is fitted in one of them or another.
        let fitted = |row: usize| split.of_role(Role::Fit).any(|stretch| stretch.rows.contains(&row));
        assert!((0..4000).all(fitted));
    }
}

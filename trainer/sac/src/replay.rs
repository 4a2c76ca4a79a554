//! The memory of transitions: raw observations in f32, one row each, the oldest overwritten.
//!
//! A row is `[o, o′, a, r, live]` with `live = 0` where the episode truly ended, so that nothing is expected after
//! it; a time limit leaves `live = 1`. Memory: `4 (2 · observations + actions + 2)` bytes a transition, that is 364 MB
//! for 500,000 of 84 and 12, taken from the system as it fills.

use crate::kernel::prefer_large_pages;
use crate::settings::Shape;

/// One step of an environment.
#[derive(Debug, Clone, Copy)]
pub struct Transition<'a> {
    /// Raw observation before the action.
    pub observation: &'a [f32],
    /// The action, each entry in (-1, 1).
    pub action: &'a [f32],
    /// The reward.
    pub reward: f32,
    /// Raw observation after it (where an episode ended: its last one, not the next episode's first).
    pub next_observation: &'a [f32],
    /// True where the episode ended for good; a time limit does not.
    pub terminal: bool,
}

/// A transition of another size.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("transition's {part} has {found} entries, not {expected}")]
pub struct TransitionError {
    /// Which part.
    pub part: &'static str,
    /// Number that it should have.
    pub expected: usize,
    /// Number that it has.
    pub found: usize,
}

/// A row of the replay.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row<'a> {
    pub(crate) observation: &'a [f32],
    pub(crate) next: &'a [f32],
    pub(crate) action: &'a [f32],
    pub(crate) reward: f32,
    pub(crate) live: f32,
}

/// The ring of rows.
#[derive(Debug)]
pub(crate) struct Replay {
    observations: usize,
    actions: usize,
    capacity: usize,
    /// Rows ever written, of which the last `capacity` are kept.
    written: u64,
    floats: Vec<f32>,
}

impl Replay {
    pub(crate) fn new(shape: &Shape, capacity: usize) -> Self {
        let Shape { observations, actions, .. } = *shape;
        // Zeroed memory is handed out untouched and becomes real page by page.
        let mut floats = vec![0.0; capacity * Self::width_of(observations, actions)];
        prefer_large_pages(floats.as_mut_ptr_range());
        Self { observations, actions, capacity, written: 0, floats }
    }

    fn width_of(observations: usize, actions: usize) -> usize {
        2 * observations + actions + 2
    }

    pub(crate) fn width(&self) -> usize {
        Self::width_of(self.observations, self.actions)
    }

    /// Rows that can be drawn.
    pub(crate) fn len(&self) -> usize {
        self.written.min(self.capacity as u64) as usize
    }

    pub(crate) fn written(&self) -> u64 {
        self.written
    }

    /// Number of the oldest row that is kept; rows are numbered as they were written, from 0.
    pub(crate) fn oldest(&self) -> u64 {
        self.written.saturating_sub(self.capacity as u64)
    }

    /// Copies rows by their numbers; those that are no longer or not yet kept are left out.
    pub(crate) fn copy_rows(&self, rows: std::ops::Range<u64>) -> Vec<f32> {
        let kept = rows.start.max(self.oldest())..rows.end.min(self.written);
        let slot = |row: u64| (row % self.capacity as u64) as usize;
        kept.flat_map(|row| self.floats(slot(row)).iter().copied()).collect()
    }

    /// Puts rows back under their numbers, the first of which is `first`; rows must come in order.
    pub(crate) fn restore_rows(&mut self, first: u64, floats: &[f32]) {
        let (width, capacity) = (self.width(), self.capacity as u64);
        for (row, floats) in (first..).zip(floats.chunks_exact(width)) {
            let at = (row % capacity) as usize * width;
            self.floats[at..at + width].copy_from_slice(floats);
            self.written = row + 1;
        }
    }

    pub(crate) fn push(&mut self, transition: &Transition<'_>) -> Result<(), TransitionError> {
        let parts = [
            ("observation", transition.observation.len(), self.observations),
            ("next observation", transition.next_observation.len(), self.observations),
            ("action", transition.action.len(), self.actions),
        ];
        for (part, found, expected) in parts {
            if found != expected {
                return Err(TransitionError { part, expected, found });
            }
        }
        let (width, observations) = (self.width(), self.observations);
        let at = (self.written % self.capacity as u64) as usize;
        let row = &mut self.floats[at * width..][..width];
        let (observation, row) = row.split_at_mut(observations);
        let (next, row) = row.split_at_mut(observations);
        let (action, tail) = row.split_at_mut(self.actions);
        observation.copy_from_slice(transition.observation);
        next.copy_from_slice(transition.next_observation);
        action.copy_from_slice(transition.action);
        tail.copy_from_slice(&[transition.reward, if transition.terminal { 0.0 } else { 1.0 }]);
        self.written += 1;
        Ok(())
    }

    /// The floats of row `at`.
    #[inline(always)]
    pub(crate) fn floats(&self, at: usize) -> &[f32] {
        &self.floats[at * self.width()..][..self.width()]
    }

    #[inline(always)]
    pub(crate) fn row(&self, at: usize) -> Row<'_> {
        let (observation, rest) = self.floats(at).split_at(self.observations);
        let (next, rest) = rest.split_at(self.observations);
        let (action, tail) = rest.split_at(self.actions);
        Row { observation, next, action, reward: tail[0], live: tail[1] }
    }

    /// All rows written, in memory's order.
    pub(crate) fn filled(&self) -> &[f32] {
        &self.floats[..self.len() * self.width()]
    }

    /// As [`Self::filled`], once `written` rows are claimed; what [`Self::filled`] gave belongs in there.
    pub(crate) fn refill(&mut self, written: u64) -> &mut [f32] {
        self.written = written;
        let floats = self.len() * self.width();
        &mut self.floats[..floats]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shape() -> Shape {
        Shape { observations: 2, goal: 1..2, actions: 1 }
    }

    fn push(replay: &mut Replay, n: usize) {
        let x = n as f32;
        let transition = Transition {
            observation: &[x, x + 0.25],
            action: &[x / 100.0],
            reward: -x,
            next_observation: &[x + 1.0, x + 1.25],
            terminal: n.is_multiple_of(3),
        };
        replay.push(&transition).unwrap();
    }

    #[test]
    fn the_oldest_rows_are_overwritten() {
        let mut replay = Replay::new(&shape(), 5);
        for n in 0..13 {
            assert_eq!(replay.len(), n.min(5));
            push(&mut replay, n);
        }
        let mut rewards: Vec<_> = (0..replay.len()).map(|i| -replay.row(i).reward as usize).collect();
        rewards.sort_unstable();
        assert_eq!(rewards, [8, 9, 10, 11, 12]);
        for i in 0..5 {
            let row = replay.row(i);
            let x = -row.reward;
            assert_eq!((row.observation, row.next), (&[x, x + 0.25][..], &[x + 1.0, x + 1.25][..]));
            assert_eq!((row.action[0], row.live), (x / 100.0, if (x as usize).is_multiple_of(3) { 0.0 } else { 1.0 }));
        }
    }

    #[test]
    fn a_transition_of_another_size_is_refused_and_nothing_kept() {
        let mut replay = Replay::new(&shape(), 5);
        let transition = Transition {
            observation: &[0.0; 2],
            action: &[0.0; 1],
            reward: 0.0,
            next_observation: &[0.0; 3],
            terminal: false,
        };
        let refused = replay.push(&transition).unwrap_err();
        assert_eq!(refused.to_string(), "transition's next observation has 3 entries, not 2");
        assert_eq!(replay.len(), 0);
    }
}

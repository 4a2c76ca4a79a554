//! A reading that has come to rest where its model says that it must go on: a sensor that shows too little from the start.
//!
//! A sensor that shows half of a pressure looks, while the chamber fills, like a rig that is half as quick. It comes to rest
//! with the chamber, though, and there the model, set to the reading, still sees it move: nothing that is slow explains a
//! reading that stands. Over half a second
//!
//! ```text
//! A = Σ a / k     way that the reading made, at the quickness k that was found (`crate::slowness`)
//! M = Σ m         way that the model foresaw of it, tick by tick from where the reading was
//! ```
//!
//! and a reading stands where |A| is a small part of |M|. A rig that is not its model rests somewhere else as well, so M has
//! to be large: larger than pumps, valves and chambers that are up to 20 % off make it.

use crate::hypothesis::Way;
use crate::model_residual::LONG;

/// Part of what the model foresees that a reading may make of it and still stands (measured on 60 rigs of which each part is up
/// to 30 % off: with 0.25 sensors are found up to two seconds later, with 0.5 sound rigs come nearer to the limits).
const STANDS: f64 = 0.4;
/// Ticks in a row in which it must stand (chosen: a tenth of a second, longer than any valve's delay).
const TICKS: u32 = 5;

/// Watches one reading.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Standing {
    /// Ways of the last half second, under both commands.
    ways: [[Way; LONG]; 2],
    filled: usize,
    in_a_row: u32,
    most_kpa: f64,
}

impl Standing {
    /// Nothing seen yet; `most_kpa`: what the model may foresee in half a second of a reading that stands.
    pub(crate) fn new(most_kpa: f64) -> Self {
        let none = Way { actual_kpa: 0.0, foreseen_kpa: 0.0 };
        Standing { ways: [[none; LONG]; 2], filled: 0, in_a_row: 0, most_kpa }
    }

    /// Begins anew after arming.
    pub(crate) fn restart(&mut self) {
        (self.filled, self.in_a_row) = (0, 0);
    }

    /// Takes the ways of a tick of a rig that is as quick as `share` of its model; what the reading lacks, in kPa, where it
    /// stands and should not.
    ///
    /// # Real-time
    /// May run in the tick.
    pub(crate) fn push(&mut self, ways: [Way; 2], share: f64) -> Option<f64> {
        self.filled = (self.filled + 1).min(LONG);
        let mut lacks_kpa: Option<f64> = None;
        let mut stands = self.filled == LONG;
        for (last, way) in self.ways.iter_mut().zip(ways) {
            last.rotate_right(1);
            last[0] = way;
            let actual: f64 = last.iter().map(|way| way.actual_kpa).sum();
            let foreseen: f64 = last.iter().map(|way| way.foreseen_kpa).sum();
            // Under either command, and to the same side.
            stands &= foreseen.abs() > self.most_kpa && (actual / share).abs() <= STANDS * foreseen.abs();
            let lacks = actual - foreseen;
            match lacks_kpa {
                Some(before) if before * lacks < 0.0 => stands = false,
                Some(before) if before.abs() <= lacks.abs() => {}
                _ => lacks_kpa = Some(lacks),
            }
        }
        self.in_a_row = if stands { self.in_a_row.saturating_add(1) } else { 0 };
        lacks_kpa.filter(|_| self.in_a_row >= TICKS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ticks until a reading counts as standing that makes `actual` of what is foreseen of it, kPa a tick.
    fn found(actual_kpa: f64, foreseen_kpa: f64, share: f64) -> Option<u32> {
        let mut standing = Standing::new(28.0);
        (1..200).find(|_| standing.push([Way { actual_kpa, foreseen_kpa }; 2], share).is_some())
    }

    #[test]
    fn a_reading_that_stands_where_it_must_go_on_is_found_in_half_a_second() {
        assert_eq!(found(0.0, 1.5, 1.0), Some(LONG as u32 + TICKS - 1));
        assert_eq!(found(0.1, 1.5, 0.5), Some(LONG as u32 + TICKS - 1));
    }

    #[test]
    fn what_moves_as_a_slow_rig_and_what_rests_near_its_model_does_not_stand() {
        assert_eq!(found(0.15, 1.5, 0.1), None, "ten times as slow");
        assert_eq!(found(0.0, 1.1, 1.0), None, "27 kPa in half a second: another rig");
        assert_eq!(found(1.0, 1.5, 1.0), None, "on its way");
    }

    #[test]
    fn two_commands_that_disagree_about_where_it_goes_say_nothing() {
        let mut standing = Standing::new(28.0);
        let ways = [3.0, -3.0].map(|foreseen_kpa| Way { actual_kpa: 0.0, foreseen_kpa });
        assert!((0..200).all(|_| standing.push(ways, 1.0).is_none()));
    }
}

//! Learning from flights of several references: each is kept by itself, so that coming back to one does not begin anew.
//!
//! All room is taken beforehand. Where a reference comes that is not known, the one that was followed longest ago is forgotten for
//! it. All of it belongs to one model; another one begins with [`Repetitions::new`].

use model::observation::{AHEAD, Pair};

use crate::repetition::{Left, Repetition};

/// References that are known at a time: 700 kB each.
pub const KEPT_REFERENCES: usize = 4;

/// Knowledge of one reference.
#[derive(Debug, Clone)]
struct Kept {
    /// [`proto::reference::Reference::identity`]; `None` while the place is free.
    reference: Option<u64>,
    /// Number of the turn in which it was followed last.
    turn: u64,
    learned: Repetition,
}

/// Learning from flights of up to [`KEPT_REFERENCES`] references, and which of them is flown.
#[derive(Debug, Clone)]
pub struct Repetitions {
    kept: [Kept; KEPT_REFERENCES],
    flown: usize,
    turn: u64,
}

impl Repetitions {
    /// Room for several references, `empty` being what is known of each: nothing. Takes [`KEPT_REFERENCES`] times its memory.
    pub fn new(empty: &Repetition) -> Self {
        let free = || Kept { reference: None, turn: 0, learned: empty.clone() };
        Repetitions { kept: std::array::from_fn(|_| free()), flown: 0, turn: 0 }
    }

    /// Goes on with what is known of a reference, by its identity; with nothing where it has not been flown, or too long ago.
    ///
    /// # Real-time
    /// Bounded (480 kB written where another is forgotten for it), allocation-free: may run in the tick.
    pub fn choose(&mut self, reference: u64) {
        let known = self.kept.iter().position(|kept| kept.reference == Some(reference));
        let oldest = || (0..KEPT_REFERENCES).min_by_key(|place| self.kept.get(*place).map(|kept| kept.turn));
        self.flown = known.or_else(oldest).unwrap_or(0);
        self.turn += 1;
        if let Some(kept) = self.kept.get_mut(self.flown) {
            kept.turn = self.turn;
            if known.is_none() {
                kept.learned.forget();
                kept.reference = Some(reference);
            }
        }
    }

    /// Flights of the reference that were learned from; those that taught play count as one.
    pub fn flights(&self) -> usize {
        self.kept.get(self.flown).map_or(0, |kept| kept.learned.flights())
    }

    /// Begins a flight of the reference: [`Repetition::begin`].
    ///
    /// # Real-time
    /// Bounded, allocation-free: may run in the tick.
    pub fn begin(&mut self, period_ticks: Option<u32>) {
        if let Some(kept) = self.kept.get_mut(self.flown) {
            kept.learned.begin(period_ticks);
        }
    }

    /// Duties to be added in this tick and the next ones: [`Repetition::learned`].
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn learned(&self) -> Option<[Pair; AHEAD + 1]> {
        self.kept.get(self.flown)?.learned.learned()
    }

    /// Takes in what this tick left: [`Repetition::follow`].
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn follow(&mut self, left: &Left) {
        if let Some(kept) = self.kept.get_mut(self.flown) {
            kept.learned.follow(left);
        }
    }
}

#[cfg(test)]
mod tests {
    use model::valve_path::ValvePath;

    use super::*;

    const SOME: Left = Left { error_kpa: [Some(0.5), Some(0.2)], gain_kpa_per_s: [-150.0, 90.0] };

    /// Flies a reference so many times, each 200 ticks long.
    fn fly(repetitions: &mut Repetitions, reference: u64, flights: usize) {
        repetitions.choose(reference);
        for _ in 0..flights {
            repetitions.begin(None);
            (0..200).for_each(|_| repetitions.follow(&SOME));
        }
        repetitions.begin(None);
    }

    fn none_known() -> Repetitions {
        Repetitions::new(&Repetition::new(&[ValvePath::default(), ValvePath::default()], [3.0; 2]))
    }

    #[test]
    fn a_reference_that_is_flown_again_goes_on_where_it_was() {
        let mut repetitions = none_known();
        fly(&mut repetitions, 1, 20);
        let (flights, learned) = (repetitions.flights(), repetitions.learned());
        assert!(flights > 1 && learned.is_some_and(|duty| duty[0][0] != 0.0));
        repetitions.choose(2);
        assert_eq!((repetitions.flights(), repetitions.learned()), (0, None), "another one begins with nothing");
        fly(&mut repetitions, 2, 3);
        repetitions.choose(1);
        assert_eq!((repetitions.flights(), repetitions.learned()), (flights, learned));
    }

    #[test]
    fn the_one_flown_longest_ago_is_forgotten_for_a_new_one() {
        let mut repetitions = none_known();
        (1..=KEPT_REFERENCES as u64).for_each(|reference| fly(&mut repetitions, reference, 20));
        repetitions.choose(1);
        repetitions.choose(99);
        repetitions.choose(1);
        assert!(repetitions.flights() > 0, "the first was flown again before the new one came");
        repetitions.choose(2);
        assert_eq!(repetitions.flights(), 0);
    }
}

//! The conditions that hold in a tick, with the number behind each.

use crate::condition::{Condition, Severity};

/// Room for the number behind every condition.
const PLACES: usize = 64;

/// A set of conditions, each with the number that a person is told: volts, kPa, ms, a count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConditionSet {
    bits: u64,
    values: [f64; PLACES],
}

impl ConditionSet {
    /// Nothing is wrong.
    pub const EMPTY: ConditionSet = ConditionSet { bits: 0, values: [0.0; PLACES] };

    /// Adds a condition; a value that is there already stays.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn insert(&mut self, condition: Condition, value: f64) {
        let rank = condition.rank();
        if !self.contains(condition)
            && let Some(slot) = self.values.get_mut(rank)
        {
            *slot = value;
            self.bits |= 1 << rank;
        }
    }

    /// Takes a condition out.
    pub fn remove(&mut self, condition: Condition) {
        self.bits &= !(1 << condition.rank());
    }

    /// Tells whether it is there.
    pub fn contains(&self, condition: Condition) -> bool {
        self.bits & (1 << condition.rank()) != 0
    }

    /// Tells whether nothing is there.
    pub fn is_empty(&self) -> bool {
        self.bits == 0
    }

    /// One bit per condition, by its [code](Condition::code): what recordings carry, whatever conditions come to be.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn code_bits(&self) -> u64 {
        self.iter().fold(0, |bits, condition| bits | 1 << condition.code())
    }

    /// The conditions that [`ConditionSet::code_bits`] came from, each with 0 behind it; bits that are no code's are left out.
    pub fn from_code_bits(bits: u64) -> Self {
        let mut set = Self::EMPTY;
        let found = Condition::ALL.iter().filter(|condition| bits & 1 << condition.code() != 0);
        found.for_each(|condition| set.insert(*condition, 0.0));
        set
    }

    /// The number behind a condition; 0 where it is not there.
    pub fn value(&self, condition: Condition) -> f64 {
        if self.contains(condition) { self.values.get(condition.rank()).copied().unwrap_or(0.0) } else { 0.0 }
    }

    /// The worst condition of at least this severity.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn worst(&self, at_least: Severity) -> Option<Condition> {
        let top = PLACES.checked_sub(1 + self.bits.leading_zeros() as usize)?;
        let worst = *Condition::ALL.get(top)?;
        (worst.severity() >= at_least).then_some(worst)
    }

    /// The conditions, from the least to the worst.
    pub fn iter(&self) -> impl Iterator<Item = Condition> + '_ {
        Condition::ALL.iter().copied().filter(|c| self.contains(*c))
    }
}

impl Default for ConditionSet {
    fn default() -> Self {
        ConditionSet::EMPTY
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::memory::Memory;

    #[test]
    fn the_worst_is_the_last_of_the_list() {
        let mut set = ConditionSet::EMPTY;
        assert_eq!(set.worst(Severity::Warning), None);
        for condition in Condition::ALL {
            set.insert(*condition, 1.0);
            assert_eq!(set.worst(Severity::Warning), Some(*condition));
        }
        assert_eq!(set.iter().count(), Condition::ALL.len());
        for condition in Condition::ALL.iter().rev() {
            assert_eq!(set.worst(condition.severity()), Some(*condition));
            set.remove(*condition);
        }
        assert!(set.is_empty());
    }

    /// Arming is barred by a recorded tick's conditions as it was in the tick, of two as well.
    #[test]
    fn recorded_conditions_bar_as_those_of_the_tick() {
        let bars: Vec<Condition> =
            Condition::ALL.iter().copied().filter(|condition| condition.severity() == Severity::BarsArming).collect();
        assert!(bars.len() > 1, "{bars:?}");
        for (one, other) in bars.iter().zip(&bars[1..]) {
            let mut set = ConditionSet::EMPTY;
            set.insert(*other, 0.0);
            set.insert(*one, 0.0);
            let recorded = ConditionSet::from_code_bits(set.code_bits());
            assert_eq!(recorded, set);
            let barred = Memory::bars_arming(&recorded);
            assert!(barred.is_some() && barred == Memory::bars_arming(&set), "{one:?} and {other:?}: {barred:?}");
        }
        for condition in Condition::ALL {
            assert!(ConditionSet::from_code_bits(1 << condition.code()).contains(*condition), "{condition:?}");
        }
    }

    #[test]
    fn the_first_number_stays() {
        let mut set = ConditionSet::EMPTY;
        set.insert(Condition::OverPressure, 161.0);
        set.insert(Condition::OverPressure, 165.0);
        assert_eq!((set.value(Condition::OverPressure), set.value(Condition::OverVacuum)), (161.0, 0.0));
    }
}

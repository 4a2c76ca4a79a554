//! Conditions that wait for a person, all of them, as a status carries them and as they are told.

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use supervisor::{Condition, ConditionSet};

/// Set of the conditions that wait for `controller acknowledge`; in JSON their names, the worst first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LatchedConditions {
    /// One bit per condition, by its code.
    code_bits: u64,
}

impl LatchedConditions {
    /// Nothing waits.
    pub const NONE: LatchedConditions = LatchedConditions { code_bits: 0 };

    /// The set of these.
    pub fn of(conditions: impl IntoIterator<Item = Condition>) -> Self {
        let code_bits = conditions.into_iter().fold(0, |bits, condition| bits | 1 << condition.code());
        LatchedConditions { code_bits }
    }

    /// Tells whether nothing waits.
    pub fn is_empty(self) -> bool {
        self.code_bits == 0
    }

    /// Those that are not in the other set.
    #[must_use]
    pub fn without(self, other: LatchedConditions) -> Self {
        LatchedConditions { code_bits: self.code_bits & !other.code_bits }
    }

    /// The set as the number that an event carries.
    pub fn to_number(self) -> f64 {
        self.code_bits as f64
    }

    /// The set that [`LatchedConditions::to_number`] made a number of.
    pub fn from_number(number: f64) -> Self {
        LatchedConditions { code_bits: number as u64 }
    }

    /// The conditions, the worst first.
    pub fn iter(self) -> impl Iterator<Item = Condition> {
        Condition::ALL.iter().rev().copied().filter(move |condition| self.code_bits & 1 << condition.code() != 0)
    }

    /// Their names, the worst first, as in a list: `cRIO tripped, negative sensor broken`.
    pub fn names(self) -> String {
        self.iter().map(Condition::name).collect::<Vec<_>>().join(", ")
    }

    /// A clause that says that they wait: `` `cRIO tripped` and `negative sensor broken` wait ``.
    pub fn wait(self) -> String {
        let names: Vec<String> = self.iter().map(|condition| format!("`{}`", condition.name())).collect();
        let verb = if names.len() == 1 { "waits" } else { "wait" };
        format!("{} {verb}", names.join(" and "))
    }
}

impl From<&ConditionSet> for LatchedConditions {
    /// Runs in the tick.
    fn from(set: &ConditionSet) -> Self {
        LatchedConditions { code_bits: set.code_bits() }
    }
}

impl Serialize for LatchedConditions {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.iter())
    }
}

impl<'de> Deserialize<'de> for LatchedConditions {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Ok(Self::of(Vec::<Condition>::deserialize(deserializer)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_are_there_in_text_and_in_json_the_worst_first() {
        let all = LatchedConditions::of(Condition::ALL.iter().copied());
        assert!(all.iter().eq(Condition::ALL.iter().rev().copied()));
        let two = LatchedConditions::of([Condition::SensorNegative, Condition::CrioTripped]);
        assert_eq!(two.names(), "cRIO tripped, negative sensor broken");
        assert_eq!(two.wait(), "`cRIO tripped` and `negative sensor broken` wait");
        assert_eq!(serde_json::to_string(&two).unwrap(), r#"["crio_tripped","sensor_negative"]"#);
        for set in [all, two, LatchedConditions::NONE] {
            assert_eq!(LatchedConditions::from_number(set.to_number()), set, "a number holds 53 codes");
            assert_eq!(serde_json::from_str::<LatchedConditions>(&serde_json::to_string(&set).unwrap()).unwrap(), set);
        }
        assert_eq!(two.without(LatchedConditions::of([Condition::CrioTripped])).names(), "negative sensor broken");
    }
}

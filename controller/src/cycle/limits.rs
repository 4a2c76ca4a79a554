//! Readings and trips of a frame that need no model: broken sensors, the limits, what the cRIO says itself.
//!
//! One frame decides them. So they are judged in every frame that comes, also in one that is never answered because a newer
//! one came before this program could run.

use model::observation::CHANNELS;
use monitor::Monitor;
use proto::wire::{CrioState, Sense, TripBits};
use supervisor::{Condition, ConditionSet};

use super::Cycle;
use crate::cycle::duty_source::DutySource;

/// Conditions that one frame decides, and [`Cycle::overtaken`] finds.
pub(crate) const OF_ONE_FRAME: [Condition; 9] = [
    Condition::SensorPositive,
    Condition::SensorNegative,
    Condition::OverPressure,
    Condition::OverVacuum,
    Condition::CommandsLost,
    Condition::CrioTripped,
    Condition::RangePositive,
    Condition::RangeNegative,
    Condition::TripBits,
];

impl<H: DutySource> Cycle<H> {
    /// Takes in a frame that a newer one has overtaken before it could be answered: what it decides alone counts in the tick of
    /// the newer one, which everything else goes by.
    ///
    /// # Real-time
    /// Runs in the tick.
    pub fn overtaken(&mut self, sense: &Sense) {
        let mut found = std::mem::take(&mut self.reported);
        let readings_kpa = self.read(sense, &mut found);
        check_trips(sense, &mut found);
        Monitor::judge_alone(sense, readings_kpa, &mut found);
        self.reported = found;
    }

    /// Readings, with broken sensors and limits among the conditions.
    pub(super) fn read(&self, sense: &Sense, found: &mut ConditionSet) -> [Option<f64>; CHANNELS] {
        let readings = self.sensing.readings_kpa(&sense.volts);
        for (c, broken) in [Condition::SensorPositive, Condition::SensorNegative].into_iter().enumerate() {
            if let Err(sensor) = readings[c] {
                found.insert(broken, sensor.volts);
            }
        }
        let readings = readings.map(Result::ok);
        if let [Some(positive), _] = readings
            && positive > self.safety.max_pos_kpa
        {
            found.insert(Condition::OverPressure, positive);
        }
        if let [_, Some(negative)] = readings
            && negative < self.safety.min_neg_kpa
        {
            found.insert(Condition::OverVacuum, negative);
        }
        readings
    }
}

/// Trips of the cRIO among the conditions.
pub(super) fn check_trips(sense: &Sense, found: &mut ConditionSet) {
    if sense.state == CrioState::Tripped {
        let ours = sense.trips == TripBits::COMMAND_LOST;
        let cause = if ours { Condition::CommandsLost } else { Condition::CrioTripped };
        found.insert(cause, f64::from(sense.trips.bits()));
    }
}

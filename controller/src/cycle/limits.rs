//! Readings and trips of a frame that need no model: broken sensors, the limits, what the cRIO says itself.

use model::observation::CHANNELS;
use proto::wire::{CrioState, Sense, TripBits};
use supervisor::Condition;

use super::Cycle;
use crate::cycle::duty_source::DutySource;

impl<H: DutySource> Cycle<H> {
    /// Readings, with broken sensors and limits among the conditions.
    pub(super) fn read(&mut self, sense: &Sense) -> [Option<f64>; CHANNELS] {
        let readings = self.sensing.readings_kpa(&sense.volts);
        for (c, broken) in [Condition::SensorPositive, Condition::SensorNegative].into_iter().enumerate() {
            if let Err(found) = readings[c] {
                self.conditions.insert(broken, found.volts);
            }
        }
        let readings = readings.map(Result::ok);
        if let [Some(positive), _] = readings
            && positive > self.safety.max_pos_kpa
        {
            self.conditions.insert(Condition::OverPressure, positive);
        }
        if let [_, Some(negative)] = readings
            && negative < self.safety.min_neg_kpa
        {
            self.conditions.insert(Condition::OverVacuum, negative);
        }
        readings
    }

    /// Trips of the cRIO among the conditions.
    pub(super) fn check_trips(&mut self, sense: &Sense) {
        if sense.state == CrioState::Tripped {
            let ours = sense.trips == TripBits::COMMAND_LOST;
            let cause = if ours { Condition::CommandsLost } else { Condition::CrioTripped };
            self.conditions.insert(cause, f64::from(sense.trips.bits()));
        }
    }
}

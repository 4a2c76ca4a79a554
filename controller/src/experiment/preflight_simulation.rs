//! Simulation of a sequence by the model, before anything moves.
//!
//! The rig file's own plant is driven as the cRIO would be: vents open until it stands, then the rows. The
//! sequence is refused where a reading of that simulation leaves the daemon's safety envelope; the rig itself is
//! watched all the same while it is played.

use model::observation::{CHANNELS, Pair};
use model::rig::{Rig, RigError};
use proto::emulator::rig_and_crio;
use proto::recording::PERIOD_S;

use crate::config::Safety;
use crate::cycle::duty_source::VENT;
use crate::experiment::command_sequence::CommandSequence;
use crate::experiment::pump_relay::PumpRelay;

/// Ticks of vents open before the first row: 20 s, for a pump without a relay to find its balance.
const SETTLE: u32 = 1_000;

/// Forecast of the model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Forecast {
    /// Least and largest reading of each channel, in kPa gauge.
    pub range_kpa: [[f64; 2]; CHANNELS],
    /// Relay of the model's pump.
    pub relay: PumpRelay,
}

/// Reason why a sequence must not be played.
#[derive(Debug, thiserror::Error)]
pub enum ForecastError {
    /// The model cannot be simulated at the cRIO's rate.
    #[error("rig {name}: {problem}")]
    Rig {
        /// The model's rig.
        name: String,
        /// Reason.
        problem: RigError,
    },
    /// The model leaves the envelope.
    #[error(
        "{file}: line {line}: by the model {rig} the {side} pressure passes safety.{key} = {limit_kpa} kPa at {first_s:.2} s and goes to {farthest_kpa:.1} kPa at {farthest_s:.2} s; nothing was moved: set rig.file to the rig that planned it, or change the commands"
    )]
    Beyond {
        /// The sequence.
        file: String,
        /// Line of the command that does it, from 1.
        line: u64,
        /// The model's rig.
        rig: String,
        /// Chamber.
        side: &'static str,
        /// The limit's key.
        key: &'static str,
        /// The limit (kPa gauge).
        limit_kpa: f64,
        /// Time at which it is passed, from the first row (s).
        first_s: f64,
        /// The farthest reading (kPa gauge).
        farthest_kpa: f64,
        /// Time (s).
        farthest_s: f64,
    },
    /// The model has no finite answer.
    #[error("{file}: line {line}: the model {rig} has no finite pressures from here on; check the rig file")]
    Diverges {
        /// The sequence.
        file: String,
        /// Line of the command, from 1.
        line: u64,
        /// The model's rig.
        rig: String,
    },
}

/// Simulates a sequence on the model's rig, from rest.
///
/// # Errors
/// The rig cannot be simulated, or a pressure leaves the envelope: when, and how far.
pub fn preflight_simulation(rig: &Rig, sequence: &CommandSequence, safety: Safety) -> Result<Forecast, ForecastError> {
    let (mut plant, crio) =
        rig_and_crio(rig).map_err(|problem| ForecastError::Rig { name: rig.name.clone(), problem })?;
    for _ in 0..SETTLE {
        plant.tick(VENT, false);
    }
    let mut readings: Vec<Pair> = vec![plant.readings_kpa()];
    for (number, row) in sequence.rows().iter().enumerate() {
        plant.tick(row.duty, row.pump_on);
        let now = plant.readings_kpa();
        if !now.iter().all(|kpa| kpa.is_finite()) {
            let (file, line) = (sequence.source().to_owned(), sequence.line(number));
            return Err(ForecastError::Diverges { file, line, rig: rig.name.clone() });
        }
        readings.push(now);
    }
    // Above a limit is positive in both: the negative channel is mirrored.
    let limits = [
        ("positive", "max_pos_kpa", safety.max_pos_kpa, 0, 1.0),
        ("negative", "min_neg_kpa", safety.min_neg_kpa, 1, -1.0),
    ];
    let beyond = limits.into_iter().filter_map(|(side, key, limit_kpa, channel, sign)| {
        let excess = |reading: &Pair| sign * (reading[channel] - limit_kpa);
        let first = readings.iter().position(|reading| excess(reading) > 0.0)?;
        let farthest =
            (first..readings.len()).max_by(|a, b| excess(&readings[*a]).total_cmp(&excess(&readings[*b])))?;
        let error = ForecastError::Beyond {
            file: sequence.source().to_owned(),
            // The reading at k was made by the command of row k − 1.
            line: sequence.line(first.saturating_sub(1)),
            rig: rig.name.clone(),
            side,
            key,
            limit_kpa,
            first_s: first as f64 * PERIOD_S,
            farthest_kpa: readings.get(farthest).map_or(f64::NAN, |reading| reading[channel]),
            farthest_s: farthest as f64 * PERIOD_S,
        };
        Some((first, error))
    });
    if let Some((_, error)) = beyond.min_by_key(|(first, _)| *first) {
        return Err(error);
    }
    let range_kpa = std::array::from_fn(|c| {
        let of = |start: f64, pick: fn(f64, f64) -> f64| readings.iter().map(|r| r[c]).fold(start, pick);
        [of(f64::INFINITY, f64::min), of(f64::NEG_INFINITY, f64::max)]
    });
    Ok(Forecast { range_kpa, relay: PumpRelay::of(&crio) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sequence(seconds: u32, duty: f64) -> CommandSequence {
        let rows: String = (0..50 * seconds).map(|k| format!("{:.2},{duty},{duty}\n", f64::from(k) * 0.02)).collect();
        CommandSequence::parse("e.csv", format!("time_s,u_pos,u_neg\n{rows}").into_bytes()).unwrap()
    }

    #[test]
    fn shut_valves_are_refused_with_time_and_place_and_open_ones_are_not() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let open = preflight_simulation(&rig, &sequence(10, 0.85), Safety::default()).unwrap();
        let [[least, most], [lowest, _]] = open.range_kpa;
        assert!(
            open.relay == PumpRelay::Fitted && least >= 0.0 && (60.0..130.0).contains(&most) && lowest < -50.0,
            "{open:?}"
        );
        // A suction line that is shut is emptied.
        let refused = preflight_simulation(&rig, &sequence(10, 0.0), Safety::default()).unwrap_err();
        let ForecastError::Beyond { first_s, farthest_kpa, farthest_s, line, .. } = &refused else {
            panic!("{refused}")
        };
        assert!(*farthest_kpa < -95.0 && farthest_s > first_s, "{refused}");
        // Line 2 is row 0, whose command makes the reading at 0.02 s.
        assert_eq!(*line, (first_s / 0.02).round() as u64 + 1, "{refused}");
        assert!(!refused.to_string().contains('\n'));
    }

    #[test]
    fn the_envelope_is_the_configurations() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let most = preflight_simulation(&rig, &sequence(10, 0.85), Safety::default()).unwrap().range_kpa[0][1];
        let tight = Safety { max_pos_kpa: most - 1.0, ..Safety::default() };
        assert!(matches!(
            preflight_simulation(&rig, &sequence(10, 0.85), tight),
            Err(ForecastError::Beyond { key: "max_pos_kpa", .. })
        ));
    }
}

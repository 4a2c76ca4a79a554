//! Names, units and ranges of a policy's observations and answers, in the order of `model::observation`.
//!
//! The controller compares them one by one with its own list and refuses a policy whose channels are others or in
//! another order. Ranges are what the rig can produce (the safety envelope for pressures); for an answer they are what
//! the law takes.

use crate::observation::{AHEAD, CORRECTION_LIMIT, GOALS_AHEAD, ObservationLayout, PAST, TICKS_PER_S};

/// Pressures: positive, negative (kPa gauge).
const PRESSURE_KPA: [(f32, f32); 2] = [(0.0, 160.0), (-95.0, 0.0)];
/// A duty: 0 is shut, 1 is vent.
const DUTY: (f32, f32) = (0.0, 1.0);
/// The fallback's integral part, in duty.
const INTEGRAL_DUTY: (f32, f32) = (-1.0, 1.0);
/// Range of what the fallback adds to undo play, in duty.
const PLAY_DUTY: (f32, f32) = (-0.1, 0.1);
/// Half width of play that the fallback has learned, in duty.
const WIDTH_DUTY: (f32, f32) = (0.0, 0.1);
/// Range of a duty's way since it last turned round.
const TRAVEL_DUTY: (f32, f32) = (-0.15, 0.15);

/// One observation or answer.
#[derive(Debug, Clone, PartialEq)]
pub struct Port {
    /// Quantity, side and tick, for example `p_pos[-10]`.
    pub name: String,
    /// `kPa gauge` or `duty`.
    pub unit: &'static str,
    /// Lowest value.
    pub low: f32,
    /// Highest value.
    pub high: f32,
}

/// All observations and answers of a contract.
#[derive(Debug, Clone, PartialEq)]
pub struct Ports {
    /// The contract's version.
    pub contract: u32,
    /// Ticks per second.
    pub rate_hz: f64,
    /// Observations, in the order of the tensor.
    pub inputs: Vec<Port>,
    /// Answers, in the order of the tensor.
    pub outputs: Vec<Port>,
}

impl Ports {
    /// The ports of a contract.
    pub fn of(contract: ObservationLayout) -> Self {
        let (past, ahead, goals) = (PAST as i32, AHEAD as i32, GOALS_AHEAD as i32);
        let mut inputs = Vec::new();
        trajectory(&mut inputs, "p", -past..=ahead, "kPa gauge", PRESSURE_KPA);
        trajectory(&mut inputs, "ref", -past..=goals, "kPa gauge", PRESSURE_KPA);
        let mut outputs = Vec::new();
        match contract {
            ObservationLayout::Paper => trajectory(&mut outputs, "u", 0..=ahead, "duty", [DUTY; 2]),
            ObservationLayout::Correction => {
                trajectory(&mut inputs, "applied", -past..=-1, "duty", [DUTY; 2]);
                trajectory(&mut inputs, "base", 0..=ahead, "duty", [DUTY; 2]);
                inputs.extend(pair("integral", "", "duty", [INTEGRAL_DUTY; 2]));
                inputs.extend(pair("play", "", "duty", [PLAY_DUTY; 2]));
                inputs.extend(pair("width", "", "duty", [WIDTH_DUTY; 2]));
                inputs.extend(pair("travel", "", "duty", [TRAVEL_DUTY; 2]));
                let most = CORRECTION_LIMIT as f32;
                trajectory(&mut outputs, "du", 0..=ahead, "duty", [(-most, most); 2]);
            }
        }
        Ports { contract: contract.version(), rate_hz: TICKS_PER_S, inputs, outputs }
    }
}

/// A quantity over ticks, oldest first: positive and negative side of each tick.
fn trajectory(
    ports: &mut Vec<Port>,
    quantity: &str,
    ticks: std::ops::RangeInclusive<i32>,
    unit: &'static str,
    range: [(f32, f32); 2],
) {
    ports.extend(ticks.flat_map(|j| pair(quantity, &format!("[{j}]"), unit, range)));
}

/// The positive and the negative side of a quantity.
fn pair(quantity: &str, tick: &str, unit: &'static str, range: [(f32, f32); 2]) -> [Port; 2] {
    let side = |side, (low, high)| Port { name: format!("{quantity}_{side}{tick}"), unit, low, high };
    [side("pos", range[0]), side("neg", range[1])]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observation::{ACTION_LEN, CORRECTION_OBSERVATION_LEN, OBSERVATION_LEN};

    #[test]
    fn lengths_are_the_models() {
        for contract in [ObservationLayout::Paper, ObservationLayout::Correction] {
            let ports = Ports::of(contract);
            assert_eq!((ports.inputs.len(), ports.outputs.len()), (contract.observation_len(), ACTION_LEN));
        }
    }

    /// Both ends of every group of the two tables in `model::observation`.
    #[test]
    fn groups_begin_and_end_where_the_tables_say() {
        let ports = Ports::of(ObservationLayout::Correction);
        let at = |i: usize| ports.inputs[i].name.as_str();
        let ends = [0, 21, 22, 31, 32, OBSERVATION_LEN - 1, 84, 103, 104, 115, 116, 117, 118, 119, 120, 123].map(at);
        assert_eq!(
            ends,
            [
                "p_pos[-10]",
                "p_neg[0]",
                "p_pos[1]",
                "p_neg[5]",
                "ref_pos[-10]",
                "ref_neg[15]",
                "applied_pos[-10]",
                "applied_neg[-1]",
                "base_pos[0]",
                "base_neg[5]",
                "integral_pos",
                "integral_neg",
                "play_pos",
                "play_neg",
                "width_pos",
                "travel_neg"
            ]
        );
        assert_eq!(ports.inputs[..OBSERVATION_LEN], Ports::of(ObservationLayout::Paper).inputs);
        assert_eq!(ports.inputs.len(), CORRECTION_OBSERVATION_LEN);
        assert_eq!(ports.outputs[11], Port { name: "du_neg[5]".into(), unit: "duty", low: -0.25, high: 0.25 });
        assert_eq!(Ports::of(ObservationLayout::Paper).outputs[0].name, "u_pos[0]");
    }
}

//! The observation contracts of `model::contract`, in the words of the policy loader.
//!
//! Every value has a name, a unit and the range over which policies are probed: what the rig and the fallback can
//! produce. An answer's range is what the law takes.

use std::ops::RangeInclusive;

use model::contract::{AHEAD, CHANNELS, CORRECTION_LIMIT, GOALS_AHEAD, PAST, TICKS_PER_S};
use policy::{Channel, Contract};

/// Unit and range of one side of a quantity.
type Scale = (&'static str, f32, f32);

/// Positive, negative pressure within the safety envelope.
const PRESSURE: [Scale; CHANNELS] = [("kPa gauge", 0.0, 160.0), ("kPa gauge", -95.0, 0.0)];
const DUTY: [Scale; CHANNELS] = [("duty", 0.0, 1.0); CHANNELS];
/// The fallback's integral part can turn its duty from one end to the other.
const INTEGRAL: [Scale; CHANNELS] = [("duty", -1.0, 1.0); CHANNELS];
/// The fallback undoes 0.06 of play at most; a policy is to bear a little more.
const PLAY: [Scale; CHANNELS] = [("duty", -0.1, 0.1); CHANNELS];
const CORRECTION: [Scale; CHANNELS] = [("duty", -CORRECTION_LIMIT as f32, CORRECTION_LIMIT as f32); CHANNELS];

/// All that this program flies, the paper's first.
pub fn offered() -> [Contract; 2] {
    [version_1(), version_2()]
}

/// Version 1: the paper's 84 observations and 12 duties.
pub fn version_1() -> Contract {
    contract(model::contract::Contract::Paper, observed(), trajectory("u", 0..=ahead(), DUTY).collect())
}

/// Version 2: besides these the duties applied and the fallback's own; 12 corrections of the latter.
pub fn version_2() -> Contract {
    let mut inputs = observed();
    inputs.extend(trajectory("applied", -(PAST as i32)..=-1, DUTY));
    inputs.extend(trajectory("base", 0..=ahead(), DUTY));
    inputs.extend(pair("integral", "", INTEGRAL));
    inputs.extend(pair("play", "", PLAY));
    contract(model::contract::Contract::Correction, inputs, trajectory("du", 0..=ahead(), CORRECTION).collect())
}

fn contract(which: model::contract::Contract, inputs: Vec<Channel>, outputs: Vec<Channel>) -> Contract {
    Contract { version: which.version(), rate_hz: TICKS_PER_S, inputs, outputs }
}

fn ahead() -> i32 {
    AHEAD as i32
}

/// State and goals of both contracts.
fn observed() -> Vec<Channel> {
    let past = PAST as i32;
    trajectory("p", -past..=ahead(), PRESSURE).chain(trajectory("ref", -past..=GOALS_AHEAD as i32, PRESSURE)).collect()
}

/// A quantity over ticks, oldest first.
fn trajectory(
    quantity: &'static str,
    ticks: RangeInclusive<i32>,
    scale: [Scale; CHANNELS],
) -> impl Iterator<Item = Channel> {
    ticks.flat_map(move |j| pair(quantity, &format!("[{j}]"), scale))
}

/// The positive and the negative side of a quantity.
fn pair(quantity: &str, tick: &str, scale: [Scale; CHANNELS]) -> [Channel; CHANNELS] {
    let side = |side: &str, (unit, low, high): Scale| Channel {
        name: format!("{quantity}_{side}{tick}"),
        unit: unit.to_owned(),
        low,
        high,
    };
    [side("pos", scale[0]), side("neg", scale[1])]
}

/// The trainer's list, which its exports carry. Trainer and controller do not depend on each other, so the tests read
/// in the file itself, which needs the model alone.
#[cfg(test)]
#[allow(unreachable_pub)]
#[path = "../../trainer/onnx/src/ports.rs"]
mod ports;

#[cfg(test)]
mod tests {
    use super::*;
    use model::contract::{ACTION_LEN, Contract as Which};

    #[test]
    fn has_the_models_lengths() {
        for (contract, which) in offered().iter().zip([Which::Paper, Which::Correction]) {
            assert_eq!((contract.inputs.len(), contract.outputs.len()), (which.observation_len(), ACTION_LEN));
            assert_eq!(contract.version, which.version());
        }
    }

    #[test]
    fn names_and_units_stand_where_the_models_tables_say() {
        let contract = version_2();
        let told = [0, 21, 22, 32, 83, 84, 103, 104, 115, 116, 119].map(|i| {
            let Channel { name, unit, low, high } = &contract.inputs[i];
            (name.as_str(), unit.as_str(), *low, *high)
        });
        let expected = [
            ("p_pos[-10]", "kPa gauge", 0.0, 160.0),
            ("p_neg[0]", "kPa gauge", -95.0, 0.0),
            ("p_pos[1]", "kPa gauge", 0.0, 160.0),
            ("ref_pos[-10]", "kPa gauge", 0.0, 160.0),
            ("ref_neg[15]", "kPa gauge", -95.0, 0.0),
            ("applied_pos[-10]", "duty", 0.0, 1.0),
            ("applied_neg[-1]", "duty", 0.0, 1.0),
            ("base_pos[0]", "duty", 0.0, 1.0),
            ("base_neg[5]", "duty", 0.0, 1.0),
            ("integral_pos", "duty", -1.0, 1.0),
            ("play_neg", "duty", -0.1, 0.1),
        ];
        assert_eq!(told, expected);
        assert_eq!(contract.inputs[..84], version_1().inputs);
        let answer = &contract.outputs[11];
        assert_eq!((answer.name.as_str(), answer.low, answer.high), ("du_neg[5]", -0.25, 0.25));
        let answer = &version_1().outputs[11];
        assert_eq!((answer.name.as_str(), answer.low, answer.high), ("u_neg[5]", 0.0, 1.0));
    }

    /// Every name, unit and range that the trainer exports is the one that is checked here.
    #[test]
    fn the_trainers_list_is_the_same() {
        for (contract, which) in offered().iter().zip([Which::Paper, Which::Correction]) {
            let theirs = ports::Ports::of(which);
            assert_eq!((contract.version, contract.rate_hz), (theirs.contract, theirs.rate_hz));
            for (ours, theirs) in [(&contract.inputs, &theirs.inputs), (&contract.outputs, &theirs.outputs)] {
                let theirs = theirs.iter().map(|p| (p.name.as_str(), p.unit, p.low, p.high));
                assert!(ours.iter().map(|c| (c.name.as_str(), c.unit.as_str(), c.low, c.high)).eq(theirs));
            }
        }
    }
}

//! The observation contract of `model::contract`, in the words of the policy loader.

use model::contract::{AHEAD, CHANNELS, GOALS_AHEAD, PAST, TICKS_PER_S};
use policy::{Channel, Contract};

/// Physical range that policies are probed over: positive, negative (kPa gauge).
const RANGE_KPA: [(f32, f32); CHANNELS] = [(0.0, 160.0), (-95.0, 0.0)];

/// Version 1: the paper's 84 observations and 12 actions.
pub fn version_1() -> Contract {
    let (past, ahead, goals) = (PAST as i32, AHEAD as i32, GOALS_AHEAD as i32);
    let channel = |name: String, side: usize| Channel {
        name,
        unit: "kPa gauge".into(),
        low: RANGE_KPA[side].0,
        high: RANGE_KPA[side].1,
    };
    let pair = |prefix: &'static str, j: i32| {
        ["pos", "neg"].into_iter().enumerate().map(move |(side, name)| (format!("{prefix}_{name}[{j}]"), side))
    };
    let state = (-past..=ahead).flat_map(|j| pair("p", j));
    let goal = (-past..=goals).flat_map(|j| pair("ref", j));
    let action = (0..=ahead).flat_map(|j| pair("u", j));
    Contract {
        version: 1,
        rate_hz: TICKS_PER_S,
        inputs: state.chain(goal).map(|(name, side)| channel(name, side)).collect(),
        outputs: action.map(|(name, _)| Channel { name, unit: "duty".into(), low: 0.0, high: 1.0 }).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::contract::{ACTION_LEN, OBSERVATION_LEN};

    #[test]
    fn has_the_models_lengths_and_names_in_order() {
        let contract = version_1();
        assert_eq!((contract.inputs.len(), contract.outputs.len()), (OBSERVATION_LEN, ACTION_LEN));
        let name = |i: usize| contract.inputs[i].name.as_str();
        assert_eq!(
            (name(0), name(21), name(22), name(32), name(83)),
            ("p_pos[-10]", "p_neg[0]", "p_pos[1]", "ref_pos[-10]", "ref_neg[15]")
        );
        assert_eq!(contract.outputs[11].name, "u_neg[5]");
    }
}

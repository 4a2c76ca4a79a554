//! Answers of a policy over the range of its observations, which show whether it looks at them at all.

use model::observation::{ACTION_LEN, AHEAD, GOALS_AHEAD, PAST};
use policy::Policy;
use serde::{Deserialize, Serialize};

use crate::draw::Draw;

/// Observations that are tried.
const OBSERVATIONS: usize = 1024;
/// Answers for the tick itself; the ten behind them are the plan.
const NOW: usize = 2;
/// Answers that vary by less than this (duty) are one answer: a hundredth of a percent of a valve's range.
const CONSTANT_DUTY: f32 = 1e-4;
/// By how much a pressure is moved to see what the duties do, in kPa.
const NUDGE_KPA: f32 = 1.0;
/// Pairs of pressures and of goals in the first layout.
const PRESSURES: usize = PAST + 1 + AHEAD;
const GOALS: usize = PAST + 1 + GOALS_AHEAD;
/// Places of the present pressures in either layout.
const PRESENT: [usize; 2] = [20, 21];

/// Goals and distances from them, in kPa gauge, at which a policy that answers duties is asked which way it would go: over
/// all of the operating range, also where a trial hardly comes.
const GOALS_KPA: [[f32; 2]; 4] = [[70.0, -60.0], [85.0, -70.0], [100.0, -75.0], [115.0, -80.0]];
const FAR_KPA: [[f32; 2]; 3] = [[8.0, 4.0], [15.0, 8.0], [35.0, 13.0]];
/// Least share of these places at which a pressure that is too high must open or shut its valve the right way.
const LEAST_RIGHT: f32 = 0.9;
/// The layout whose answers are duties; corrections fade out far from the goal, and the fallback goes its own way there.
const DUTIES: u32 = 1;

/// Figures of the answers for the present tick.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Answers {
    /// Lowest and highest answer of each valve.
    pub range_duty: [[f32; 2]; 2],
    /// Share of places far from the goal at which each valve goes the right way; 1 where corrections are answered.
    pub right_way: [f32; 2],
    /// Mean change of each valve's answer when its own present pressure is 1 kPa higher, in duty.
    pub per_kpa_duty: [f32; 2],
}

impl Answers {
    /// Asks a policy 1,024 times, on observations drawn over its ranges.
    pub fn of(policy: &mut Policy) -> Self {
        let signature = policy.contract().clone();
        let mut draw = Draw::new(7);
        let mut observation = vec![0.0_f32; signature.inputs.len()];
        let mut answers = vec![0.0_f32; signature.outputs.len()];
        let (mut range_duty, mut per_kpa_duty) = ([[f32::INFINITY, f32::NEG_INFINITY]; NOW], [0.0; NOW]);
        for _ in 0..OBSERVATIONS {
            for (value, channel) in observation.iter_mut().zip(&signature.inputs) {
                *value = channel.low + draw.unit() as f32 * (channel.high - channel.low);
            }
            // What is not finite the loader has ruled out on its own observations, and the trial sees it again.
            if policy.run(&observation, &mut answers).is_err() {
                continue;
            }
            let here = [answers[0], answers[1]];
            for (range, answer) in range_duty.iter_mut().zip(here) {
                *range = [range[0].min(answer), range[1].max(answer)];
            }
            for (valve, place) in PRESENT.into_iter().enumerate() {
                let Some(pressure) = observation.get_mut(place) else { continue };
                *pressure += NUDGE_KPA;
                if policy.run(&observation, &mut answers).is_ok() {
                    per_kpa_duty[valve] += (answers[valve] - here[valve]) / (NUDGE_KPA * OBSERVATIONS as f32);
                }
                if let Some(pressure) = observation.get_mut(place) {
                    *pressure -= NUDGE_KPA;
                }
            }
        }
        let right_way = if signature.version == DUTIES { right_way(policy) } else { [1.0; 2] };
        Answers { range_duty, right_way, per_kpa_duty }
    }

    /// Reason why the answers alone are reason enough not to fly the policy, one line.
    pub fn refusal(&self) -> Option<String> {
        let constant = |range: [f32; 2]| range[1] - range[0] < CONSTANT_DUTY;
        let [positive, negative] = self.range_duty;
        match (constant(positive), constant(negative)) {
            (true, true) => Some(format!(
                "gives the same answer ({:.3}, {:.3}) to all {OBSERVATIONS} observations; it does not look at the pressures",
                positive[0], negative[0]
            )),
            (true, false) => Some(format!(
                "gives the positive valve the same answer ({:.3}) to all {OBSERVATIONS} observations",
                positive[0]
            )),
            (false, true) => Some(format!(
                "gives the negative valve the same answer ({:.3}) to all {OBSERVATIONS} observations",
                negative[0]
            )),
            (false, false) => self.turned_round(),
        }
    }

    fn turned_round(&self) -> Option<String> {
        let sides = ["positive", "negative"].into_iter().zip(self.right_way);
        let mut wrong = sides.filter(|(_, share)| *share < LEAST_RIGHT);
        wrong.next().map(|(side, share)| {
            format!(
                "moves the {side} valve the wrong way at {:.0} % of places far from the goal: it must open against a chamber's excess and shut against its lack",
                100.0 * (1.0 - share)
            )
        })
    }
}

/// The share of places at which the answer for a pressure above the goal differs from that below it in the right direction.
fn right_way(policy: &mut Policy) -> [f32; 2] {
    let (mut right, mut places) = ([0.0; 2], 0.0);
    for goal in GOALS_KPA {
        for far in FAR_KPA {
            let mut asked = |sign: f32| -> Option<[f32; 2]> {
                // Both chambers off to the same side of their magnitudes: too much of either, or too little.
                let pressure = [goal[0] + sign * far[0], goal[1] - sign * far[1]];
                let steady = [pressure; PRESSURES].into_iter().chain([goal; GOALS]);
                let observation: Vec<f32> = steady.flatten().collect();
                let mut answers = [0.0; ACTION_LEN];
                policy.run(&observation, &mut answers).ok().map(|()| [answers[0], answers[1]])
            };
            let (Some(too_much), Some(too_little)) = (asked(1.0), asked(-1.0)) else { continue };
            places += 1.0;
            for valve in 0..2 {
                right[valve] += f32::from(u8::from(too_much[valve] > too_little[valve]));
            }
        }
    }
    right.map(|count| if places > 0.0 { count / places } else { 0.0 })
}

//! Two ticks compared bit for bit, stage by stage: the recorded one and the replayed one.

use proto::recording::{LawParts, TickRecord};
use proto::wire::Frame;

use crate::cycle::duty_source::ActuatorCommand;

/// A stage of the tick, in the order in which they run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Volts to pressures.
    Sensing,
    /// State, fault, findings.
    State,
    /// Place where to go.
    Reference,
    /// MPObs.
    Prediction,
    /// Observation that the policy was given.
    Observation,
    /// Answer of the policy.
    Policy,
    /// The control law's terms.
    Law,
    /// The safety filter.
    Filter,
    /// Takes note of the command that was sent.
    Command,
}

impl Stage {
    /// Name for people.
    pub const fn name(self) -> &'static str {
        match self {
            Stage::Sensing => "sensing (volts to pressures)",
            Stage::State => "state and findings",
            Stage::Reference => "reference",
            Stage::Prediction => "prediction (MPObs)",
            Stage::Observation => "observation",
            Stage::Policy => "policy",
            Stage::Law => "control law",
            Stage::Filter => "safety filter",
            Stage::Command => "command",
        }
    }
}

/// The first difference.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Difference {
    /// Tick since the first of the recording, from 0.
    pub index: u64,
    /// Session of the tick.
    pub session: u32,
    /// The tick's number.
    pub tick: u32,
    /// The first stage that differs.
    pub stage: Stage,
    /// Values, recorded and replayed.
    pub values: String,
}

/// The first stage in which two ticks differ in a bit, with what it held.
pub(super) fn compare(
    recorded: &TickRecord,
    again: &TickRecord,
    answer: &ActuatorCommand,
    numbers: &mut u64,
) -> Option<(Stage, String)> {
    let bits = |values: &[f64]| -> Vec<u64> { values.iter().map(|value| value.to_bits()).collect() };
    let law = |parts: &LawParts| {
        [parts.feed_forward, parts.backlash, parts.correction, parts.proportional, parts.integral, parts.u_raw]
    };
    let of = |tick: &TickRecord| -> Vec<(Stage, Vec<u64>)> {
        vec![
            (Stage::Sensing, bits(&[tick.p_pos_kpa, tick.p_neg_kpa])),
            (
                Stage::State,
                vec![
                    u64::from(tick.tick),
                    u64::from(tick.state),
                    u64::from(tick.fault),
                    tick.findings,
                    u64::from(tick.experiment),
                ],
            ),
            (Stage::Reference, bits(&[tick.ref_pos_kpa, tick.ref_neg_kpa])),
            (Stage::Prediction, bits(&[tick.predicted_pos_kpa, tick.predicted_neg_kpa].concat())),
            (Stage::Observation, vec![tick.observation_hash]),
            (
                Stage::Policy,
                tick.policy_output
                    .iter()
                    .map(|value| u64::from(value.to_bits()))
                    .chain([u64::from(tick.policy_stage), tick.authority.to_bits(), u64::from(tick.swap_id)])
                    .chain(bits(&[tick.exploration_pos, tick.exploration_neg]))
                    .chain(tick.exploration_plan.iter().map(|value| u64::from(value.to_bits())))
                    .collect(),
            ),
            (Stage::Law, bits(&[law(&tick.law_pos), law(&tick.law_neg)].concat())),
            (
                Stage::Filter,
                bits(&tick.command_before_filter).into_iter().chain([u64::from(tick.filter_active)]).collect(),
            ),
            (
                Stage::Command,
                bits(&[tick.u_pos, tick.u_neg])
                    .into_iter()
                    .chain([u64::from(tick.mode), u64::from(tick.pump_on)])
                    .collect(),
            ),
        ]
    };
    for ((stage, was), (_, is)) in of(recorded).into_iter().zip(of(again)) {
        *numbers += was.len() as u64;
        if was != is {
            return Some((stage, differing(&was, &is)));
        }
    }
    // What went over the wire, where it did, is what was decided.
    let Ok(Frame::Command(sent)) = Frame::decode(recorded.command_present.then_some(&recorded.command)?) else {
        return Some((Stage::Command, "the recorded COMMAND cannot be read".to_owned()));
    };
    *numbers += 3;
    let wire = answer.duty.map(|duty| duty as f32);
    let same = sent.duty.map(f32::to_bits) == wire.map(f32::to_bits) && sent.mode == answer.mode;
    (!same)
        .then(|| (Stage::Command, format!("sent {:?} {:?}, replayed {wire:?} {:?}", sent.duty, sent.mode, answer.mode)))
}

/// The first number of a stage that differs, as a number where it is one.
fn differing(was: &[u64], is: &[u64]) -> String {
    let at = was.iter().zip(is).position(|(was, is)| was != is).unwrap_or(0);
    let shown = |bits: Option<&u64>| {
        let bits = bits.copied().unwrap_or(0);
        // Small whole numbers are codes, single precision or counts; everything else is a double.
        if bits <= u64::from(u32::MAX) {
            format!("{bits:#x}")
        } else {
            format!("{:e} ({bits:#018x})", f64::from_bits(bits))
        }
    };
    format!("number {} of the stage: recorded {}, replayed {}", at + 1, shown(was.get(at)), shown(is.get(at)))
}

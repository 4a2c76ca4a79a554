//! Judgement of a policy by its trial's flights: refused, or its figures.

use model::observation::{CHANNELS, Pair};
use serde::{Deserialize, Serialize};

use super::rigs::LANES;
use super::tally::Tally;

/// Errors below these (kPa) are all one: two to three times what the converter's noise, the pump's ripple and a few
/// thousandths of duty leave. Chosen: a fifth of what the paper reports on its rig (0.69/0.26) and more.
const FLOOR_KPA: Pair = [0.15, 0.1];
/// Most that the errors may be of the incumbent's, geometric mean over the first bundle's rigs and both channels.
pub const MOST_OF_INCUMBENT: f64 = 1.5;
/// Most that they may be in one channel, geometric mean over the rigs: one channel may cost the other something.
const MOST_IN_ONE_CHANNEL: f64 = 2.0;
/// Most that they may be on any single one of these rigs.
const MOST_ON_ONE_RIG: f64 = 4.0;
/// A pressure that swings on a hold by more than the fallback's and this (kPa), and by so many times the fallback's, is a
/// limit cycle. Measured on the same rigs (n = 13 trained corrections, among them some that swing on a model without any lag
/// a tick later): up to 0.98/0.35 kPa; controllers that hunt for good reach several kPa.
const SWING_KPA: Pair = [1.3, 0.5];
const SWING_RATIO: f64 = 3.0;
/// Duties that change on a hold by more than this a tick (RMS) are one as well. Measured (n = 13): up to 0.017/0.070;
/// controllers that switch reach 0.2 and more.
const CHATTER_DUTY: f64 = 0.1;

/// Figures of a policy's trial; kPa, duty, and ratios to the compared controller's errors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TrialFigures {
    /// Error on the model itself, positive and negative, in kPa.
    pub rmse_kpa: Pair,
    /// The fallback's there.
    pub fallback_rmse_kpa: Pair,
    /// Ratio to the incumbent's errors over the rigs around the model, geometric mean.
    pub ratio: Pair,
    /// Ratio on the worst of them.
    pub worst_ratio: Pair,
    /// Ratio over rigs with worn valves, geometric mean.
    pub worn_ratio: Pair,
    /// The largest swing of a pressure on a hold, in kPa.
    pub swing_kpa: Pair,
    /// The largest change of a duty from tick to tick on a hold, root mean square.
    pub chatter_duty: Pair,
}

/// Outcome of a trial.
#[derive(Debug, Clone, PartialEq)]
pub struct Judgement {
    /// The figures.
    pub figures: TrialFigures,
    /// Reason why the policy must not fly, one line; `None` if it may.
    pub refused: Option<String>,
}

/// Judges a policy's tallies against the fallback's and the incumbent's on the same rigs, rig by rig.
pub fn judge(flown: &[Tally], fallback: &[Tally], incumbent: &[Tally]) -> Judgement {
    let around = 0..LANES.min(flown.len());
    let worn = around.end..flown.len();
    let mean = |rigs: &std::ops::Range<usize>, c: usize| {
        let sum: f64 = rigs.clone().map(|rig| ratio(flown, incumbent, rig, c).ln()).sum();
        (sum / rigs.len().max(1) as f64).exp()
    };
    let most = |value: &dyn Fn(&Tally) -> f64| flown.iter().map(value).fold(0.0, f64::max);
    let of_model = |tallies: &[Tally]| tallies.first().map_or([f64::NAN; CHANNELS], |t| t.rmse_kpa);
    let figures = TrialFigures {
        rmse_kpa: of_model(flown),
        fallback_rmse_kpa: of_model(fallback),
        ratio: std::array::from_fn(|c| mean(&around, c)),
        worst_ratio: std::array::from_fn(|c| {
            around.clone().map(|rig| ratio(flown, incumbent, rig, c)).fold(0.0, f64::max)
        }),
        worn_ratio: std::array::from_fn(|c| mean(&worn, c)),
        swing_kpa: std::array::from_fn(|c| most(&|t| t.swing_kpa[c])),
        chatter_duty: std::array::from_fn(|c| most(&|t| t.chatter_duty[c])),
    };
    Judgement { refused: refusal(flown, fallback, &figures), figures }
}

/// Error of a rig as a multiple of the incumbent's.
fn ratio(flown: &[Tally], incumbent: &[Tally], rig: usize, c: usize) -> f64 {
    let with_floor = |tallies: &[Tally]| tallies.get(rig).map_or(f64::NAN, |t| t.rmse_kpa[c].hypot(FLOOR_KPA[c]));
    let ratio = with_floor(flown) / with_floor(incumbent);
    if ratio.is_finite() { ratio } else { f64::INFINITY }
}

fn refusal(flown: &[Tally], fallback: &[Tally], figures: &TrialFigures) -> Option<String> {
    let side = |c: usize| if c == 0 { "positive" } else { "negative" };
    if let Some(rig) = flown.iter().position(|t| t.not_finite) {
        return Some(format!("answers something that is not finite on {}", name(rig)));
    }
    let both = || flown.iter().zip(fallback).enumerate();
    // Where even the fallback leaves the envelope the rig is at fault.
    if let Some((rig, left_s)) =
        both().find_map(|(rig, (t, base))| Some((rig, t.left_s?)).filter(|_| base.left_s.is_none()))
    {
        return Some(format!("leaves the safety envelope on {}, {left_s:.1} s after arming", name(rig)));
    }
    for (rig, (tally, base)) in both() {
        #[allow(clippy::needless_range_loop)] // several arrays of channels side by side
        for c in 0..CHANNELS {
            let (swing, calm) = (tally.swing_kpa[c], base.swing_kpa[c]);
            if swing > (SWING_RATIO * calm).max(calm + SWING_KPA[c]) {
                return Some(format!(
                    "limit cycle: on a hold the {} pressure swings by {swing:.2} kPa RMS on {}, the fallback's by {calm:.2}",
                    side(c),
                    name(rig)
                ));
            }
            let chatter = tally.chatter_duty[c];
            if chatter > CHATTER_DUTY.max(2.0 * base.chatter_duty[c]) {
                return Some(format!(
                    "limit cycle: on a hold the {} duty changes by {chatter:.3} RMS from tick to tick on {}, the fallback's by {:.3}",
                    side(c),
                    name(rig),
                    base.chatter_duty[c]
                ));
            }
        }
    }
    let worse = |ratio: Pair, most: f64, where_: &str| {
        (0..CHANNELS).find(|&c| ratio[c] > most).map(|c| {
            format!(
                "tracks worse than what controls now: {:.2} times its error in the {} pressure {where_}, allowed are {most}",
                ratio[c],
                side(c)
            )
        })
    };
    let both_channels = figures.ratio.iter().product::<f64>().sqrt();
    if both_channels > MOST_OF_INCUMBENT {
        return Some(format!(
            "tracks worse than what controls now: {both_channels:.2} times its error over rigs around the model, allowed are {MOST_OF_INCUMBENT}"
        ));
    }
    worse(figures.ratio, MOST_IN_ONE_CHANNEL, "over rigs around the model")
        .or_else(|| worse(figures.worst_ratio, MOST_ON_ONE_RIG, "on one rig around the model"))
        .or_else(|| worse(figures.worn_ratio, MOST_IN_ONE_CHANNEL, "over rigs with worn valves"))
}

/// Name of a rig of the trial.
fn name(rig: usize) -> String {
    match rig {
        0 => "the model".to_owned(),
        1 => "the model a tick later".to_owned(),
        rig if rig < LANES => format!("rig {rig} around the model"),
        rig => format!("rig {rig}, with worn valves"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tallies(change: impl Fn(usize, &mut Tally)) -> Vec<Tally> {
        let calm =
            Tally { rmse_kpa: [0.2, 0.1], swing_kpa: [0.02, 0.01], chatter_duty: [0.003; 2], ..Tally::default() };
        let mut all = vec![calm; 2 * LANES];
        all.iter_mut().enumerate().for_each(|(rig, tally)| change(rig, tally));
        all
    }

    fn refused(change: impl Fn(usize, &mut Tally)) -> Option<String> {
        let base = tallies(|_, _| {});
        judge(&tallies(change), &base, &base).refused
    }

    #[test]
    fn each_rule_refuses_for_its_own_reason() {
        assert_eq!(refused(|_, _| {}), None);
        assert_eq!(refused(|_, t| t.rmse_kpa = t.rmse_kpa.map(|e| 1.4 * e)), None);
        let cases: [(&str, &dyn Fn(usize, &mut Tally)); 8] = [
            ("not finite on the model a tick later", &|rig, t| t.not_finite = rig == 1),
            ("envelope on rig 9, with worn valves, 3.5 s", &|rig, t| t.left_s = (rig == 9).then_some(3.5)),
            ("negative pressure swings", &|rig, t| t.swing_kpa[1] = if rig == 3 { 0.6 } else { 0.01 }),
            ("positive duty changes by 0.140", &|rig, t| t.chatter_duty[0] = if rig == 0 { 0.14 } else { 0.0 }),
            ("worse than what controls now: 1.", &|_, t| t.rmse_kpa = t.rmse_kpa.map(|e| 2.5 * e)),
            ("in the positive pressure over rigs around", &|_, t| t.rmse_kpa[0] *= 2.6),
            ("on one rig around the model", &|rig, t| t.rmse_kpa[1] *= if rig == 5 { 9.0 } else { 1.0 }),
            ("rigs with worn valves", &|rig, t| t.rmse_kpa[0] *= if rig >= LANES { 4.0 } else { 1.0 }),
        ];
        for (words, change) in cases {
            let reason = refused(change).unwrap_or_else(|| panic!("{words}: taken"));
            assert!(reason.contains(words), "{words}: {reason}");
        }
    }

    #[test]
    fn where_the_fallback_leaves_the_envelope_too_nobody_is_blamed() {
        let left = |rig: usize, t: &mut Tally| t.left_s = (rig == 2).then_some(1.0);
        assert_eq!(judge(&tallies(left), &tallies(left), &tallies(left)).refused, None);
    }
}

//! Identified parameters, as a table and in plain words.

use std::fmt::Write as _;

use super::contradictions::contradicted;
use super::run::Identified;
use crate::data::Noise;
use crate::objective::{Estimate, FAR, Fitted, HeldBy, Runaway};
use crate::parameters::{End, Transform};
use crate::simulate::ChannelError;
use crate::wording::{MOST_TIMES, NO_NOISE_KPA, change_in_percent, three_digits};

/// A parameter of which recordings say next to nothing, as the same share.
const AS_BEFORE: f64 = 0.9;
/// A free run off by less than so many times the noise leaves nothing to explain.
const EXPLAINED: f64 = 1.3;
/// A free run off by so many times the noise is not that of the rig: what a rig file lacks outweighs what was fitted (chosen; `diagnose`
/// calls what leaves as much a part of the truth).
const IN_PART: f64 = 10.0;
/// Costs of starts that differ by less are along one flat valley, whose ground is rough: check valves of a piston pump
/// open a step of the integrator sooner or later (up to 8 measured, where the noise of a fit moves costs by half the
/// number of parameters, 7).
const SAME_VALLEY: f64 = 15.0;
/// Variance, in units of the prior's, from which on a parameter is named as widened.
const MUCH_WIDER: f64 = 0.1;
/// A parameter that is this many times what was stated, or one in so many, is told with that factor.
const FACTOR: f64 = 1.5;
/// Error in kPa from which on a channel without noise is off.
const OFF_KPA: f64 = 0.1;

/// The parameters with their uncertainties, one a line.
pub fn table(identified: &Identified) -> String {
    let mut text = String::new();
    let width = identified.fitted.estimates.iter().map(|e| e.parameter.path.chars().count()).max().unwrap_or(9).max(9);
    let _ = writeln!(text, "{:<width$}  {:>8}  {:>10}  {:>7}  moved", "parameter", "rig file", "identified", "±");
    let (mut any_as_before, mut any_runaway) = (false, false);
    for (index, e) in identified.fitted.estimates.iter().enumerate() {
        let digits = decimals(e.sd);
        let runaway = identified.fitted.runaway(index).is_some();
        let as_before = e.undetermined > AS_BEFORE && !runaway;
        any_as_before |= as_before;
        any_runaway |= runaway;
        let sd = if runaway { "-".to_owned() } else { format!("{:.digits$}", e.sd) };
        let _ = writeln!(
            text,
            "{:<width$}  {:>8.digits$}  {:>10.digits$}  {sd:>7}  {}{}",
            e.parameter.path,
            e.parameter.mean,
            e.value,
            moved(e),
            if runaway {
                " †"
            } else if as_before {
                " *"
            } else {
                ""
            },
        );
    }
    if any_as_before {
        text.push_str("* known no better than before\n");
    }
    if any_runaway {
        text.push_str("† no value: only on which side it is\n");
    }
    text
}

/// Parameters of which only a side is known, one sentence a line.
fn runaways(identified: &Identified) -> Vec<String> {
    let of = |(index, e): (usize, &Estimate)| Some(runaway_in_words(e, &identified.fitted.runaway(index)?));
    identified.fitted.estimates.iter().enumerate().filter_map(of).collect()
}

/// A parameter of which only a side is known, in words.
pub fn runaway_in_words(estimate: &Estimate, runaway: &Runaway) -> String {
    let (path, unit) = (&estimate.parameter.path, estimate.parameter.unit());
    let beyond = format!("{}{}{unit}", three_digits(runaway.beyond), if unit.is_empty() { "" } else { " " });
    let (side, limit) = if runaway.end == End::High { ("above", "upper") } else { ("below", "lower") };
    match runaway.held_by {
        HeldBy::Statement => {
            format!("{path} is {side} {beyond}: the recordings hold no {limit} limit, and no value is stated")
        }
        HeldBy::Range => format!(
            "{path} ends at {beyond}, the {limit} end of what it can be: that is no answer; it stands in for something that the rig file \
             lacks or has wrong"
        ),
    }
}

/// By how much a parameter moved: in per cent, or in its unit where it may be zero.
fn moved(e: &Estimate) -> String {
    match e.parameter.transform {
        Transform::Log => change_in_percent(e.value / e.parameter.mean - 1.0, 1),
        Transform::Linear => format!("{:+.2} {}", e.value - e.parameter.mean, e.parameter.unit()),
    }
}

/// Decimals that show two digits of an uncertainty.
fn decimals(sd: f64) -> usize {
    if sd > 0.0 && sd.is_finite() { (1.0 - sd.log10().floor()).clamp(0.0, 6.0) as usize } else { 4 }
}

/// Errors on the rows that were kept back, before and after, at three horizons.
pub fn figures(identified: &Identified) -> String {
    let rows =
        if identified.tested_on_fitted { "the fitted rows (too few to keep any back)" } else { "validation data" };
    let mut text = format!("error in kPa rms on {rows}, simulated from the commands alone\n");
    let width = identified.channels.iter().map(|c| c.chars().count()).max().unwrap_or(0);
    let _ = writeln!(text, "{:width$}  {:<10}  {:>9}  {:>9}  {:>9}", "", "", "open loop", "10 s", "1 s");
    for (index, channel) in identified.channels.iter().enumerate() {
        for (name, accuracy) in [("rig file", &identified.before), ("identified", &identified.after)] {
            let at = |errors: &[ChannelError]| errors.get(index).map_or(f64::NAN, |e| e.rmse_kpa);
            let [free, ten, one] = [&accuracy.free, &accuracy.ten_seconds, &accuracy.one_second].map(|e| at(e));
            let _ = writeln!(text, "{channel:width$}  {name:<10}  {free:>9.3}  {ten:>9.3}  {one:>9.3}");
        }
    }
    text
}

/// An error in multiples of a noise; `None` where there is no noise to speak of.
fn times_noise(error: &ChannelError, noise: &Noise) -> Option<f64> {
    (noise.sigma_kpa > NO_NOISE_KPA).then(|| error.rmse_kpa / noise.sigma_kpa)
}

/// A noise for a table: `noise of a reading 0.052 kPa`.
pub fn noise_in_words(noise: &Noise) -> String {
    if noise.sigma_kpa > NO_NOISE_KPA {
        format!("noise of a reading {:.3} kPa", noise.sigma_kpa)
    } else {
        "the noise of a reading cannot be told: most repeat the one before".to_owned()
    }
}

/// A multiple as a number, or that it is beyond all measure.
fn times(ratio: f64) -> String {
    match ratio {
        ratio if ratio > MOST_TIMES => format!("more than {MOST_TIMES:.0}"),
        ratio if ratio < IN_PART => format!("{ratio:.1}"),
        ratio => format!("{ratio:.0}"),
    }
}

/// Tells whether the free run of a channel is down to the noise.
fn explained(identified: &Identified, channel: usize) -> bool {
    let (error, noise) = (identified.after.free.get(channel), identified.noise.get(channel));
    error.zip(noise).is_some_and(|(error, noise)| is_explained(error, noise))
}

fn is_explained(error: &ChannelError, noise: &Noise) -> bool {
    match times_noise(error, noise) {
        Some(ratio) => ratio < EXPLAINED,
        None => error.rmse_kpa < OFF_KPA,
    }
}

/// Why the identified rig is not good although it is better than before: the channel that it is furthest off in, in multiples of its
/// noise, or a parameter that no value was found of. `None` where it is as good as such models get.
pub fn not_good(identified: &Identified) -> Option<String> {
    let channels = || identified.channels.iter().zip(&identified.after.free).zip(&identified.noise);
    let told = channels()
        .filter_map(|((channel, error), noise)| Some((channel, error.rmse_kpa, times_noise(error, noise)?)))
        .max_by(|a, b| a.2.total_cmp(&b.2))
        .filter(|(.., ratio)| *ratio >= IN_PART);
    if let Some((channel, kpa, ratio)) = told {
        let times = times(ratio);
        return Some(format!(
            "{channel} is off by {kpa:.2} kPa, {times} times its noise, with the parameters as fitted"
        ));
    }
    let untold =
        channels().find(|((_, error), noise)| times_noise(error, noise).is_none() && !is_explained(error, noise));
    if let Some(((channel, error), _)) = untold {
        return Some(format!(
            "{channel} is off by {:.2} kPa with the parameters as fitted, and most of its readings repeat the one before",
            error.rmse_kpa
        ));
    }
    let ended = |(index, e): (usize, &Estimate)| {
        let runaway = identified.fitted.runaway(index).filter(|runaway| runaway.held_by == HeldBy::Range)?;
        Some(runaway_in_words(e, &runaway))
    };
    identified.fitted.estimates.iter().enumerate().find_map(ended)
}

/// A parameter far from what was stated, in words.
fn far_in_words(e: &Estimate) -> String {
    let factor = e.value / e.parameter.mean;
    let scatter = format!("{:.1} times what such parts scatter by", e.shift.abs());
    let how_far = if e.parameter.transform == Transform::Log && !(1.0 / FACTOR..FACTOR).contains(&factor) {
        format!("is {} times the value in the rig file ({scatter})", three_digits(factor))
    } else {
        format!("moved by {scatter}")
    };
    format!(
        "{} {how_far}: it may stand in for something that the rig file lacks; if the file is wrong there, put the right value in and \
         identify again, for what is stated still pulls at it",
        e.parameter.path
    )
}

/// The sentence on parameters whose uncertainties were widened since what is stated contradicts itself by far, and recordings tell
/// their ratios alone; `None` where none was.
fn only_ratios(identified: &Identified) -> Option<String> {
    let Fitted { estimates, information, .. } = &identified.fitted;
    let variances = contradicted(estimates, information.as_ref()?)?;
    let widened = estimates.iter().zip(&variances).filter(|(_, variance)| **variance > MUCH_WIDER);
    let names: Vec<&str> = widened.map(|(e, _)| e.parameter.path.as_str()).collect();
    (!names.is_empty()).then(|| {
        format!(
            "what the rig file states of {} contradicts itself by far, and the recordings determine ratios of these alone: any of them \
             may be the wrong one, so that each ± is widened to that; measure one of them, put the right value in and identify again",
            names.join(", ")
        )
    })
}

/// Verdict on an identification, one sentence a line.
pub fn verdict(identified: &Identified) -> Vec<String> {
    let mut said = Vec::new();
    for ((channel, error), noise) in identified.channels.iter().zip(&identified.after.free).zip(&identified.noise) {
        let rows = if identified.tested_on_fitted { "the fitted rows" } else { "validation data" };
        let off = format!("{channel}: the open-loop simulation is off by {:.3} kPa rms on {rows}", error.rmse_kpa);
        said.push(match times_noise(error, noise) {
            Some(ratio) if ratio < EXPLAINED => {
                format!("{off}, the noise is {:.3}: nothing more to explain", noise.sigma_kpa)
            }
            Some(ratio) => {
                format!(
                    "{off}, {} times the noise: the rig file lacks something; `trainer diagnose` looks for it",
                    times(ratio)
                )
            }
            None => format!("{off}; most of its readings repeat the one before, so that their noise cannot be told"),
        });
    }
    said.extend(runaways(identified));
    for (index, e) in identified.fitted.estimates.iter().enumerate() {
        if e.shift.abs() > FAR && identified.fitted.runaway(index).is_none() {
            said.push(far_in_words(e));
        }
    }
    said.extend(only_ratios(identified));
    let spread = identified
        .costs
        .iter()
        .fold(0.0_f64, |s, c| s.max(c - identified.costs.iter().copied().fold(f64::INFINITY, f64::min)));
    if spread > SAME_VALLEY {
        said.push(format!(
            "the starts ended {spread:.0} apart in log-likelihood: another minimum is near; the better one is taken"
        ));
    }
    if !identified.fitted.converged {
        said.push("the refinement had not converged when its rounds were used up".to_owned());
    }
    for (index, (channel, lines)) in identified.channels.iter().zip(&identified.lines).enumerate() {
        // What a model lacks shows as lines too, at the commands' own frequencies.
        if let Some(line) = lines.first()
            && explained(identified, index)
        {
            said.push(format!(
                "{channel}: a line of {:.3} kPa at {:.2} Hz: the pump's ripple, folded down by sampling, if its speed \
                 is not what the rig file says",
                line.amplitude, line.hz
            ));
        }
    }
    said
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::Parameter;

    fn noise(sigma_kpa: f64) -> Noise {
        Noise { sigma_kpa, step_kpa: 0.0, on_plateaus_kpa: None }
    }

    #[test]
    fn multiples_of_no_noise_are_not_told() {
        let error = ChannelError { rmse_kpa: 7.263, ..ChannelError::default() };
        assert_eq!(times_noise(&error, &noise(1e-6)), None);
        assert!(!is_explained(&error, &noise(1e-6)));
        assert!(noise_in_words(&noise(1e-6)).contains("cannot be told"));
        assert_eq!(noise_in_words(&noise(0.052)), "noise of a reading 0.052 kPa");
        assert_eq!(times(7_263_021.0), "more than 1000");
        assert_eq!([times(1.44), times(12.7)], ["1.4", "13"]);
    }

    #[test]
    fn a_parameter_without_a_limit_and_one_at_its_end_are_said_to_be_so() {
        let parameter = Parameter::log("lines.leak.resistance_kpa_s_per_l", 4e4, 0.3);
        let shift = parameter.coordinate(1.35e6);
        let estimate = Estimate { value: 1.35e6, sd: 2e5, shift, undetermined: 0.47, parameter };
        let open = Runaway { end: End::High, beyond: 1.07e6, held_by: HeldBy::Statement };
        let said = runaway_in_words(&estimate, &open);
        assert!(said.contains("is above 1.07·10⁶ kPa s/L: the recordings hold no upper limit"), "{said}");
        let said = runaway_in_words(&estimate, &Runaway { held_by: HeldBy::Range, ..open });
        assert!(said.contains("the upper end of what it can be"), "{said}");
        let said = far_in_words(&estimate);
        assert!(said.contains("is 33.8 times the value in the rig file (11.7 times what"), "{said}");
    }
}

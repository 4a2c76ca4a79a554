//! What was identified, as a table and in plain words.

use std::fmt::Write as _;

use super::run::Identified;
use crate::least_squares::Direction;
use crate::objective::{Estimate, Fitted};
use crate::simulate::ChannelError;

/// A combination whose standard error is still this share of what was known beforehand is not determined.
const HARDLY: f64 = 0.5;
/// A parameter of which recordings say next to nothing, as the same share.
const AS_BEFORE: f64 = 0.9;
/// Combinations that are told of those that are determined best.
const MOST_TOLD: usize = 3;
/// Share of a combination's largest component from which on a parameter belongs to it, and the most that are told.
const BELONGS: f64 = 0.35;
const MOST_PARTS: usize = 4;
/// A free run off by less than so many times the noise leaves nothing to explain.
const EXPLAINED: f64 = 1.3;
/// A free run off by so many times the noise is not that of the rig: what a rig file lacks outweighs what was fitted (chosen; `diagnose`
/// calls what leaves as much a part of the truth).
const IN_PART: f64 = 10.0;
/// Costs of starts that differ by less are along one flat valley, whose ground is rough: check valves of a piston pump
/// open a step of the integrator sooner or later (up to 8 measured, where the noise of a fit moves costs by half the
/// number of parameters, 7).
const SAME_VALLEY: f64 = 15.0;
/// A parameter that moved by more prior deviations than this did not just scatter.
const IMPLAUSIBLE: f64 = 3.0;

/// The parameters with their uncertainties, one a line.
pub fn table(identified: &Identified) -> String {
    let mut text = String::new();
    let width = identified.fitted.estimates.iter().map(|e| e.parameter.path.chars().count()).max().unwrap_or(9).max(9);
    let _ = writeln!(text, "{:<width$}  {:>8}  {:>10}  {:>7}  moved", "parameter", "rig file", "identified", "±");
    let mut any_as_before = false;
    for e in &identified.fitted.estimates {
        let digits = decimals(e.sd);
        let as_before = e.undetermined > AS_BEFORE;
        any_as_before |= as_before;
        let _ = writeln!(
            text,
            "{:<width$}  {:>8.digits$}  {:>10.digits$}  {:>7.digits$}  {}{}",
            e.parameter.path,
            e.parameter.mean,
            e.value,
            e.sd,
            moved(e),
            if as_before { " *" } else { "" },
        );
    }
    if any_as_before {
        text.push_str("* known no better than before\n");
    }
    text
}

/// By how much a parameter moved: in per cent, or in its unit where it may be zero.
fn moved(e: &Estimate) -> String {
    match e.parameter.transform {
        crate::parameters::Transform::Log => format!("{:+.1} %", 100.0 * (e.value / e.parameter.mean - 1.0)),
        crate::parameters::Transform::Linear => format!("{:+.2} {}", e.value - e.parameter.mean, e.parameter.unit()),
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

/// What the recordings do not determine, one sentence a line; empty if they determine everything.
pub fn undetermined(fitted: &Fitted) -> Vec<String> {
    let name = |i: usize| fitted.estimates.get(i).map_or("?", |e| e.parameter.path.as_str());
    let Some(information) = &fitted.information else {
        return vec!["some parameter without a prior does not show in these recordings at all".to_owned()];
    };
    let mut said = Vec::new();
    for direction in information.directions() {
        // The posterior's deviation along it, in prior deviations: 1/√(1 + information).
        if (1.0 / (1.0 + direction.information)).sqrt() < HARDLY {
            break;
        }
        let shown = parts_of(&direction.components);
        match shown.as_slice() {
            [(one, _)] => said.push(format!("{} hardly shows", name(*one))),
            [(first, sign), rest @ ..] => {
                // To move along the direction leaves the readings as they are: what one does the others undo.
                said.push(format!("raising {} looks the same as {}", name(*first), moves(rest, -sign, name)));
            }
            [] => {}
        }
    }
    said
}

/// The parameters that make up most of a combination, the largest first.
fn parts_of(components: &[f64]) -> Vec<(usize, f64)> {
    let mut parts: Vec<(usize, f64)> = components.iter().copied().enumerate().collect();
    parts.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    let largest = parts.first().map_or(0.0, |p| p.1.abs());
    parts.into_iter().filter(|(_, c)| c.abs() > BELONGS * largest).take(MOST_PARTS).collect()
}

/// What the recordings determine, one sentence a line: how many combinations of the parameters, which by themselves, and the best
/// combinations with how well they are known.
///
/// Recordings of a closed machine hardly ever determine one parameter: a wider valve and a weaker spring move the pressures alike.
/// What they do determine are combinations, some of them to a thousandth; the standard errors of single parameters hide that.
pub fn determined(fitted: &Fitted) -> Vec<String> {
    let Some(information) = &fitted.information else { return Vec::new() };
    let name = |i: usize| fitted.estimates.get(i).map_or("?", |e| e.parameter.path.as_str());
    // The posterior's deviation in prior deviations.
    let sd = |direction: &Direction| (1.0 / (1.0 + direction.information)).sqrt();
    let mut directions = information.directions();
    directions.reverse();
    directions.retain(|direction| sd(direction) < HARDLY);
    let alone: Vec<&str> =
        fitted.estimates.iter().filter(|e| e.undetermined < HARDLY).map(|e| e.parameter.path.as_str()).collect();
    let mut said = vec![format!(
        "{} of {} combinations of parameters are known better than half of what was known before; by themselves {}",
        directions.len(),
        fitted.estimates.len(),
        if alone.is_empty() { "none is".to_owned() } else { alone.join(", ") }
    )];
    for direction in directions.iter().take(MOST_TOLD) {
        let parts = parts_of(&direction.components);
        let Some((first, largest)) = parts.first().copied() else { continue };
        let Some(estimate) = fitted.estimates.get(first) else { continue };
        let known = sd(direction) * estimate.parameter.scale() / largest.abs();
        let known = match estimate.parameter.transform {
            crate::parameters::Transform::Log => format!("{:.2} %", 100.0 * known),
            crate::parameters::Transform::Linear => format!("{known:.3} {}", estimate.parameter.unit()),
        };
        said.push(match parts.get(1..) {
            None | Some([]) => format!("{} is known to {known}", name(first)),
            Some(others) => format!(
                "what raising {0} while {1} does is known to {known} of {0}",
                name(first),
                moves(others, largest, name)
            ),
        });
    }
    said
}

/// Says how parts of a combination move where one of the sign `with` is raised: "raising a, lowering b and raising c".
fn moves<'n>(parts: &[(usize, f64)], with: f64, name: impl Fn(usize) -> &'n str) -> String {
    let words: Vec<String> = parts
        .iter()
        .map(|(i, c)| format!("{} {}", if c * with > 0.0 { "raising" } else { "lowering" }, name(*i)))
        .collect();
    match words.as_slice() {
        [] => String::new(),
        [one] => one.clone(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

/// Whether the free run of a channel is down to the noise.
fn explained(identified: &Identified, channel: usize) -> bool {
    let (error, noise) = (identified.after.free.get(channel), identified.noise.get(channel));
    error.zip(noise).is_some_and(|(error, noise)| error.rmse_kpa < EXPLAINED * noise.sigma_kpa)
}

/// Why the identified rig is not good although it is better than before: the channel that it is furthest off in, in multiples of its
/// noise. `None` where it is as good as such models get.
pub fn not_good(identified: &Identified) -> Option<String> {
    let channels = identified.channels.iter().zip(&identified.after.free).zip(&identified.noise);
    let ratios = channels.map(|((channel, error), noise)| (channel, error.rmse_kpa, error.rmse_kpa / noise.sigma_kpa));
    let (channel, kpa, times) = ratios.max_by(|a, b| a.2.total_cmp(&b.2)).filter(|(.., times)| *times >= IN_PART)?;
    Some(format!("{channel} is off by {kpa:.2} kPa, {times:.0} times its noise, with the parameters as fitted"))
}

/// What to make of it, one sentence a line.
pub fn verdict(identified: &Identified) -> Vec<String> {
    let mut said = Vec::new();
    for ((channel, error), noise) in identified.channels.iter().zip(&identified.after.free).zip(&identified.noise) {
        let ratio = error.rmse_kpa / noise.sigma_kpa;
        let rows = if identified.tested_on_fitted { "the fitted rows" } else { "validation data" };
        if ratio < EXPLAINED {
            said.push(format!(
                "{channel}: the open-loop simulation is off by {:.3} kPa rms on {rows}, the noise is {:.3}: nothing more to explain",
                error.rmse_kpa, noise.sigma_kpa
            ));
        } else {
            said.push(format!(
                "{channel}: the open-loop simulation is off by {:.3} kPa rms on {rows}, {ratio:.1} times the noise: the rig file \
                 lacks something; `trainer diagnose` looks for it",
                error.rmse_kpa
            ));
        }
    }
    for e in &identified.fitted.estimates {
        if e.shift.abs() > IMPLAUSIBLE {
            said.push(format!(
                "{} moved by {:.1} times what such parts scatter by: it may stand in for something that the rig file lacks",
                e.parameter.path,
                e.shift.abs()
            ));
        }
    }
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

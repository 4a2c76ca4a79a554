//! Parameters that went where nobody would believe them.
//!
//! A fit moves what it may. An atmosphere of 95.8 kPa at 101.3 stated, or a volume three times the stated one, is no
//! measurement of either: it stands in for something that the rig file lacks, or the file is wrong by a digit. Both are for a person
//! to see.

use fit::identify::runaway_in_words;
use fit::objective::{Estimate, FAR, Fitted, HeldBy, Runaway};
use proto::diagnosis::DoubtfulParameter;

use crate::report::wording::three;

/// Standard deviations of what such parts scatter by from which on the headline says that a parameter is doubted; or this factor either way.
const UNBELIEVED: f64 = 6.0;
const FACTOR: f64 = 1.5;

/// Doubted parameters among some estimates, furthest off first.
pub(crate) fn doubtful(estimates: &[Estimate]) -> Vec<DoubtfulParameter> {
    let far = estimates.iter().filter(|e| e.shift.abs() > FAR && e.parameter.prior_weight() > 0.0);
    let mut all: Vec<DoubtfulParameter> = far
        .map(|e| DoubtfulParameter {
            parameter: e.parameter.path.clone(),
            unit: e.parameter.unit().to_owned(),
            stated: e.parameter.mean,
            fitted: e.value,
            deviations: e.shift,
        })
        .collect();
    all.sort_by(|a, b| b.deviations.abs().total_cmp(&a.deviations.abs()));
    all
}

/// The rig's own parameters among the estimates of a fit, each with the side that it tells alone, if it does: those of
/// mechanisms have no stated value.
fn own_parameters(fitted: &Fitted) -> impl Iterator<Item = (&Estimate, Option<Runaway>)> {
    let all = fitted.estimates.iter().enumerate().filter(|(_, e)| !e.parameter.path.starts_with("mechanisms."));
    all.map(|(index, e)| (e, fitted.runaway(index)))
}

/// The rig's own parameters among the estimates of a fit that have a value.
pub(crate) fn own(fitted: &Fitted) -> Vec<Estimate> {
    own_parameters(fitted).filter(|(_, runaway)| runaway.is_none()).map(|(e, _)| e.clone()).collect()
}

/// The rig's own parameters of which only a side is known, in words.
pub(crate) fn sides_alone(fitted: &Fitted) -> Vec<String> {
    own_parameters(fitted).filter_map(|(e, runaway)| Some(runaway_in_words(e, &runaway?))).collect()
}

/// Says whether one of the rig's own parameters ends where its range does: the rig that was fitted is a part of the truth at most.
pub(crate) fn ends_with_its_range(fitted: &Fitted) -> bool {
    own_parameters(fitted).any(|(_, runaway)| runaway.is_some_and(|of| of.held_by == HeldBy::Range))
}

/// One of them in words: `volumes.chamber.volume_l is 0.167 L, 3.3 times the stated 0.05 L (24 times what such parts scatter by)`.
pub(crate) fn in_words(p: &DoubtfulParameter) -> String {
    let unit = if p.unit.is_empty() { String::new() } else { format!(" {}", p.unit) };
    let scatter = format!("{:.0} times what such parts scatter by", p.deviations.abs());
    match factor(p) {
        Some(factor) if factor > FACTOR => format!(
            "{} is {}{unit}, {:.1} times the stated {}{unit} ({scatter})",
            p.parameter,
            three(p.fitted),
            p.fitted / p.stated,
            three(p.stated)
        ),
        _ => format!("{} is {}{unit}, stated {}{unit} ({scatter})", p.parameter, three(p.fitted), three(p.stated)),
    }
}

/// By which factor a parameter is off, either way; `None` of one that was stated as nothing.
fn factor(p: &DoubtfulParameter) -> Option<f64> {
    let ratio = p.fitted / p.stated;
    (ratio.is_finite() && ratio > 0.0).then(|| ratio.max(1.0 / ratio))
}

/// The sentence of the headline; `None` where every parameter may be believed.
pub(crate) fn headline(all: &[DoubtfulParameter]) -> Option<String> {
    let unbelieved = |p: &&DoubtfulParameter| p.deviations.abs() > UNBELIEVED || factor(p).is_some_and(|f| f > FACTOR);
    let told: Vec<String> = all.iter().filter(unbelieved).take(3).map(in_words).collect();
    (!told.is_empty())
        .then(|| format!("For this some parameters went where nobody would believe them: {}.", told.join("; ")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use fit::parameters::Parameter;

    fn estimate(parameter: Parameter, value: f64) -> Estimate {
        let shift = parameter.coordinate(value);
        Estimate { parameter, value, sd: 0.1, shift, undetermined: 0.1 }
    }

    #[test]
    fn a_volume_that_moved_threefold_and_an_atmosphere_of_another_height_are_said() {
        let all = doubtful(&[
            estimate(Parameter::log("volumes.chamber.volume_l", 0.05, 0.05), 0.167),
            estimate(Parameter::linear("atmosphere.pressure_kpa_abs", 101.325, 0.5), 95.75),
            estimate(Parameter::log("volumes.other.volume_l", 0.05, 0.05), 0.052),
        ]);
        let names: Vec<&str> = all.iter().map(|p| p.parameter.as_str()).collect();
        assert_eq!(names, ["volumes.chamber.volume_l", "atmosphere.pressure_kpa_abs"]);
        let said = headline(&all).unwrap();
        assert!(said.contains("3.3 times the stated 0.0500 L") && said.contains("95.8 kPa, stated 101 kPa"), "{said}");
    }
}

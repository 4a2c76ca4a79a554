//! Combinations of parameters: which of them recordings determine, and which they leave open.
//!
//! Recordings of a closed machine hardly ever determine one parameter: a wider valve and a weaker spring move the pressures alike, and
//! twice the volumes with twice the flows move them not at all. What recordings do determine are combinations, some of them to a
//! thousandth. A figure is told of exactly the combination that is named, with its own standard error, and a parameter alone counts as
//! known only if it would be were nothing stated of the others.

use crate::least_squares::{Direction, Information};
use crate::objective::{Estimate, Fitted};
use crate::parameters::Transform;
use crate::wording::{percent, three_digits};

/// A combination whose standard error is still this share of what was known beforehand is not determined.
const HARDLY: f64 = 0.5;
/// Combinations that are told of those that are determined best.
const MOST_TOLD: usize = 3;
/// The most parameters of a combination that is told.
const MOST_PARTS: usize = 4;
/// The most parameters that are named beside the first of a combination that is open.
const MOST_OPEN: usize = 5;
/// The ratio that the standard error of the told parts of a combination may have to that of the whole.
const NEARLY: f64 = 1.5;
/// Share of their weight at which priors are left where it is asked what recordings say alone: twenty times as wide.
const NEXT_TO_NO_PRIOR: f64 = 1.0 / 400.0;
/// The most parameters of a scaling that are named one by one.
const MOST_SCALED: usize = 6;
/// Share of the information of single parameters by which errors of slopes (a thousandth) pass for information on their combination, and
/// as much again for chance.
const OF_SLOPES: f64 = 1e-5;
/// The distance from a whole number up to which an exponent is told as one.
const WHOLE: f64 = 0.05;
/// Decimals of the per cent to which a combination is known.
const DECIMALS: usize = 2;

/// Information on a combination, as multiples of the prior's, below which it is not determined: `1/√(1 + information) = HARDLY`.
const LEAST_INFORMATION: f64 = 1.0 / (HARDLY * HARDLY) - 1.0;

fn path(estimates: &[Estimate], index: usize) -> &str {
    estimates.get(index).map_or("?", |e| e.parameter.path.as_str())
}

/// Says what the recordings do not determine, one sentence a line; empty if they determine everything.
pub fn undetermined(fitted: &Fitted) -> Vec<String> {
    match &fitted.information {
        Some(information) => open(&fitted.estimates, information),
        None => vec!["some parameter without a prior does not show in these recordings at all".to_owned()],
    }
}

fn open(estimates: &[Estimate], information: &Information) -> Vec<String> {
    let name = |i: usize| path(estimates, i);
    let scaling = open_scaling(estimates, information);
    let mut said = Vec::new();
    let directions = match &scaling {
        Some(scaling) => {
            said.push(in_words(estimates, scaling));
            information.directions_beside(scaling)
        }
        None => information.directions(),
    };
    for direction in directions.iter().take_while(|direction| direction.information < LEAST_INFORMATION) {
        let parts = parts(direction, |kept| information.along(kept) < LEAST_INFORMATION);
        match parts.as_slice() {
            [(one, _)] => said.push(format!("{} hardly shows", name(*one))),
            [(first, sign), rest @ ..] => {
                // To move along the direction leaves the readings as they are: what one does the others undo.
                let (told, others) = rest.split_at(rest.len().min(MOST_OPEN));
                let others =
                    if others.is_empty() { String::new() } else { format!(", and {} others by less", others.len()) };
                said.push(format!("raising {} looks the same as {}{others}", name(*first), moves(told, -sign, name)));
            }
            [] => {}
        }
    }
    said
}

/// Parts of a combination, the largest first, until they are `enough`: what is left out must not be what makes it determined, or open.
fn parts(direction: &Direction, enough: impl Fn(&[f64]) -> bool) -> Vec<(usize, f64)> {
    let mut order: Vec<(usize, f64)> = direction.components.iter().copied().enumerate().collect();
    order.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    let mut kept = vec![0.0; order.len()];
    let mut parts = Vec::new();
    for (index, component) in order {
        if let Some(slot) = kept.get_mut(index) {
            *slot = component;
        }
        parts.push((index, component));
        if enough(&kept) {
            break;
        }
    }
    parts
}

/// The exponent with which a parameter changes where a rig is scaled: volumes, flows, and areas with the factor, resistances against it, anything else not.
fn exponent_of_scale(estimate: &Estimate) -> f64 {
    const WITH: [&str; 10] = [
        "volume_l",
        "compliance_ml_per_kpa",
        "flow_l_per_min",
        "area_mm2",
        "input_area_mm2",
        "pressure_area_mm2_per_n",
        "spring_area_mm2",
        "inlet_check_area_mm2",
        "outlet_check_area_mm2",
        "head_area_cm2",
    ];
    let path = &estimate.parameter.path;
    let key = path.rsplit('.').next().unwrap_or_default();
    if path.starts_with("mechanisms.") || estimate.parameter.transform == Transform::Linear {
        0.0
    } else if WITH.contains(&key) {
        1.0
    } else if key == "resistance_kpa_s_per_l" {
        -1.0
    } else {
        0.0
    }
}

/// The direction along which the rig is scaled, in coordinates, where the recordings say no more of it than was known before.
pub(super) fn open_scaling(estimates: &[Estimate], information: &Information) -> Option<Vec<f64>> {
    let scaling: Vec<f64> = estimates.iter().map(|e| exponent_of_scale(e) / e.parameter.scale()).collect();
    let of = |key: &str| estimates.iter().any(|e| e.parameter.path.ends_with(key));
    let several = scaling.iter().filter(|part| **part != 0.0).count() > 1;
    // What each of its parts does by itself, which the others take back but for the error of slopes.
    let by_parts = scaling
        .iter()
        .enumerate()
        .map(|(i, part)| part * part * information.data().get((i, i)).copied().unwrap_or(0.0));
    let length = scaling.iter().map(|part| part * part).sum::<f64>().max(f64::MIN_POSITIVE);
    let errors = OF_SLOPES * by_parts.sum::<f64>() / length;
    let is_open = information.along(&scaling) < LEAST_INFORMATION.max(errors);
    (several && of(".volume_l") && is_open).then_some(scaling)
}

/// The sentence for an open scaling.
fn in_words(estimates: &[Estimate], scaling: &[f64]) -> String {
    let of = |sign: f64| -> Vec<&str> {
        let those = estimates.iter().zip(scaling).filter(|(_, part)| **part * sign > 0.0);
        those.map(|(e, _)| e.parameter.path.as_str()).collect()
    };
    let (with, against) = (of(1.0), of(-1.0));
    let what = if with.len() + against.len() <= MOST_SCALED {
        let against = against.iter().map(|name| format!("1/{name}"));
        with.iter().map(|name| (*name).to_owned()).chain(against).collect::<Vec<_>>().join(", ")
    } else if against.is_empty() {
        "all volumes, flows and areas".to_owned()
    } else {
        "all volumes, flows and areas, and one over all resistances,".to_owned()
    };
    format!(
        "the size of the rig: {what} times one and the same factor leave the readings as they are, so that only their ratios are \
         determined; state one volume or flow that was measured"
    )
}

/// Says what the recordings determine, one sentence a line: how many combinations of the parameters, which by themselves, and the best
/// combinations with how well they are known.
pub fn determined(fitted: &Fitted) -> Vec<String> {
    fitted.information.as_ref().map_or_else(Vec::new, |information| known(&fitted.estimates, information))
}

fn known(estimates: &[Estimate], information: &Information) -> Vec<String> {
    let known = |direction: &&Direction| direction.information > LEAST_INFORMATION;
    let all = information.directions();
    let count = all.iter().filter(known).count();
    let alone = by_themselves(estimates, information);
    let names: Vec<&str> = alone.iter().map(|index| path(estimates, *index)).collect();
    let mut said = vec![format!(
        "{count} of {} combinations of parameters are known better than half of what was known before; by themselves {}",
        estimates.len(),
        if names.is_empty() { "none is".to_owned() } else { names.join(", ") }
    )];
    let mut directions = match open_scaling(estimates, information) {
        Some(scaling) => information.directions_beside(&scaling),
        None => all,
    };
    directions.retain(|direction| known(&direction));
    let told = directions.iter().rev().filter_map(|direction| one_known(estimates, information, direction, &alone));
    said.extend(told.take(MOST_TOLD));
    said
}

/// Parameters that are known better than half of what was known before, and would be if next to nothing were stated of any.
fn by_themselves(estimates: &[Estimate], information: &Information) -> Vec<usize> {
    let Some(alone) = information.sd_with_priors_of(NEXT_TO_NO_PRIOR) else { return Vec::new() };
    let those = estimates.iter().zip(&alone).enumerate();
    those.filter(|(_, (e, alone))| e.undetermined < HARDLY && **alone < HARDLY).map(|(index, _)| index).collect()
}

/// A combination that is determined with how well it is known; `None` where a few parameters do not make it up.
fn one_known(
    estimates: &[Estimate],
    information: &Information,
    direction: &Direction,
    alone: &[usize],
) -> Option<String> {
    // Per unit of the combination, so that parts can be compared with the whole.
    let sd = |weights: &[f64]| {
        let length = weights.iter().map(|w| w * w).sum::<f64>().sqrt().max(f64::MIN_POSITIVE);
        information.cautious_sd_of(weights) / length
    };
    let whole = sd(&direction.components);
    let parts = parts(direction, |kept| sd(kept) < NEARLY * whole);
    let (first, largest) = parts.first().copied()?;
    let estimate = estimates.get(first)?;
    if parts.len() > MOST_PARTS || parts.len() == 1 && !alone.contains(&first) {
        return None;
    }
    if parts.len() == 1 {
        return Some(format!("{} is known to {}", path(estimates, first), share(estimate, estimate.undetermined)));
    }
    let of = |index: &usize| estimates.get(*index).map(|e| (e.parameter.transform, e.parameter.scale()));
    let logarithmic = parts.iter().all(|(index, _)| of(index).is_some_and(|(t, _)| t == Transform::Log));
    let mut weights = vec![0.0; estimates.len()];
    if !logarithmic {
        for (index, component) in &parts {
            *weights.get_mut(*index)? = component / largest;
        }
        let known = share(estimate, information.cautious_sd_of(&weights));
        let (name, others) = (path(estimates, first), moves(parts.get(1..)?, largest, |i| path(estimates, i)));
        return Some(format!(
            "{name} is known only together with others (raising it while {others}), to {known} of it"
        ));
    }
    let mut factors = Vec::new();
    for (index, component) in &parts {
        let (_, scale) = of(index)?;
        // Of logarithms the combination is a product of powers, that of the first with exponent 1.
        let exponent = as_told(component / scale * estimate.parameter.scale() / largest);
        *weights.get_mut(*index)? = exponent * scale;
        factors.push((path(estimates, *index), exponent));
    }
    factors.retain(|(_, exponent)| *exponent != 0.0);
    let known = information.cautious_sd_of(&weights);
    // What was rounded for the reader must not be what made it known.
    let before = weights.iter().map(|w| w * w).sum::<f64>().sqrt();
    (factors.len() > 1 && known < HARDLY * before)
        .then(|| format!("{} is known to {}", product(&factors), percent(known, DECIMALS)))
}

/// A standard error in prior deviations, as a share of a parameter or in its unit.
fn share(estimate: &Estimate, sd: f64) -> String {
    let known = sd * estimate.parameter.scale();
    match estimate.parameter.transform {
        Transform::Log => percent(known, DECIMALS),
        Transform::Linear => format!("{} {}", three_digits(known), estimate.parameter.unit()),
    }
}

/// An exponent with two decimals, whole where it nearly is.
fn as_told(exponent: f64) -> f64 {
    let whole = exponent.round();
    if (exponent - whole).abs() < WHOLE { whole } else { (exponent * 100.0).round() / 100.0 }
}

/// A product of powers: `a · b^0.5 / (c · d)`.
fn product(factors: &[(&str, f64)]) -> String {
    let side = |sign: f64| -> Vec<String> {
        let those = factors.iter().filter(|(_, exponent)| exponent * sign > 0.0);
        those.map(|(name, e)| if e.abs() == 1.0 { (*name).to_owned() } else { format!("{name}^{}", e.abs()) }).collect()
    };
    match (side(1.0).join(" · "), side(-1.0).as_slice()) {
        (above, []) => above,
        (above, [below]) => format!("{above} / {below}"),
        (above, below) => format!("{above} / ({})", below.join(" · ")),
    }
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

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::least_squares::{Linearised, Loss};
    use crate::parameters::Parameter;

    /// Estimates and information of recordings that show some products of powers, each to a thousandth.
    pub(in crate::identify) fn shown(parameters: Vec<Parameter>, products: &[&[f64]]) -> (Vec<Estimate>, Information) {
        let column = |(index, parameter): (usize, &Parameter)| -> Vec<f64> {
            let of = |exponents: &&[f64]| 1e3 * exponents.get(index).copied().unwrap_or(0.0) * parameter.scale();
            products.iter().map(of).collect()
        };
        let jacobian: Vec<Vec<f64>> = parameters.iter().enumerate().map(column).collect();
        let at = Linearised { residuals: vec![0.0; products.len()], jacobian };
        let information = Information::of(&at, Loss::Gaussian, &vec![1.0; parameters.len()], &[]).unwrap();
        let sd = information.cautious_sd();
        let estimate = |(parameter, undetermined): (Parameter, f64)| Estimate {
            value: parameter.mean,
            sd: undetermined * parameter.scale() * parameter.mean,
            shift: 0.0,
            undetermined,
            parameter,
        };
        (parameters.into_iter().zip(sd).map(estimate).collect(), information)
    }

    pub(in crate::identify) fn cell() -> Vec<Parameter> {
        vec![
            Parameter::log("volumes.cell.volume_l", 1.0, 0.05),
            Parameter::log("pumps.p.flow_l_per_min", 5.0, 0.3),
            Parameter::log("lines.leak.resistance_kpa_s_per_l", 4e4, 0.3),
            Parameter::linear("atmosphere.pressure_kpa_abs", 101.3, 0.5),
        ]
    }

    /// One chamber that is filled and leaks shows flow over volume, and volume times resistance: nothing by itself.
    #[test]
    fn of_a_chamber_that_is_filled_ratios_are_known_and_no_parameter_is() {
        let (estimates, information) = shown(cell(), &[&[-1.0, 1.0, 0.0, 0.0], &[1.0, 0.0, 1.0, 0.0]]);
        let said = known(&estimates, &information);
        assert!(said[0].starts_with("2 of 4 combinations") && said[0].ends_with("by themselves none is"), "{said:?}");
        let alone = |line: &&String| ["volumes", "pumps", "lines"].iter().filter(|t| line.contains(**t)).count() < 2;
        assert_eq!(said.iter().skip(1).filter(alone).count(), 0, "{said:?}");
        assert!(said.len() > 1 && said.iter().all(|line| !line.contains("0.00 %")), "{said:?}");
        let said = open(&estimates, &information);
        assert!(said[0].contains("only their ratios") && said[0].contains("state one volume or flow"), "{said:?}");
        assert!(said[0].contains("1/lines.leak.resistance_kpa_s_per_l"), "{said:?}");
        assert_eq!(said[1..], ["atmosphere.pressure_kpa_abs hardly shows"]);
    }

    /// A figure is that of the combination as it is named: of flow over volume a thousandth, of the flow alone what the volume leaves.
    #[test]
    fn a_figure_belongs_to_what_is_named() {
        let (estimates, information) = shown(cell(), &[&[-1.0, 1.0, 0.0, 0.0]]);
        let said = known(&estimates, &information);
        assert_eq!(said[1..], ["pumps.p.flow_l_per_min / volumes.cell.volume_l is known to 0.10 %"]);
    }

    #[test]
    fn a_combination_that_is_known_very_well_is_not_known_to_nothing() {
        let (estimates, information) = shown(cell(), &[&[-100.0, 100.0, 0.0, 0.0]]);
        let said = known(&estimates, &information);
        assert_eq!(said[1..], ["pumps.p.flow_l_per_min / volumes.cell.volume_l is known to less than 0.01 %"]);
    }

    #[test]
    fn what_shows_by_itself_is_known_by_itself() {
        let (estimates, information) = shown(cell(), &[&[0.0, 1.0, 0.0, 0.0]]);
        let said = known(&estimates, &information);
        assert!(said[0].ends_with("by themselves pumps.p.flow_l_per_min"), "{said:?}");
        assert_eq!(said[1], "pumps.p.flow_l_per_min is known to 0.10 %");
        // One flow is known, so the rig has a size.
        assert!(open(&estimates, &information).iter().all(|line| !line.contains("the size of the rig")));
    }
}

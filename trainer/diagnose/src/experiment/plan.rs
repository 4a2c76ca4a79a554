//! The experiment that tells rivals apart: programmes chosen one by one, checked to be safe.

use fit::data::Records;
use fit::simulate::{Arcs, Fidelity, Run, Simulator};
use model::plant::Input;
use model::rig::Rig;
use nalgebra::DMatrix;
use proto::recording::csv::{self, Column, ColumnData};
use proto::recording::{PERIOD_S, Recording};

use super::backwards::backwards;
use super::limits::limits_kpa;
use super::menu::{Programme, SHUT_IN, Usage, menu};
use super::separation::{PairSums, Predicted};
use crate::bench::{Bench, Explanation};
use crate::error::DiagnoseError;
use crate::search::candidate::{leaks, reads_wrong};

/// The longest experiment in s.
const LONGEST_S: f64 = 120.0;
/// Expected difference of log-likelihoods (D/2) that is planned for: that of two rivals which stay 0.1 kPa apart for half
/// a minute, both pressures together. Less is told apart by the noise alone, but not by a model that is a little off.
const ENOUGH: f64 = 400.0;
/// Expected difference at which rivals count as told apart: odds of e¹⁰, for what is expected is not what will be.
const DECIDES: f64 = 10.0;
/// Errors of a model in an experiment of a kind that nothing was fitted to, in kPa, on top of the noise.
const FOREIGN_KPA: f64 = 0.2;
/// Such errors where a pump stands, in kPa: where its cylinders stopped, and what they hold, is told by no reading.
const AT_REST_KPA: f64 = 0.5;
/// Step of a finite difference, in prior standard deviations.
const STEP: f64 = 0.05;

/// An experiment.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Names of the programmes, in order.
    pub programmes: Vec<String>,
    /// Input columns.
    pub columns: Vec<String>,
    /// Commands, `[input][row]`.
    pub inputs: Vec<Vec<f64>>,
    /// Expected difference of log-likelihoods of each pair of rivals, `(one, other, D/2)`.
    pub separation: Vec<(usize, usize, f64)>,
    /// Readings that each rival predicts, `[rival]` in the layout `[channel][row]`.
    pub predicted_kpa: Vec<Vec<f64>>,
}

impl Plan {
    /// Time in s, by row.
    pub fn time_s(&self) -> Vec<f64> {
        (0..self.inputs.first().map_or(0, Vec::len)).map(|row| row as f64 * PERIOD_S).collect()
    }

    /// The text of `next_experiment.csv`.
    pub fn to_csv(&self) -> String {
        let columns: Vec<Column> = self
            .columns
            .iter()
            .zip(&self.inputs)
            .map(|(name, values)| Column {
                name: name.clone(),
                data: ColumnData::Numbers(values.iter().map(|v| (v * 1e4).round() / 1e4).collect()),
            })
            .collect();
        let time_s: Vec<f64> = self.time_s().iter().map(|t| (t * 1e2).round() / 1e2).collect();
        csv::to_csv(&time_s, &columns)
    }

    /// Tells whether every pair is told apart.
    pub fn decides(&self) -> bool {
        self.separation.iter().all(|(_, _, half_d)| *half_d >= DECIDES)
    }
}

/// Rivals in pairs, with all that tells how far apart programmes would put them.
struct Pairs<'a> {
    /// Rivals of each pair, by their numbers.
    members: Vec<(usize, usize)>,
    /// Sums of each pair, `[programme][pair]`.
    sums: Vec<Vec<PairSums>>,
    /// Information on each rival's coordinates before the experiment.
    known: &'a [DMatrix<f64>],
}

impl Pairs<'_> {
    /// Expected difference of log-likelihoods (D/2) of the pair number `at`, given its sums.
    fn half_divergence(&self, sums: &PairSums, at: usize) -> f64 {
        let (one, other) = self.members[at];
        0.5 * sums.divergence(&self.known[one], &self.known[other])
    }

    /// Expected difference of log-likelihoods (D/2) of the pair number `at` in some programmes.
    fn apart(&self, chosen: &[usize], at: usize) -> f64 {
        let of_pair = chosen.iter().filter_map(|p| self.sums.get(*p).and_then(|s| s.get(at)).cloned());
        of_pair.reduce(|a, b| a.and(&b)).map_or(0.0, |total| self.half_divergence(&total, at))
    }
}

/// Fidelity of plans: stroke by stroke, for pumps that stand are what averaged ones are worst at.
const PLANNING: Fidelity = Fidelity::Coarse;

/// Plans an experiment between rivals; `None` where there are fewer than two, or nothing safe separates them.
///
/// # Errors
/// A rival cannot be simulated.
pub fn plan(bench: &Bench<'_>, rivals: &[&Explanation]) -> Result<Option<Plan>, DiagnoseError> {
    if rivals.len() < 2 {
        return Ok(None);
    }
    let inputs = bench.records.inputs();
    let usage = usage(bench);
    let programmes: Vec<Programme> = menu(bench.rig, inputs, &usage);
    if programmes.is_empty() {
        return Ok(None);
    }
    let recordings = programmes.iter().map(|p| blank(bench, inputs, p)).collect::<Result<Vec<_>, _>>()?;
    let records = Records::new(bench.rig, &recordings)?;
    let simulator = Simulator::new(&records, PLANNING);
    let predicted = rivals.iter().map(|rival| predict(&simulator, rival)).collect::<Result<Vec<_>, _>>()?;
    let known: Vec<DMatrix<f64>> = rivals.iter().map(|rival| information(rival)).collect();
    let leaky = is_in_question(bench, rivals, leaks);
    // A pump that stands is what models are worst at, and brings out leaks too small to matter. What passes the rings shows while it
    // turns.
    let shows_at_rest = |id: &str| reads_wrong(id) || leaks(id) && id != "piston_blowby";
    let may_stand = is_in_question(bench, rivals, shows_at_rest);
    let limits_kpa = limits_kpa(bench);
    let within_limits: Vec<usize> = (0..programmes.len())
        .filter(|p| predicted.iter().all(|(base, _)| within(&records, *p, base, &limits_kpa)))
        .collect();
    let safe: Vec<usize> =
        within_limits.iter().copied().filter(|p| may_stand || !programmes[*p].stops_a_pump).collect();
    let members: Vec<(usize, usize)> =
        (0..rivals.len()).flat_map(|i| (i + 1..rivals.len()).map(move |k| (i, k))).collect();
    let sums = (0..programmes.len())
        .map(|p| {
            let foreign_kpa = if programmes[p].stops_a_pump { AT_REST_KPA } else { FOREIGN_KPA };
            let sigma: Vec<f64> = bench.noise.iter().map(|n| n.sigma_kpa.hypot(foreign_kpa)).collect();
            let of: Vec<Predicted> =
                predicted.iter().map(|(base, columns)| cut(&records, p, base, columns, &sigma)).collect();
            members.iter().map(|(i, k)| PairSums::of(&of[*i], &of[*k])).collect()
        })
        .collect();
    let pairs = Pairs { members, sums, known: &known };
    // Leaks pass for each other, and for other parameters, where a valve is open, and not all that do are among the rivals.
    let leaky = leaky || rivals.iter().any(|rival| rival.terms.is_empty());
    let is_shut_in = |p: &&usize| programmes.get(**p).is_some_and(|programme| programme.name == SHUT_IN);
    let shut_in = within_limits.iter().find(is_shut_in).copied().filter(|_| leaky);
    let kept_s = shut_in.and_then(|p| programmes.get(p)).map_or(0.0, Programme::seconds);
    let traces: Vec<&[f64]> = predicted.iter().map(|(base, _)| base.as_slice()).collect();
    let backwards = backwards(&simulator, rivals, &traces)?;
    let forwards: Vec<usize> = safe.iter().copied().filter(|p| backwards.get(*p) != Some(&true)).collect();
    let from = |among: &[usize]| choose(&programmes, among, &pairs, shut_in, LONGEST_S - kept_s);
    let mut chosen = from(&forwards);
    let decided = |at: usize| pairs.apart(&chosen, at) >= DECIDES;
    if forwards.len() < safe.len() && !(0..pairs.members.len()).all(decided) {
        chosen = from(&safe);
    }
    if chosen.is_empty() {
        return Ok(None);
    }
    chosen.extend(shut_in.filter(|p| !chosen.contains(p)));
    finish(bench, rivals, &programmes, &chosen, &pairs, &limits_kpa).map(Some)
}

/// Adds programmes while the least separated pair gains from it and time is left; `kept` has time of its own.
fn choose(
    programmes: &[Programme],
    safe: &[usize],
    pairs: &Pairs<'_>,
    kept: Option<usize>,
    longest_s: f64,
) -> Vec<usize> {
    let mut chosen: Vec<usize> = Vec::new();
    let mut total: Option<Vec<PairSums>> = None;
    let mut reached = 0.0;
    let mut seconds = 0.0;
    loop {
        let mut best: Option<(f64, usize, Vec<PairSums>, f64)> = None;
        for p in safe.iter().filter(|p| !chosen.contains(p)) {
            let length = programmes.get(*p).map_or(0.0, Programme::seconds);
            if kept != Some(*p) && seconds + length > longest_s {
                continue;
            }
            let Some(own) = pairs.sums.get(*p) else { continue };
            let with: Vec<PairSums> = match &total {
                Some(total) => total.iter().zip(own).map(|(a, b)| a.and(b)).collect(),
                None => own.clone(),
            };
            // Pairs that are told apart already count no further.
            let value: f64 = with.iter().enumerate().map(|(at, s)| pairs.half_divergence(s, at).min(ENOUGH)).sum();
            let rate = (value - reached) / length.max(1.0);
            if best.as_ref().is_none_or(|(r, ..)| rate > *r) {
                best = Some((rate, *p, with, value));
            }
        }
        // A programme that brings less than a twentieth of a unit per second is not worth anyone's time.
        let Some((_, p, with, value)) = best.filter(|(rate, ..)| *rate > 0.02) else { break };
        if kept != Some(p) {
            seconds += programmes.get(p).map_or(0.0, Programme::seconds);
        }
        chosen.push(p);
        total = Some(with);
        reached = value;
        if reached >= ENOUGH * pairs.members.len() as f64 - 1e-6 {
            break;
        }
    }
    chosen
}

/// Joins the chosen programmes and simulates the whole, which must stay within the limits as each of them does.
fn finish(
    bench: &Bench<'_>,
    rivals: &[&Explanation],
    programmes: &[Programme],
    chosen: &[usize],
    pairs: &Pairs<'_>,
    limits_kpa: &[[f64; 2]],
) -> Result<Plan, DiagnoseError> {
    let inputs = bench.records.inputs();
    let mut chosen = chosen.to_vec();
    loop {
        let picked: Vec<&Programme> = chosen.iter().filter_map(|p| programmes.get(*p)).collect();
        let joined = Programme {
            name: "experiment".to_owned(),
            stops_a_pump: picked.iter().any(|p| p.stops_a_pump),
            inputs: (0..inputs.len())
                .map(|i| picked.iter().flat_map(|p| p.inputs.get(i).cloned().unwrap_or_default()).collect())
                .collect(),
        };
        let records = Records::new(bench.rig, &[blank(bench, inputs, &joined)?])?;
        let simulator = Simulator::new(&records, PLANNING);
        let predicted_kpa = rivals
            .iter()
            .map(|rival| simulator.one(&rival.fitted.rig, &Arcs::free(&records)))
            .collect::<Result<Vec<_>, _>>()?;
        let safe = predicted_kpa.iter().all(|trace| within(&records, 0, trace, limits_kpa));
        if safe || chosen.len() == 1 {
            let told = |(at, (i, k)): (usize, &(usize, usize))| (*i, *k, pairs.apart(&chosen, at));
            let separation = pairs.members.iter().enumerate().map(told).collect();
            return Ok(Plan {
                programmes: picked.iter().map(|p| p.name.clone()).collect(),
                columns: inputs.iter().map(|input| input.column.clone()).collect(),
                inputs: joined.inputs,
                separation,
                predicted_kpa,
            });
        }
        chosen.pop();
    }
}

/// Tells whether a mechanism of some kind is in question: in one of the rivals, and not in all of them.
fn is_in_question(bench: &Bench<'_>, rivals: &[&Explanation], of_kind: impl Fn(&str) -> bool) -> bool {
    let in_all = |term: &usize| rivals.iter().all(|other| other.terms.contains(term));
    rivals.iter().any(|rival| {
        let added = rival.fitted.rig.mechanisms.iter().skip(bench.rig.mechanisms.len());
        rival.terms.iter().zip(added).any(|(term, m)| !in_all(term) && of_kind(m.mechanism.id()))
    })
}

/// Use of the inputs in the recordings.
fn usage(bench: &Bench<'_>) -> Usage {
    let inputs = bench.records.inputs().len();
    let mut usage = Usage { middle: vec![0.5; inputs], low: vec![0.3; inputs], high: vec![0.9; inputs] };
    for i in 0..inputs {
        let mut all: Vec<f64> = bench
            .records
            .records()
            .iter()
            .flat_map(|r| r.inputs.get(i).map(Vec::as_slice).unwrap_or_default())
            .copied()
            .filter(|u| *u > 0.05)
            .collect();
        all.sort_by(f64::total_cmp);
        let at = |share: f64| all.get(((all.len() as f64 - 1.0) * share).max(0.0) as usize).copied();
        if let (Some(low), Some(middle), Some(high)) = (at(0.05), at(0.5), at(0.95)) {
            (usage.low[i], usage.middle[i], usage.high[i]) = (low, middle, high);
        }
    }
    usage
}

/// A recording of commands whose readings are not known: it starts at rest.
fn blank(bench: &Bench<'_>, inputs: &[Input], programme: &Programme) -> Result<Recording, DiagnoseError> {
    let rows = programme.rows();
    let numbers = |name: &str, values: Vec<f64>| Column { name: name.to_owned(), data: ColumnData::Numbers(values) };
    let mut columns: Vec<Column> =
        inputs.iter().zip(&programme.inputs).map(|(input, values)| numbers(&input.column, values.clone())).collect();
    columns.extend(bench.records.sensors().iter().map(|sensor| numbers(sensor, vec![0.0; rows])));
    let time_s = (0..rows).map(|row| row as f64 * PERIOD_S).collect();
    Ok(Recording::new(&programme.name, time_s, columns)?)
}

/// A rival's free runs and their derivatives.
fn predict(simulator: &Simulator<'_>, rival: &Explanation) -> Result<(Vec<f64>, Vec<Vec<f64>>), DiagnoseError> {
    let point = &rival.fitted.point;
    let problem = |rig: &Rig| {
        let name = rig.name.clone();
        move |problem| DiagnoseError::Rig { rig: name.clone(), problem }
    };
    let mut runs = vec![Run::from(rival.fitted.rig.clone())];
    let mut steps = Vec::new();
    for (i, [_, high]) in rival.set.bounds().into_iter().enumerate() {
        let mut varied = point.clone();
        let step = if varied[i] + STEP > high { -STEP } else { STEP };
        varied[i] += step;
        steps.push(step);
        runs.push(Run::from(rival.set.rig_at(&varied).map_err(problem(rival.set.rig()))?));
    }
    let mut traces = simulator
        .run(&runs, &Arcs::free(simulator.records()))
        .into_iter()
        .collect::<Result<Vec<_>, _>>()
        .map_err(problem(rival.set.rig()))?
        .into_iter();
    let base = traces.next().unwrap_or_default();
    let columns =
        traces.zip(steps).map(|(trace, step)| trace.iter().zip(&base).map(|(t, b)| (t - b) / step).collect()).collect();
    Ok((base, columns))
}

/// The part of one programme, over σ.
fn cut(records: &Records, programme: usize, base: &[f64], columns: &[Vec<f64>], sigma: &[f64]) -> Predicted {
    let layout = records.layout();
    let take = |trace: &[f64]| -> Vec<f64> {
        (0..layout.channels())
            .flat_map(|c| {
                let s = sigma.get(c).copied().unwrap_or(0.2);
                trace.get(layout.channel(programme, c)).unwrap_or_default().iter().map(move |kpa| kpa / s)
            })
            .collect()
    };
    Predicted { readings: take(base), jacobian: columns.iter().map(|c| take(c)).collect() }
}

/// Information on a rival's coordinates: what was recorded, and the priors.
fn information(rival: &Explanation) -> DMatrix<f64> {
    let n = rival.set.len();
    let prior = rival.set.prior();
    let mut known = match &rival.fitted.information {
        Some(information) => information.data().clone(),
        None => DMatrix::zeros(n, n),
    };
    for (i, p) in prior.iter().enumerate().take(known.nrows()) {
        known[(i, i)] += p + 1e-6;
    }
    known
}

/// Tells whether a trace of a programme stays within limits by channel, in kPa gauge.
fn within(records: &Records, programme: usize, trace: &[f64], limits_kpa: &[[f64; 2]]) -> bool {
    let layout = records.layout();
    (0..layout.channels()).all(|channel| {
        let Some([low, high]) = limits_kpa.get(channel) else { return false };
        let readings = trace.get(layout.channel(programme, channel));
        readings.is_some_and(|readings| readings.iter().all(|kpa| (low..=high).contains(&kpa)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// However much there is to gain, what is chosen and the shut-in that ends it last two minutes together.
    #[test]
    fn the_shut_in_has_time_of_its_own() {
        let programme = |seconds: usize| {
            let inputs = vec![vec![0.5; seconds * 50]];
            Programme { name: String::new(), inputs, stops_a_pump: false }
        };
        let programmes: Vec<Programme> = [17, 22, 22, 22, 22, 22, 22].into_iter().map(programme).collect();
        // Each programme tells a pair of its own, which none has left undecided before.
        let nothing = Predicted { readings: vec![0.0], jacobian: vec![] };
        let told = |by: f64| PairSums::of(&Predicted { readings: vec![by], jacobian: vec![] }, &nothing);
        let members: Vec<(usize, usize)> = (1..7).map(|p| (0, p)).collect();
        let sums = |p: usize| members.iter().map(|(_, k)| told(if *k == p { 40.0 } else { 0.0 })).collect();
        let sums = (0..7).map(sums).collect();
        let (safe, known): (Vec<usize>, Vec<_>) = ((0..7).collect(), vec![DMatrix::zeros(0, 0); 7]);
        let pairs = Pairs { members, sums, known: &known };
        let seconds = |kept: Option<usize>, longest_s: f64| {
            let chosen = choose(&programmes, &safe, &pairs, kept, longest_s);
            let all: std::collections::BTreeSet<usize> = chosen.into_iter().chain(kept).collect();
            all.into_iter().map(|p| programmes[p].seconds()).sum::<f64>()
        };
        assert!((seconds(None, LONGEST_S) - 110.0).abs() < 1e-9);
        assert!((seconds(Some(0), LONGEST_S - 17.0) - 105.0).abs() < 1e-9);
    }
}

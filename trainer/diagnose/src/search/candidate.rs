//! Candidates for what may be missing: a mechanism at a place each, with what is free in it.
//!
//! The list is the model's ([`model::mechanism::candidates`]); here it gets priors (`prior`).

use std::collections::BTreeMap;

use fit::parameters::{Parameter, Transform};
use model::mechanism::{Candidate as Offered, CandidateParameter};
use model::rig::{MechanismInstance, Rig};
use proto::diagnosis::RangeEnd;

use crate::search::place::side;
use crate::search::prior::{ONSET, neutral, parameter};

/// Mechanisms that let air pass where the paper's rig has none: what a hold with the pump off is made to show.
const LEAKS: [&str; 3] = ["chamber_leak", "cross_leak", "piston_blowby"];

/// A number within a hundredth of an end of its range is at it.
const AT_ITS_END: f64 = 1.01;

/// Factor by which the range of a magnitude is widened at a time.
const WIDER: f64 = 30.0;

/// Tells whether a mechanism lets air pass where the paper's rig has none.
pub(crate) fn leaks(id: &str) -> bool {
    LEAKS.contains(&id)
}

/// Tells whether one of some candidates [`leaks`].
pub(crate) fn is_leak(candidates: &[Candidate], term: usize) -> bool {
    candidates.get(term).is_some_and(|candidate| leaks(&candidate.id))
}

/// Mechanisms by which a reading is off where the pressure is known: at rest, open to the air.
const READINGS: [&str; 3] = ["sensor_bias", DRIFT, "sensor_gain"];
/// The one of them that comes with time.
pub(crate) const DRIFT: &str = "sensor_drift";

/// Tells whether a mechanism makes a reading wrong where the pressure is known.
pub(crate) fn reads_wrong(id: &str) -> bool {
    READINGS.contains(&id)
}

/// A mechanism at a component.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// The mechanism's id.
    pub id: String,
    /// Which of its shapes, where it has several; empty otherwise.
    pub form: String,
    /// The component it is attached to.
    pub component: String,
    /// `positive`, `negative` or `both`.
    pub side: String,
    offered: Offered,
    /// Ranges that have been widened, by place among the parameters.
    widened: BTreeMap<usize, [f64; 2]>,
    /// Values that fits may start from, one list per start, in the order of the parameters.
    pub starts: Vec<Vec<f64>>,
}

impl Candidate {
    /// `id:side`, the name that diagnoses use.
    pub fn name(&self) -> String {
        format!("{}:{}", self.id, self.side)
    }

    /// The name with the shape.
    pub fn full_name(&self) -> String {
        if self.form.is_empty() { self.name() } else { format!("{} ({})", self.name(), self.form) }
    }

    /// Parameters that are free in it.
    pub fn len(&self) -> usize {
        self.offered.parameters.len()
    }

    /// Tells whether nothing is free in it.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Values in the middle of those that fits may start from.
    pub(crate) fn middle_start(&self) -> Vec<f64> {
        self.starts.get(self.starts.len() / 2).cloned().unwrap_or_default()
    }

    /// Unit of its first parameter.
    pub fn unit(&self) -> &'static str {
        self.offered.parameters.first().map_or("", |p| p.unit)
    }

    /// Tells whether readings change in steps as its first parameter does: least squares sees no slope in it.
    pub fn stepped(&self) -> bool {
        self.offered.stepped
    }

    /// Tells whether it is of interest in a rig that has these terms as well: its shape tells itself from another one only beside
    /// certain mechanisms.
    pub fn is_apt(&self, rig: &Rig, beside: &[&Candidate]) -> bool {
        let there = |id: &str, component: &str| component == self.component && self.offered.beside.contains(&id);
        self.offered.beside.is_empty()
            || beside.iter().any(|term| there(&term.id, &term.component))
            || rig.mechanisms.iter().any(|m| m.enabled && there(m.mechanism.id(), &m.component))
    }

    /// Tells whether it is a richer shape, to be tried in place of a plainer one that was found.
    pub fn is_refinement(&self) -> bool {
        self.offered.refinement
    }

    /// Tells whether both are shapes of one mechanism there that differ only beside certain others.
    pub fn differs_beside(&self, other: &Candidate) -> bool {
        self.excludes(other)
            && self.form != other.form
            && !(self.offered.beside.is_empty() && other.offered.beside.is_empty())
    }

    /// Tells whether it is the same mechanism there in a plainer shape: the first few of the other's parameters, and no others.
    pub fn is_plainer_than(&self, other: &Candidate) -> bool {
        self.excludes(other) && self.len() < other.len() && self.keys().zip(other.keys()).all(|(own, its)| own == its)
    }

    /// The parameter by which its kind is told from something faster (its place and key), and the least that is plausible for
    /// it, if one of these `values` is no more than that.
    pub fn too_fast(&self, values: &[f64]) -> Option<(usize, &'static str, f64)> {
        let parameters = self.offered.parameters.iter().zip(values).enumerate();
        let mut ends = parameters.filter(|(_, (p, value))| p.slow && **value <= AT_ITS_END * p.low);
        ends.next().map(|(place, (p, _))| (place, p.key, p.low))
    }

    /// Tells whether it moves readings over tens of seconds, whatever is commanded: a drift, or what warms.
    pub fn is_slow(&self) -> bool {
        self.id == DRIFT || self.offered.parameters.iter().any(|p| p.slow)
    }

    /// Sum of the times among these values, in ms: all its time constants and delays.
    pub(crate) fn times_ms(&self, values: &[f64]) -> f64 {
        let times = self.offered.parameters.iter().zip(values).filter(|(p, _)| p.unit == "ms");
        times.map(|(_, ms)| ms).sum()
    }

    /// Keys of its free parameters, in their order.
    pub fn keys(&self) -> impl Iterator<Item = &'static str> + '_ {
        self.offered.parameters.iter().map(|p| p.key)
    }

    /// Tells whether both cannot be in one rig at a time.
    pub fn excludes(&self, other: &Candidate) -> bool {
        self.id == other.id && self.component == other.component
    }

    /// Tells whether both are one mechanism in one shape, wherever they are.
    pub fn is_like(&self, other: &Candidate) -> bool {
        self.id == other.id && self.form == other.form
    }

    /// Tells whether the same component elsewhere in the rig has it too, as likely as not: no leak, no zero or gain of a sensor,
    /// and nothing that begins at a moment.
    pub fn is_of_the_make(&self) -> bool {
        !leaks(&self.id) && !reads_wrong(&self.id) && self.onset().is_none()
    }

    /// Which of its parameters tells when it begins, if one does.
    pub fn onset(&self) -> Option<usize> {
        self.offered.parameters.iter().position(|p| p.key == ONSET)
    }

    /// Values at which the effect is `a` times what it is at `start` (`a > 0`), to first order in the first parameter.
    pub fn scaled(&self, start: &[f64], a: f64) -> Vec<f64> {
        let mut values = start.to_vec();
        if let (Some(parameter), Some(first), Some(offered)) =
            (self.parameters(0).into_iter().next(), values.first_mut(), self.offered.parameters.first())
        {
            let neutral = if parameter.transform == Transform::Linear { parameter.mean } else { 0.0 };
            let [low, high] = parameter.bounds;
            *first = (neutral + a.powf(1.0 / offered.power) * (*first - neutral)).clamp(low, high);
        }
        values
    }

    /// The entry of a rig file, with these values.
    pub fn attached(&self, values: &[f64]) -> MechanismInstance {
        self.offered.attached(values)
    }

    /// The free parameters when it is mechanism number `at` of the rig.
    pub fn parameters(&self, at: usize) -> Vec<Parameter> {
        let of = |(place, p): (usize, &CandidateParameter)| {
            let free = parameter(&self.id, p, format!("mechanisms.{at}.{}", p.key));
            let bounds = self.widened.get(&place).copied().unwrap_or(free.bounds);
            Parameter { bounds, ..free }
        };
        self.offered.parameters.iter().enumerate().map(of).collect()
    }

    /// The end of its range at which the number at `place` stands, if it does and that is no end of nature: a share of nothing or of
    /// all, the value at which a mechanism does nothing, the moment at which something begins, or a time constant that is asked
    /// for by itself ([`Candidate::too_fast`]).
    pub fn end_of_range(&self, place: usize, value: f64) -> Option<RangeEnd> {
        let offered = self.offered.parameters.get(place)?;
        let free = self.parameters(0).into_iter().nth(place)?;
        if offered.key == ONSET {
            return None;
        }
        let [low, high] = free.bounds;
        let end = match free.transform {
            Transform::Log if value <= AT_ITS_END * low => RangeEnd::Low,
            Transform::Log if AT_ITS_END * value >= high => RangeEnd::High,
            Transform::Linear if value - low <= (AT_ITS_END - 1.0) * (high - low) => RangeEnd::Low,
            Transform::Linear if high - value <= (AT_ITS_END - 1.0) * (high - low) => RangeEnd::High,
            _ => return None,
        };
        let [least, most] = offered.accepted;
        let (bound, of_nature) = if end == RangeEnd::Low { (low, low <= least) } else { (high, high >= most) };
        let does_nothing =
            neutral(&self.id, offered).is_some_and(|neutral| (neutral - bound).abs() <= 1e-9 * (high - low));
        let asked_elsewhere = offered.slow && end == RangeEnd::Low;
        (!(does_nothing || asked_elsewhere || place > 0 && of_nature)).then_some(end)
    }

    /// A new end for the range of the number at `place`, as far beyond the old one as a rig file may hold; `None` where that is no
    /// further.
    pub fn wider(&self, place: usize, end: RangeEnd) -> Option<f64> {
        let free = self.parameters(0).into_iter().nth(place)?;
        let ([low, high], [least, most]) = (free.bounds, self.offered.parameters.get(place)?.accepted);
        let wider = match (free.transform, end) {
            (Transform::Log, RangeEnd::Low) => low / WIDER,
            (Transform::Log, RangeEnd::High) => high * WIDER,
            (Transform::Linear, RangeEnd::Low) => low - (high - low),
            (Transform::Linear, RangeEnd::High) => high + (high - low),
        };
        let wider = wider.clamp(least, most);
        // A logarithm needs something to begin with.
        let there = free.transform == Transform::Linear || wider > 0.0;
        (there && (wider < low || wider > high)).then_some(wider)
    }

    /// Moves one end of the range of the number at `place`.
    pub fn widen(&mut self, place: usize, end: RangeEnd, to: f64) {
        let Some(free) = self.parameters(0).into_iter().nth(place) else { return };
        let [low, high] = free.bounds;
        self.widened.insert(place, if end == RangeEnd::Low { [to, high] } else { [low, to] });
    }
}

/// Names of terms, for notes.
pub(crate) fn names_of(candidates: &[Candidate], terms: &[usize]) -> String {
    terms.iter().filter_map(|t| candidates.get(*t)).map(Candidate::name).collect::<Vec<_>>().join(" with ")
}

/// Candidates as far as samples `sampling_s` apart can tell them: time constants and delays from there on. A kind of which no more
/// than twice that is plausible is left out; one that fits best as fast as that is something faster.
pub(crate) fn no_faster_than(candidates: Vec<Candidate>, sampling_s: f64) -> Vec<Candidate> {
    let least_ms = 1e3 * sampling_s;
    let of = |mut candidate: Candidate| {
        for p in candidate.offered.parameters.iter_mut().filter(|p| p.unit == "ms" && p.low < least_ms) {
            if p.high < 2.0 * least_ms {
                return None;
            }
            p.low = least_ms;
            p.slow = true;
            p.usual = p.usual.filter(|[usual, _]| *usual >= least_ms);
            p.starts.retain(|start| *start > least_ms);
            if p.starts.is_empty() {
                p.starts.push((2.0 * least_ms).min(p.high));
            }
        }
        candidate.starts = starts(&candidate.offered.parameters);
        Some(candidate)
    };
    candidates.into_iter().filter_map(of).collect()
}

/// Everything that may be missing from a rig.
pub fn candidates(rig: &Rig) -> Vec<Candidate> {
    model::mechanism::candidates(rig)
        .into_iter()
        .filter(|offered| !offered.parameters.is_empty() && !is_bias_of_a_root(rig, offered))
        .map(|offered| Candidate {
            id: offered.id.to_owned(),
            form: offered.form.to_owned(),
            component: offered.component.clone(),
            side: side(rig, std::slice::from_ref(&offered.component)),
            starts: starts(&offered.parameters),
            widened: BTreeMap::new(),
            offered,
        })
        .collect()
}

/// Tells whether a candidate is a constant error of a reading that is made through a root: the meter's own zero lies
/// under the root, so that its error is large where little flows and gone where much does, and no constant.
fn is_bias_of_a_root(rig: &Rig, offered: &Offered) -> bool {
    let constant = ["sensor_bias", DRIFT].contains(&offered.id);
    let terms =
        rig.sensors.get(&offered.component).and_then(|sensor| rig.recording.as_ref()?.columns.get(&sensor.column));
    constant && terms.is_some_and(|terms| terms.0.iter().any(|term| term.root))
}

/// First magnitudes: all of the first parameter with the first of the others, then the others varied.
fn starts(parameters: &[CandidateParameter]) -> Vec<Vec<f64>> {
    let first: Vec<f64> = parameters.iter().map(|p| p.starts.first().copied().unwrap_or(p.low)).collect();
    let mut all = Vec::new();
    for (at, p) in parameters.iter().enumerate() {
        for start in &p.starts {
            // A shape is tried at a magnitude that shows.
            let mut values = first.clone();
            if at > 0
                && let (Some(slot), Some(p)) = (values.first_mut(), parameters.first())
            {
                *slot = p.starts.get(p.starts.len() / 2).copied().unwrap_or(*slot);
            }
            if let Some(slot) = values.get_mut(at) {
                *slot = *start;
            }
            if !all.contains(&values) {
                all.push(values);
            }
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sparse_samples_tell_no_fast_time_constant() {
        let all = candidates(&Rig::builtin("dual_pressure").unwrap());
        let lag = |all: &[Candidate]| all.iter().find(|c| c.id == "sensor_lag" && c.form.is_empty()).cloned();
        let left = no_faster_than(all.clone(), 0.1);
        let (before, after) = (lag(&all).unwrap(), lag(&left).unwrap());
        assert!(before.parameters(0)[0].bounds[0] < 10.0 && after.parameters(0)[0].bounds[0] == 100.0);
        assert!(after.starts.iter().all(|start| start[0] > 100.0) && after.too_fast(&[100.5]).is_some());
        assert!(after.too_fast(&[150.0]).is_none() && before.too_fast(&[8.0]).is_none());
        // A tick's delays are not told at 2 Hz at all, and what has no time in it stays.
        let slow = no_faster_than(all.clone(), 0.5);
        assert!(slow.iter().all(|c| c.id != "command_delay") && slow.iter().any(|c| c.id == "valve_hysteresis"));
        assert_eq!(no_faster_than(all.clone(), 0.0), all);
    }

    #[test]
    fn every_candidate_of_the_papers_rig_can_be_put_in_at_each_of_its_starts() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let all = candidates(&rig);
        for id in ["valve_hysteresis", "chamber_leak", "sensor_lag", "pump_speed", "supply_sag", "coil_heating"] {
            assert!(all.iter().any(|c| c.id == id), "{id}");
        }
        for candidate in &all {
            assert!(!candidate.starts.is_empty(), "{}", candidate.full_name());
            for start in &candidate.starts {
                let mut with = rig.clone();
                with.mechanisms.push(candidate.attached(start));
                with.check().unwrap_or_else(|e| panic!("{}: {e}", candidate.full_name()));
                for (parameter, value) in candidate.parameters(0).iter().zip(start) {
                    let [low, high] = parameter.bounds;
                    assert!(low <= *value && *value <= high, "{} {value} {parameter:?}", candidate.full_name());
                    assert_eq!(fit::parameters::value(&with, &parameter.path).unwrap(), *value);
                }
            }
        }
        let sides: Vec<&str> = all.iter().map(|c| c.side.as_str()).collect();
        for side in ["positive", "negative", "both"] {
            assert!(sides.contains(&side));
        }
    }

    /// A coil as quick as its range goes is none, and only its own time constant says so.
    #[test]
    fn a_kind_that_is_slow_is_told_by_it() {
        let all = candidates(&Rig::builtin("dual_pressure").unwrap());
        let of = |id: &str| all.iter().find(|c| c.id == id && c.component == "valve_pos").unwrap();
        assert_eq!(of("coil_heating").too_fast(&[0.1, 15.0]), Some((1, "time_constant_s", 15.0)));
        assert_eq!(of("coil_heating").too_fast(&[0.1, 16.0]), None);
        assert_eq!(of("valve_lag").too_fast(&[0.5, 1.0]), None);
    }

    /// A throat of twice the effect is narrower by the root of two, an overlap of twice the effect twice as wide.
    #[test]
    fn an_effect_is_scaled_the_way_it_grows() {
        let all = candidates(&Rig::builtin("dual_pressure").unwrap());
        let of = |id: &str| all.iter().find(|c| c.id == id && c.component == "valve_pos").unwrap();
        assert!((of("line_resistance").scaled(&[10.0], 2.0)[0] - 10.0 / 2f64.sqrt()).abs() < 1e-12);
        assert!((of("valve_hysteresis").scaled(&[0.01], 2.0)[0] - 0.02).abs() < 1e-12);
    }
}

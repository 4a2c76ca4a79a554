//! Size of an effect: the change that it makes to the pressures, and the part of that which a refit could not take up.
//!
//! *Raw* is the difference of the traces with and without the effect under the same commands. *Net* is what is left of
//! that difference after the best combination of small changes of the thirteen identifiable parameters
//! ([`crate::build_sheet::IDENTIFIABLE`]): the sensitivities are differences of this rig's own runs, the combination
//! is least squares weighted by the noise. Net over noise, squared and summed over the rows, is the χ² by which an
//! oracle that knows the effect could tell it from none, to first order. Static effects (a leak, a bias) have a large
//! raw size and hardly any net size on ordinary recordings: that is physics, not a fault of the measure.

use serde::{Deserialize, Serialize};

use crate::build_sheet::{BuildSheet, IDENTIFIABLE};
use crate::effects::{Effect, Place};
use crate::run::{Precision, Rig, Run, TICK_S};

/// Pressures of both channels over time (kPa gauge), without noise.
pub type Trace = Vec<[f64; 2]>;

/// Size of an effect on one stretch of commands.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Size {
    /// Root mean square of the raw difference (kPa), by channel.
    pub raw_kpa: [f64; 2],
    /// Root mean square of what a refit leaves of it (kPa), by channel.
    pub net_kpa: [f64; 2],
    /// χ² of what is left against the noise, per second of recording.
    pub net_chi2_per_s: f64,
}

/// A stretch of commands on one nominal rig, with its sensitivities: what effects are sized with.
#[derive(Clone)]
pub struct Probe<'a> {
    sheet: &'a BuildSheet,
    duties: &'a [[f64; 2]],
    nominal: Trace,
    /// Change by each identifiable parameter (kPa).
    sensitivities: Vec<Trace>,
    /// Orthonormal columns that span the sensitivities, in units of the noise.
    span: Vec<Trace>,
}

/// Time that a rig settles before it is sized on (s): half of what a recording gets, for what is left then is the same
/// with and without the effect.
const SETTLING_S: f64 = 4.0;

/// The trace of a rig under duties, pump on, from a settled start.
pub fn trace(rig: &Rig, duties: &[[f64; 2]], precision: Precision) -> Trace {
    let Some(start) = duties.first() else { return Trace::new() };
    let mut run = Run::settled_for(SETTLING_S, rig, *start, precision);
    duties
        .iter()
        .map(|duty| {
            let now = run.clean_kpa();
            run.tick(*duty, true);
            now
        })
        .collect()
}

/// Difference of two traces.
pub fn difference(with: &[[f64; 2]], without: &[[f64; 2]]) -> Trace {
    with.iter().zip(without).map(|(a, b)| [a[0] - b[0], a[1] - b[1]]).collect()
}

/// Root mean square, by channel.
pub fn rms(trace: &[[f64; 2]]) -> [f64; 2] {
    std::array::from_fn(|c| (trace.iter().map(|row| row[c] * row[c]).sum::<f64>() / trace.len().max(1) as f64).sqrt())
}

/// The larger of both channels.
pub fn larger(pair: [f64; 2]) -> f64 {
    pair[0].max(pair[1])
}

/// Relative step of the finite differences: the traces' own error is some 1e-6, their curvature some 1.
const STEP: f64 = 3e-3;
/// Runs that sizing one effect may take.
const ATTEMPTS: usize = 7;
/// The level at which an effect that is sized by its strength stands at the top of its range (kPa).
const STRONGEST_KPA: f64 = 3.0;

impl<'a> Probe<'a> {
    /// Prepares a stretch of commands on a rig; takes fourteen runs.
    pub fn new(sheet: &'a BuildSheet, duties: &'a [[f64; 2]]) -> Self {
        let nominal = trace(&sheet.rig(), duties, Precision::Coarse);
        let change = |k: usize| {
            let mut moved = sheet.clone();
            *moved.identifiable()[k] *= 1.0 + STEP;
            difference(&trace(&moved.rig(), duties, Precision::Coarse), &nominal)
        };
        let sensitivities: Vec<Trace> = (0..IDENTIFIABLE.len()).map(change).collect();
        Self::spanned(sheet, duties, nominal, sensitivities)
    }

    fn spanned(sheet: &'a BuildSheet, duties: &'a [[f64; 2]], nominal: Trace, sensitivities: Vec<Trace>) -> Self {
        let mut probe = Self { sheet, duties, nominal, sensitivities, span: Vec::new() };
        for k in 0..probe.sensitivities.len() {
            let direction = probe.in_noise(&probe.sensitivities[k]);
            probe.add_direction(direction);
        }
        probe
    }

    /// The nominal trace.
    pub fn nominal(&self) -> &[[f64; 2]] {
        &self.nominal
    }

    /// The nominal rig, to build effects into.
    pub fn rig(&self) -> Rig {
        self.sheet.rig()
    }

    fn in_noise(&self, trace: &[[f64; 2]]) -> Trace {
        let sigma = self.sheet.noise.sigma_pa().map(|pa| 1e-3 * pa);
        trace.iter().map(|row| [row[0] / sigma[0], row[1] / sigma[1]]).collect()
    }

    /// Adds a direction, in units of the noise, that a refit can move along (modified Gram–Schmidt, twice for the rounding).
    fn add_direction(&mut self, mut direction: Trace) {
        let size = norm(&direction);
        for _ in 0..2 {
            for column in &self.span {
                subtract_projection(&mut direction, column);
            }
        }
        let left = norm(&direction);
        // What is but rounding of the directions before it would only add noise.
        if left > 1e-6 * size {
            direction.iter_mut().for_each(|row| *row = row.map(|x| x / left));
            self.span.push(direction);
        }
    }

    /// Size of whatever differs between a rig and the nominal one.
    pub fn size_of(&self, rig: &Rig) -> Size {
        self.size(&self.change_of(rig))
    }

    fn size(&self, raw: &[[f64; 2]]) -> Size {
        let net = self.unexplained(raw);
        let sigma = self.sheet.noise.sigma_pa().map(|pa| 1e-3 * pa);
        let in_noise = rms(&net);
        Size {
            raw_kpa: rms(raw),
            net_kpa: [in_noise[0] * sigma[0], in_noise[1] * sigma[1]],
            net_chi2_per_s: norm(&net).powi(2) / (self.duties.len() as f64 * TICK_S),
        }
    }

    /// Lets a refit move along the change that something else makes (kPa), too.
    pub fn also(&mut self, change: &[[f64; 2]]) {
        let direction = self.in_noise(change);
        self.add_direction(direction);
    }

    /// Part of a change that a refit leaves (kPa), in units of the noise.
    pub fn unexplained(&self, change: &[[f64; 2]]) -> Trace {
        let mut left = self.in_noise(change);
        for column in &self.span {
            subtract_projection(&mut left, column);
        }
        left
    }

    /// Sizes after one more direction is taken out, itself the part of a change that a refit leaves.
    pub fn without_direction(&self, left: &[[f64; 2]], direction: &[[f64; 2]]) -> Trace {
        let mut less = left.to_vec();
        let size = norm(direction);
        if size > 0.0 {
            let unit: Trace = direction.iter().map(|row| row.map(|x| x / size)).collect();
            subtract_projection(&mut less, &unit);
        }
        less
    }

    /// χ² of what is left (in units of the noise) if a recording went on like this for so long (s).
    pub fn chi2_over(&self, seconds: f64, left: &[[f64; 2]]) -> f64 {
        norm(left).powi(2) * seconds / (self.duties.len() as f64 * TICK_S)
    }

    /// Difference of a rig's trace from the nominal one's (kPa).
    pub fn change_of(&self, rig: &Rig) -> Trace {
        difference(&trace(rig, self.duties, Precision::Coarse), &self.nominal)
    }

    /// Change by an effect on its own (kPa): the trace with it minus the one without.
    pub fn change_by(&self, effect: &Effect, place: Place) -> Trace {
        let mut rig = self.sheet.rig();
        effect.install(place, &mut rig);
        self.change_of(&rig)
    }

    /// Gives an effect the strength at which its raw size (of the larger channel) is `wanted_kpa`, as far as its
    /// physical range allows; with the size that it then has. `close` is the ratio of sizes that is close enough.
    /// The search starts where effects of that size usually are.
    ///
    /// Secant steps in the logarithms of strength and size, with slopes held between a quarter and four: effects are
    /// nearly proportional to their strength, except where they begin (friction) or saturate (insulation).
    pub fn at_size(&self, effect: &Effect, place: Place, wanted_kpa: f64, close: f64) -> (Effect, Size) {
        let (low, high) = effect.kind().strengths();
        if effect.kind().sized_by_strength() {
            let sized = effect.at_strength(high * (wanted_kpa / STRONGEST_KPA).powf(0.6));
            let size = self.size(&self.change_by(&sized, place));
            return (sized, size);
        }
        let mut best: Option<(f64, Effect, Trace)> = None;
        let mut last: Option<(f64, f64)> = None;
        let mut strength = effect.usual_strength(wanted_kpa);
        for _ in 0..ATTEMPTS {
            let candidate = effect.at_strength(strength);
            let change = self.change_by(&candidate, place);
            let size = larger(rms(&change)).max(1e-6);
            let miss = (wanted_kpa / size).ln();
            if best.as_ref().is_none_or(|(least, ..)| miss.abs() < *least) {
                best = Some((miss.abs(), candidate, change));
            }
            let next = match last {
                Some((s, z)) if s != strength => {
                    let slope = ((size / z).ln() / (strength / s).ln()).clamp(0.25, 4.0);
                    strength * (miss / slope).exp()
                }
                _ => strength * miss.exp(),
            }
            .clamp(low, high);
            if miss.abs() < close.ln() || next == strength {
                break;
            }
            last = Some((strength, size));
            strength = next;
        }
        match best {
            Some((_, effect, change)) => (effect, self.size(&change)),
            None => (effect.clone(), self.size(&[])),
        }
    }
}

impl Effect {
    /// Where in its range an effect of that size (kPa) usually stands: ranges run from what hardly shows to some kPa.
    pub fn usual_strength(&self, wanted_kpa: f64) -> f64 {
        let (low, high) = self.kind().strengths();
        let share = (wanted_kpa / HARDLY_KPA).ln() / (TOP_KPA / HARDLY_KPA).ln();
        low * (high / low).powf(share.clamp(0.0, 1.0))
    }
}

/// Sizes at the ends of a usual range (kPa).
const HARDLY_KPA: f64 = 0.01;
const TOP_KPA: f64 = 8.0;

fn dot(a: &[[f64; 2]], b: &[[f64; 2]]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a[0] * b[0] + a[1] * b[1]).sum()
}

fn norm(a: &[[f64; 2]]) -> f64 {
    dot(a, a).sqrt()
}

fn subtract_projection(from: &mut [[f64; 2]], unit: &[[f64; 2]]) {
    let share = dot(from, unit);
    for (row, column) in from.iter_mut().zip(unit) {
        row[0] -= share * column[0];
        row[1] -= share * column[1];
    }
}

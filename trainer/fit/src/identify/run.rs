//! Identification from recordings to a rig with uncertainties.

use model::rig::Rig;
use proto::recording::Recording;

use super::check_valves::{PaperFit, paper_fit};
use super::contradictions::contradicted;
use crate::FitError;
use crate::data::quality::Quality;
use crate::data::switched::{BehindChanges, Change};
use crate::data::{Line, Noise, Records, Role, Split, lines, noise, rms_kpa};
use crate::objective::{FitSettings, Fitted, blocks_of, fit};
use crate::parameters::{ParameterSet, Scatter, nominal};
use crate::simulate::{ChannelError, Fidelity, Horizon, Simulator, errors, traces_at};

/// Settings of an identification.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct IdentifySettings {
    /// Scatter of parts: the priors.
    pub scatter: Scatter,
    /// Cores; `None` for all.
    pub threads: Option<usize>,
    /// The fit.
    pub fit: FitSettings,
}

/// Ratio of two errors on some tens of seconds that are equal but for chance, where both are little more than the noise.
const CHANCE: f64 = 1.05;
/// Multiples of the noise that chance multiplies at most: the rest of an error is the rig's, and the same in both.
const BEYOND_CHANCE: f64 = 2.0;

/// The most that a rig may be off by on validation data, in kPa, to be no worse than one that is off by `before_kpa`.
pub fn no_worse_than(before_kpa: f64, noise_kpa: f64) -> f64 {
    let chance_kpa = before_kpa.min(BEYOND_CHANCE * noise_kpa);
    (before_kpa.powi(2) + (CHANCE.powi(2) - 1.0) * chance_kpa.powi(2)).sqrt()
}

/// Step that is being done, for a progress line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// The recordings are checked.
    Checking,
    /// Check valves and valves, as in the paper.
    Paper,
    /// The joint refinement.
    Refining {
        /// Rounds that are done.
        round: usize,
    },
    /// Errors on what was kept back.
    Testing,
}

/// Errors at three horizons, by channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Accuracy {
    /// From the start of each recording.
    pub free: Vec<ChannelError>,
    /// Windows of 10 s.
    pub ten_seconds: Vec<ChannelError>,
    /// Windows of 1 s.
    pub one_second: Vec<ChannelError>,
}

/// Result of an identification.
#[derive(Debug, Clone, PartialEq)]
pub struct Identified {
    /// The fit; its rig is the result.
    pub fitted: Fitted,
    /// Cost of the fit from each start, comparable with each other: whether they agree says whether the minimum is the
    /// minimum.
    pub costs: Vec<f64>,
    /// Result of the paper's procedure, for rigs that it applies to.
    pub paper: Option<PaperFit>,
    /// Findings on what is doubtful about the recordings.
    pub quality: Quality,
    /// Change of a pump behind which simulations start anew, where there is one.
    pub change: Option<Change>,
    /// Noise by channel.
    pub noise: Vec<Noise>,
    /// Columns of the channels.
    pub channels: Vec<String>,
    /// Errors on the stretches that were kept back, of the rig as it came.
    pub before: Accuracy,
    /// Errors on these stretches of the identified rig.
    pub after: Accuracy,
    /// True where the errors are on rows that were fitted, because there were too few to keep any back.
    pub tested_on_fitted: bool,
    /// Narrow lines in the residual (a pump off its speed), by channel.
    pub lines: Vec<Vec<Line>>,
    /// Roles that the rows were shared out to.
    pub split: Split,
}

impl Identified {
    /// Root mean square errors on validation data in kPa, all channels together: of the rig as it came, and of the identified one.
    pub fn before_and_after_kpa(&self) -> [f64; 2] {
        [&self.before, &self.after].map(|accuracy| {
            let rows: f64 = accuracy.free.iter().map(|e| e.rows as f64).sum();
            let squares: f64 = accuracy.free.iter().map(|e| e.rmse_kpa.powi(2) * e.rows as f64).sum();
            (squares / rows.max(1.0)).sqrt()
        })
    }

    /// Tells whether the identified rig is worse on validation data than the rig as it came, by more than chance.
    pub fn is_worse(&self) -> bool {
        let [before_kpa, after_kpa] = self.before_and_after_kpa();
        after_kpa > no_worse_than(before_kpa, rms_kpa(&self.noise))
    }
}

/// Identifies the parameters of `rig` from recordings.
///
/// # Errors
/// Recordings that cannot be used (all reasons in one line), or a rig that cannot be simulated.
pub fn run(
    rig: &Rig,
    recordings: &[Recording],
    settings: &IdentifySettings,
    progress: &mut dyn FnMut(Step),
) -> Result<Identified, FitError> {
    progress(Step::Checking);
    let records = Records::new(rig, recordings)?;
    let noise = noise(&records);
    let quality = Quality::of(rig, &records, &noise)?;
    if let Some(refusal) = quality.refusal() {
        return Err(FitError::Unusable(refusal));
    }
    let (mut quality, records) = quality.sound(records);
    // No model has a motor that comes up or stops: what is checked whole is run from behind that.
    let (records, change) = match BehindChanges::of(rig, &records) {
        Some(behind) => {
            quality = quality.taken(&behind.places);
            (behind.records, Some(behind.change))
        }
        None => (records, None),
    };
    let split = Split::of(&records);
    let role = |role| -> Vec<f64> {
        split.weights(records.layout(), role).iter().zip(&quality.usable).map(|(w, u)| w * u).collect()
    };
    // No models are compared here, so what is set aside for that is fitted too.
    let fitted_rows: Vec<f64> = role(Role::Fit).iter().zip(role(Role::Select)).map(|(f, s)| f + s).collect();
    let kept_back = role(Role::HeldOut);
    let tested_on_fitted = kept_back.iter().all(|w| *w == 0.0);
    let tested = if tested_on_fitted { &fitted_rows } else { &kept_back };

    progress(Step::Paper);
    // A regression that fails leaves one start less; it is not what the result rests on.
    let paper = paper_fit(rig, &records, &fitted_rows, settings.scatter).ok().flatten();

    progress(Step::Refining { round: 0 });
    let mut simulator = Simulator::new(&records, Fidelity::Detailed);
    if let Some(threads) = settings.threads {
        simulator = simulator.on(threads);
    }
    let set = ParameterSet::new(rig, nominal(rig, settings.scatter)).map_err(FitError::rig(rig))?;
    let mut starts = vec![set.origin()];
    if let Some(paper) = &paper {
        let mut point = set.point_of(&paper.rig).map_err(FitError::rig(rig))?;
        // A coefficient that the regression hardly sees may be anywhere; a start need not be.
        point.iter_mut().for_each(|z| *z = z.clamp(-3.0, 3.0));
        starts.push(point);
    }
    let sigma_kpa: Vec<f64> = noise.iter().map(|n| n.sigma_kpa).collect();
    let mut blocks = blocks_of(&split, Role::Fit);
    blocks.extend(blocks_of(&split, Role::Select));
    let mut round = 0;
    let (mut fitted, costs) =
        fit(simulator, &set, &starts, &fitted_rows, &sigma_kpa, &blocks, &settings.fit, &mut || {
            round += 1;
            progress(Step::Refining { round });
        })?;

    // Where only ratios are known, and what is stated contradicts itself, no parameter is known as well as that says.
    if let Some(information) = &fitted.information
        && let Some(variances) = contradicted(&fitted.estimates, information)
    {
        fitted.widen(&variances);
    }

    progress(Step::Testing);
    let horizons = [Horizon::Free, Horizon::Windows { seconds: 10.0 }, Horizon::Windows { seconds: 1.0 }];
    let accuracy = |rig: &Rig| -> Result<(Accuracy, Vec<f64>), FitError> {
        let traces = traces_at(&simulator, rig, &horizons)?;
        let at = |horizon: usize| errors(&simulator, traces.get(horizon).map_or(&[], Vec::as_slice), tested);
        let accuracy = Accuracy { free: at(0), ten_seconds: at(1), one_second: at(2) };
        Ok((accuracy, traces.into_iter().next().unwrap_or_default()))
    };
    let ((before, _), (after, free_run)) = (accuracy(rig)?, accuracy(&fitted.rig)?);
    let lines = residual_lines(&records, &free_run);
    Ok(Identified {
        fitted,
        costs,
        paper,
        channels: records.sensors().to_vec(),
        quality,
        change,
        noise,
        before,
        after,
        tested_on_fitted,
        lines,
        split,
    })
}

/// Narrow lines in the free-run residual, by channel: the strongest recording speaks.
fn residual_lines(records: &Records, trace: &[f64]) -> Vec<Vec<Line>> {
    let mut found: Vec<Vec<Line>> = vec![Vec::new(); records.layout().channels()];
    let even = |record: usize| records.records().get(record).is_some_and(|r| r.measured.is_empty());
    // A line is told from evenly sampled rows alone.
    for (record, channel, range) in records.layout().all().filter(|(record, ..)| even(*record)) {
        let recorded = records.channel_kpa(record, channel);
        let simulated = trace.get(range).unwrap_or_default();
        let mut residual: Vec<f64> = recorded.iter().zip(simulated).map(|(r, s)| r - s).collect();
        // What was not read has no line in it.
        if let Some(of) = records.records().get(record) {
            of.over_missing(channel, &mut residual);
        }
        for segment in records.records().get(record).map_or(&[][..], |r| &r.segments) {
            let here = lines(residual.get(segment.clone()).unwrap_or_default(), 1e-4);
            if let Some(slot) = found.get_mut(channel)
                && here.first().map_or(0.0, |l| l.contrast) > slot.first().map_or(0.0, |l| l.contrast)
            {
                *slot = here;
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_far_above_the_noise_that_grows_is_worse_and_one_of_noise_may_grow_by_chance() {
        // Where most readings repeat the one before.
        assert!(7.3225 > no_worse_than(7.3167, 1e-6));
        assert!(0.0505 < no_worse_than(0.05, 0.05));
        assert!(0.06 > no_worse_than(0.05, 0.05));
        // Just above twice the noise as just below.
        let [below, above] = [0.0999, 0.1001].map(|kpa| no_worse_than(kpa, 0.05) / kpa);
        assert!(above > 1.04 && (below - above).abs() < 1e-3, "{below} {above}");
    }
}

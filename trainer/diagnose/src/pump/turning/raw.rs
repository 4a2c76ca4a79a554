//! The recordings as they came, and the pump's speed read off them.

use std::cell::OnceCell;

use fit::data::Records;
use fit::simulate::{Arcs, Fidelity, Ripple, Run, Tachometer, refined_starts, supposed, tachometer, track};
use model::rig::{Pump, Rig};

use super::Turning;
use crate::bench::{Bench, Effort, Explanation};
use crate::error::DiagnoseError;
use crate::pump::answer::{Answer, Asked};
use crate::search::candidate::{Candidate, DRIFT};
use crate::search::{cost, starts, values_of};

/// Angles of the crank over which strokes are averaged.
const ANGLES: usize = 4;

/// Recordings as they came.
pub(super) struct Raw<'a> {
    pub(super) bench: &'a Bench<'a>,
    /// The rig as fitted to them, its pump as fast as stated.
    pub(super) fitted: &'a Rig,
    /// Difference of the detailed simulation from the averaged one, wherever the crank starts, in kPa; worked out when asked for.
    strokes_kpa: OnceCell<Vec<f64>>,
}

impl<'a> Raw<'a> {
    pub(super) fn of(bench: &'a Bench<'a>, fitted: &'a Rig) -> Self {
        Raw { bench, fitted, strokes_kpa: OnceCell::new() }
    }

    fn strokes_kpa(&self) -> Result<&[f64], DiagnoseError> {
        if let Some(known) = self.strokes_kpa.get() {
            return Ok(known);
        }
        let (bench, fitted) = (self.bench, self.fitted);
        let arcs = refined_starts(&bench.fast, fitted, &Arcs::led(bench.records))?;
        // Half a turn of a pair of pistons is all there is to see.
        let runs: Vec<Run> = (0..ANGLES)
            .map(|k| Run { crank_rev: 0.5 * k as f64 / ANGLES as f64, ..Run::from(fitted.clone()) })
            .collect();
        let mut strokes_kpa = vec![0.0; bench.records.layout().len()];
        for (simulator, sign) in [(&bench.close, 1.0), (&bench.fast, -1.0)] {
            for trace in simulator.run(&runs, &arcs) {
                let trace = trace.map_err(DiagnoseError::rig(fitted))?;
                for (slot, kpa) in strokes_kpa.iter_mut().zip(trace) {
                    *slot += sign * kpa / ANGLES as f64;
                }
            }
        }
        Ok(self.strokes_kpa.get_or_init(|| strokes_kpa))
    }

    /// The recordings without a ripple, and as if the pump had no strokes.
    pub(super) fn freed(&self, ripple_kpa: &[f64]) -> Result<Records, DiagnoseError> {
        let readings = self.bench.records.readings_kpa().iter().zip(ripple_kpa).zip(self.strokes_kpa()?);
        Ok(self.bench.records.with_readings(readings.map(|((r, ripple), stroke)| r - ripple - stroke).collect())?)
    }

    /// Which of two opposite readings is meant: the one with which the rig's own parameters explain more, from the
    /// parameters as fitted.
    pub(super) fn forwards(&self, readings: Vec<Tachometer>, point: &[f64]) -> Result<Option<Turning>, DiagnoseError> {
        let mut best: Option<(f64, Turning)> = None;
        for first in readings {
            let Some((read, ripple, point)) = self.read_twice(first, point)? else { continue };
            let mut turning = Turning::in_step(self, &ripple, &point, read)?;
            let bench = turning.bench(self.bench.counted(), self.bench.short);
            let freed = bench.fit(&[], &[], &[point], Effort::Polish)?.fitted;
            let cost = freed.comparable_cost(bench.records, bench.fit_weights());
            turning.point = freed.point;
            if best.as_ref().is_none_or(|(least, _)| cost < *least) {
                best = Some((cost, turning));
            }
        }
        Ok(best.map(|(_, turning)| turning))
    }

    /// A reading of the `ripple` that the rig has with what was found in it; of two opposite ones that with which what was found
    /// explains more. `point` is near the parameters' best.
    pub(super) fn read_again(
        &self,
        point: &[f64],
        found: &Beside<'_>,
        ripple: Option<&Ripple>,
    ) -> Result<Option<Turning>, DiagnoseError> {
        let Some(ripple) = ripple else { return Ok(None) };
        let read = if found.values.is_empty() { tachometer } else { supposed };
        let readings = read(self.bench.records, ripple, self.bench.counted());
        let one = readings.len() == 1;
        let mut best: Option<(f64, Turning)> = None;
        for read in readings {
            let turning = Turning::in_step(self, ripple, point, read)?;
            if one {
                return Ok(Some(turning));
            }
            let bench = turning.bench(self.bench.counted(), self.bench.short);
            let starts = starts(&bench, found.candidates, found.best, &found.terms, &found.values, false);
            let fitted = bench.fit(found.candidates, &found.terms, &starts, Effort::Polish)?;
            let cost = cost(&bench, &fitted);
            if best.as_ref().is_none_or(|(least, _)| cost < *least) {
                best = Some((cost, turning));
            }
        }
        Ok(best.map(|(_, turning)| turning))
    }

    /// The `ripple` beside what was found where it keeps no step, followed: it is small beside a valve that sticks, and may not have been heard
    /// before that was known. `point` is near the parameters' best.
    pub(super) fn followed_beside(
        &self,
        point: &[f64],
        ripple: Option<&Ripple>,
    ) -> Result<Option<Turning>, DiagnoseError> {
        let Some(ripple) = ripple else { return Ok(None) };
        let followed = track(self.bench.records, self.bench.rig, ripple, self.bench.counted());
        followed.map(|followed| Turning::followed(self, point, &followed)).transpose()
    }

    /// The ripple of a rig with what was found in it, as fast as stated. What is put in place of something that was found is
    /// fitted first, as if the pump had neither strokes nor ripple.
    pub(super) fn ripple_beside(&self, found: &Beside<'_>) -> Result<Option<Ripple>, DiagnoseError> {
        let bench = self.bench;
        if found.values.is_empty() {
            return Ok(Ripple::of(&bench.fast, &found.without_ripple(bench.rig))?);
        }
        let records = self.freed(&vec![0.0; bench.records.layout().len()])?;
        let smooth = bench.over(&records, bench.counted(), Fidelity::Smooth);
        let starts = starts(&smooth, found.candidates, found.best, &found.terms, &found.values, false);
        // What cannot be run is not what is there.
        let Ok(instead) = smooth.fit(found.candidates, &found.terms, &starts, Effort::Polish) else { return Ok(None) };
        Ok(Ripple::of(&bench.fast, &at_stated_speed(&instead.fitted.rig, bench.rig))?)
    }

    /// Explanation that might have been found instead, with its cost, on readings less its own strokes, not those of sensors that
    /// show them whole; `None` if it cannot be run.
    pub(super) fn lagging(&self, instead: &Beside<'_>) -> Result<Option<(Explanation, f64)>, DiagnoseError> {
        let (bench, candidates) = (self.bench, instead.candidates);
        let starts = starts(bench, candidates, instead.best, &instead.terms, &instead.values, false);
        let Some(start) = starts.first() else { return Ok(None) };
        let set = bench.set_of(candidates, &instead.terms)?;
        let records = bench.without_strokes(&set.rig_at(start).map_err(DiagnoseError::rig(bench.rig))?)?;
        let searched = bench.reduced(&records);
        let Ok(fitted) = searched.fit(candidates, &instead.terms, &starts, Effort::Polish) else { return Ok(None) };
        let cost = cost(&searched, &fitted);
        Ok(Some((fitted, cost)))
    }

    /// A reading, asked again of the rig as fitted with it: before, its parameters made up for some of the ripple. With it
    /// that rig's ripple and point; `None` for a rig without one.
    fn read_twice(
        &self,
        read: Tachometer,
        point: &[f64],
    ) -> Result<Option<(Tachometer, Ripple, Vec<f64>)>, DiagnoseError> {
        let Some((ripple, point)) = self.fitted_with(&read, point)? else { return Ok(None) };
        let again = tachometer(self.bench.records, &ripple, self.bench.counted());
        match again.into_iter().find(|again| again.slip.signum() == read.slip.signum()) {
            Some(again) => {
                let fitted = self.fitted_with(&again, &point)?;
                Ok(fitted.map(|(ripple, point)| (again, ripple, point)))
            }
            None => Ok(Some((read, ripple, point))),
        }
    }

    /// The ripple of the rig fitted with a reading, as fast as stated, and its point.
    fn fitted_with(&self, read: &Tachometer, point: &[f64]) -> Result<Option<(Ripple, Vec<f64>)>, DiagnoseError> {
        let mut turned = self.bench.rig.clone();
        if let Some(Pump::Piston(pump)) = turned.pumps.get_mut(&read.pump) {
            pump.speed_rpm = read.speed_rpm;
        }
        let records = self.bench.records.clone().with_cranks(&read.crank_rev);
        let averaged =
            Bench::new(&turned, &records, self.bench.counted(), Fidelity::Averaged).shortened(self.bench.short);
        let fitted = averaged.fit(&[], &[], &[point.to_vec()], Effort::Polish)?.fitted;
        let ripple = Ripple::of(&self.bench.fast, &at_stated_speed(&fitted.rig, self.bench.rig))?;
        Ok(ripple.map(|ripple| (ripple, fitted.point)))
    }
}

/// Explanation that was found, or might have been, to read the ripple beside it.
pub(super) struct Beside<'a> {
    pub(super) candidates: &'a [Candidate],
    /// The explanation that was found.
    pub(super) best: &'a Explanation,
    /// Terms of it but for drifting sensors, which a slow ripple may have been taken for and must not hide it; or what might stand
    /// in their place.
    pub(super) terms: Vec<usize>,
    /// Where those begin that were not found.
    pub(super) values: Vec<(usize, Vec<f64>)>,
}

impl<'a> Beside<'a> {
    pub(super) fn of(answer: &'a Answer, asked: &'a Asked<'_>) -> Self {
        let best = &answer.found.best;
        let drifts = |term: &usize| asked.candidates.get(*term).is_some_and(|candidate| candidate.id == DRIFT);
        let terms = best.terms.iter().copied().filter(|term| !drifts(term)).collect();
        Beside { candidates: &asked.candidates, best, terms, values: Vec::new() }
    }

    /// The numbers of what was found, by term.
    pub(super) fn numbers(&self, bench: &Bench<'_>) -> Vec<(usize, Vec<f64>)> {
        let of = |term: &usize| Some((*term, values_of(bench, self.candidates, self.best, *term)?));
        self.terms.iter().filter_map(of).collect()
    }

    /// The rig with it, its pumps as fast as `stated`.
    fn without_ripple(&self, stated: &Rig) -> Rig {
        let mut rig = at_stated_speed(&self.best.fitted.rig, stated);
        rig.mechanisms.retain(|attached| !["pump_speed", DRIFT].contains(&attached.mechanism.id()));
        rig
    }
}

/// The rig with its pumps as fast as in another.
fn at_stated_speed(rig: &Rig, stated: &Rig) -> Rig {
    let mut rig = rig.clone();
    for (name, pump) in &mut rig.pumps {
        if let (Pump::Piston(pump), Some(Pump::Piston(stated))) = (pump, stated.pumps.get(name)) {
            pump.speed_rpm = stated.speed_rpm;
        }
    }
    rig
}

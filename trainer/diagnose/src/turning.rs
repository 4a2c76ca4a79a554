//! How the pump turned, and the answer that goes with it.
//!
//! The pump's speed is read off its ripple before anything is searched. Where the ripple keeps step over whole recordings
//! ([`fit::simulate::tachometer`]), speed and crank angles go into the rig and the recordings. Where it does not
//! ([`fit::simulate::track`]: a motor that gives way under load, or warms), it is followed and taken out of the readings, and
//! everything after that runs without a ripple; what it told of the pump is a finding by itself.
//!
//! Two things can spoil a reading. A ripple that turns less than once or so in a recording is a slow swing, and so is much
//! that may be missing from a model; and a reading made while something is still missing from the rig may have been drawn
//! to the wrong side of the stated speed. So the answer is worked out without a reading too where it is ambiguous, and once
//! more where the ripple, asked again of the rig with what was found in it, tells another speed; the plainest one is taken.

use fit::data::Records;
use fit::simulate::{
    Arcs, Course, Fidelity, Ripple, Run, Tachometer, Track, refined_starts, ripple_in_step, tachometer, track,
};
use model::rig::{Pump, Rig};
use proto::diagnosis::Verdict;

use crate::answer::{Answer, Asked};
use crate::bench::{Bench, Effort};
use crate::crank;
use crate::error::DiagnoseError;
use crate::figures::{Figures, figures};
use crate::heard::Heard;
use crate::judge::{FLOOR_KPA, Judgement};
use crate::search::PRICE;

/// Turns of the ripple in the longest recording below which a reading may be something slow that is missing.
const CERTAIN_TURNS: f64 = 1.5;
/// Turns in the longest recording by which two readings are told apart.
const APART_TURNS: f64 = 0.25;
/// Change of the ripple at which an answer is worked out again, in kPa: what a term must set right to be named.
const REDONE_KPA: f64 = 0.03;
/// Share of the stated speed from which on another one is missing physics; less is how such motors scatter.
const NAMED: f64 = 0.002;
/// Angles of the crank over which strokes are averaged.
const ANGLES: usize = 4;

/// The rig with its pump at the speed that its ripple tells, the recordings with cranks where they stood or without
/// ripple, and the rig's own parameters as fitted.
pub(crate) struct Turning {
    pub(crate) rig: Rig,
    pub(crate) records: Records,
    pub(crate) point: Vec<f64>,
    /// What has a name of what the ripple told.
    pub(crate) heard: Option<Heard>,
    /// How closely the recordings are to be simulated.
    fidelity: Fidelity,
    /// What the ripple told where it kept step, and the speed in the rig file in rev/min.
    read: Option<(Tachometer, f64)>,
    /// The ripple that was taken out of the readings, in kPa; empty for none.
    ripple_kpa: Vec<f64>,
    /// Where the ripple was taken out: the rig fitted without what was heard, and the recordings as they came.
    without: Option<(Rig, Records)>,
}

impl Turning {
    /// By a ripple that stands still.
    fn as_stated(rig: &Rig, records: &Records, point: &[f64]) -> Self {
        Turning {
            rig: rig.clone(),
            records: records.clone(),
            point: point.to_vec(),
            heard: None,
            fidelity: Fidelity::Detailed,
            read: None,
            ripple_kpa: Vec::new(),
            without: None,
        }
    }

    /// By a ripple that kept step: taken out of the readings as well, for the pump's model predicts it to a tenth.
    fn in_step(raw: &Raw<'_>, ripple: &Ripple, point: &[f64], read: Tachometer) -> Result<Self, DiagnoseError> {
        let bench = raw.bench;
        let ripple_kpa = ripple_in_step(bench.records, ripple, &read, bench.counted());
        let mut turning = Turning::as_stated(bench.rig, &raw.freed(&ripple_kpa)?, point);
        turning.fidelity = Fidelity::Smooth;
        turning.ripple_kpa = ripple_kpa;
        if let Some(Pump::Piston(pump)) = turning.rig.pumps.get_mut(&read.pump) {
            let stated_rpm = pump.speed_rpm;
            if read.slip.abs() < NAMED {
                pump.speed_rpm = read.speed_rpm;
            } else {
                let heard = Heard::steady(&read);
                turning.rig.mechanisms.push(heard.attached.clone());
                turning.heard = Some(heard);
                turning.without = Some((raw.fitted.clone(), bench.records.clone()));
            }
            turning.read = Some((read, stated_rpm));
        }
        Ok(turning)
    }

    /// By a ripple that was followed.
    fn followed(raw: &Raw<'_>, point: &[f64], followed: &Track) -> Result<Self, DiagnoseError> {
        let bench = raw.bench;
        let mut rig = bench.rig.clone();
        let records = raw.freed(&followed.ripple_kpa)?;
        let plain = Bench::new(bench.rig, &records, bench.counted(), Fidelity::Smooth, raw.threads);
        let without = plain.fit(&[], &[], &[point.to_vec()], Effort::Polish)?.fitted.rig;
        if let (Course::Drooping { share, .. }, Some(Pump::Piston(pump))) =
            (followed.course, rig.pumps.get_mut(&followed.pump))
        {
            pump.speed_rpm *= 1.0 + share;
        }
        let heard = Heard::of(followed);
        rig.mechanisms.push(heard.attached.clone());
        Ok(Turning {
            heard: Some(heard),
            fidelity: Fidelity::Smooth,
            ripple_kpa: followed.ripple_kpa.clone(),
            without: Some((without, bench.records.clone())),
            ..Turning::as_stated(&rig, &records, point)
        })
    }

    /// By how much another one's ripple differs, root mean square in kPa.
    fn ripple_off_kpa(&self, other: &Turning) -> f64 {
        let squares = self.ripple_kpa.iter().zip(&other.ripple_kpa).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
        (squares / self.ripple_kpa.len().max(1) as f64).sqrt()
    }

    /// A rig with its pistons where they stood when the recordings began, where that was the same place in all of them: a run
    /// from any of those starts then has their ripple, which a rig file tells only so.
    pub(crate) fn as_begun(&self, rig: &Rig) -> Rig {
        let mut rig = rig.clone();
        if let Some(read) = self.tachometer()
            && let Some(Pump::Piston(pump)) = rig.pumps.get_mut(&read.pump)
        {
            crank::turn_to(pump, &read.crank_rev);
        }
        rig
    }

    fn tachometer(&self) -> Option<&Tachometer> {
        self.read.as_ref().map(|(read, _)| read)
    }

    /// The recordings laid out for fits.
    pub(crate) fn bench<'t>(&'t self, usable: &[f64], threads: Option<usize>) -> Bench<'t> {
        Bench::new(&self.rig, &self.records, usable, self.fidelity, threads)
    }

    fn answer(
        &self,
        asked: &Asked<'_>,
        usable: &[f64],
        progress: &mut dyn FnMut(&str, f64),
    ) -> Result<Answer, DiagnoseError> {
        Answer::of(&self.bench(usable, asked.threads), asked, &self.point, progress)
    }

    /// Figures of the re-identified rig without what was heard, the ripple still on the readings; `fitted`, those of the one
    /// with it, where nothing was.
    pub(crate) fn reidentified(
        &self,
        bench: &Bench<'_>,
        fitted: Figures,
        short: bool,
    ) -> Result<Figures, DiagnoseError> {
        Ok(match &self.without {
            Some((without, records)) if records.rows() == bench.records.rows() => {
                let raw = Bench::new(without, records, bench.counted(), Fidelity::Detailed, None);
                figures(&raw, without, Fidelity::Detailed, short)?
            }
            _ => fitted,
        })
    }

    /// What was heard is missing physics, whatever else there is.
    pub(crate) fn judged(&self, judgement: &mut Judgement) {
        let else_known = judgement.contested.is_empty();
        let nothing_else =
            matches!(judgement.verdict, Verdict::Adequate | Verdict::ParametersMoved | Verdict::Undecided);
        if self.heard.is_some() && else_known && nothing_else {
            judgement.verdict = Verdict::MissingPhysics;
            // Parameters that could have moved instead have nothing to do with the ripple.
            judgement.rivals.clear();
            judgement.groups.clear();
        }
    }

    /// What is said about it.
    pub(crate) fn note(&self) -> Option<String> {
        if let Some(heard) = &self.heard {
            return Some(format!(
                "the pump's ripple tells how it turned: {}; errors and plots are of readings that it was taken out of",
                heard.shows
            ));
        }
        self.read.as_ref().map(|(read, stated_rpm)| {
            format!(
                "the readings swing with the pump's ripple at {:.3} Hz: {} turns at {:.2} rev/min, not at {stated_rpm:.2} \
                 as in the rig file; errors and plots are of readings that it was taken out of",
                read.beat_hz, read.pump, read.speed_rpm
            )
        })
    }
}

/// Recordings as they came.
struct Raw<'a> {
    bench: &'a Bench<'a>,
    /// The rig as fitted to them, its pump as fast as stated.
    fitted: &'a Rig,
    /// What the detailed simulation differs by from the averaged one, wherever the crank starts, in kPa.
    strokes_kpa: Vec<f64>,
    threads: Option<usize>,
}

impl<'a> Raw<'a> {
    fn of(bench: &'a Bench<'a>, fitted: &'a Rig, threads: Option<usize>) -> Result<Self, DiagnoseError> {
        let arcs = refined_starts(&bench.fast, fitted, &Arcs::free(bench.records))?;
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
        Ok(Raw { bench, fitted, strokes_kpa, threads })
    }

    /// The recordings without a ripple, and as if the pump had no strokes.
    fn freed(&self, ripple_kpa: &[f64]) -> Result<Records, DiagnoseError> {
        let readings = self.bench.records.readings_kpa().iter().zip(ripple_kpa).zip(&self.strokes_kpa);
        Ok(self.bench.records.with_readings(readings.map(|((r, ripple), stroke)| r - ripple - stroke).collect())?)
    }

    /// Which of two opposite readings is meant: the one with which the rig's own parameters explain more, from the
    /// parameters as fitted.
    fn forwards(&self, readings: Vec<Tachometer>, point: &[f64]) -> Result<Option<Turning>, DiagnoseError> {
        let mut best: Option<(f64, Turning)> = None;
        for first in readings {
            let Some((read, ripple, point)) = self.read_twice(first, point)? else { continue };
            let mut turning = Turning::in_step(self, &ripple, &point, read)?;
            let bench = turning.bench(self.bench.counted(), self.threads);
            let freed = bench.fit(&[], &[], &[point], Effort::Polish)?.fitted;
            let cost = freed.comparable_cost(bench.records, bench.fit_weights());
            turning.point = freed.point;
            if best.as_ref().is_none_or(|(least, _)| cost < *least) {
                best = Some((cost, turning));
            }
        }
        Ok(best.map(|(_, turning)| turning))
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
        let averaged = Bench::new(&turned, &records, self.bench.counted(), Fidelity::Averaged, self.threads);
        let fitted = averaged.fit(&[], &[], &[point.to_vec()], Effort::Polish)?.fitted;
        let ripple = Ripple::of(&self.bench.fast, &at_stated_speed(&fitted.rig, self.bench.rig))?;
        Ok(ripple.map(|ripple| (ripple, fitted.point)))
    }
}

/// An answer with the reading that it rests on.
type Answered = (Turning, Answer);

/// Fits the rig's own parameters, reads the pump's speed off what is left, and searches for what is missing.
///
/// # Errors
/// A fit failed.
pub(crate) fn answered(
    asked: &mut Asked<'_>,
    records: Records,
    usable: &[f64],
    progress: &mut dyn FnMut(&str, f64),
) -> Result<Answered, DiagnoseError> {
    let rig = asked.given;
    let bench = Bench::new(rig, &records, usable, Fidelity::Detailed, asked.threads);
    let origin = vec![0.0; bench.nominal.len()];
    let fitted = bench.fit(&[], &[], &[origin], Effort::Full)?.fitted;
    let ripple = Ripple::of(&bench.fast, &fitted.rig)?;
    let readings = ripple.as_ref().map_or(Vec::new(), |ripple| tachometer(&records, ripple, bench.counted()));
    let ambiguous = readings.first().is_none_or(|read| read.turns < CERTAIN_TURNS);
    let followed =
        ripple.filter(|_| ambiguous).and_then(|ripple| track(&records, &fitted.rig, &ripple, bench.counted()));
    let mut turnings = Vec::new();
    if let Some(followed) = &followed {
        let raw = Raw::of(&bench, &fitted.rig, asked.threads)?;
        turnings.push(Turning::followed(&raw, &fitted.point, followed)?);
        // What the pump's speed does is known.
        asked.candidates.retain(|candidate| !["pump_droop", "pump_speed"].contains(&candidate.id.as_str()));
    } else if !readings.is_empty() {
        let raw = Raw::of(&bench, &fitted.rig, asked.threads)?;
        turnings.extend(raw.forwards(readings, &fitted.point)?);
    }
    if followed.is_none() && ambiguous {
        turnings.push(Turning::as_stated(rig, &records, &fitted.point));
    }
    let mut answers: Vec<Answered> = Vec::new();
    for turning in turnings {
        if !answers.iter().any(|(_, answer)| is_whole(answer)) {
            let answer = turning.answer(asked, usable, progress)?;
            answers.push((turning, answer));
        }
    }
    // With what was found in the rig the ripple may tell another speed, or be another one: a sensor that lags shows none.
    if let Some((first, answer)) = answers.get(plainest(&answers))
        && followed.is_none()
        && !answer.found.best.terms.is_empty()
    {
        let mut with_terms = at_stated_speed(&answer.found.best.fitted.rig, rig);
        with_terms.mechanisms.retain(|attached| attached.mechanism.id() != "pump_speed");
        let ripple = Ripple::of(&bench.fast, &with_terms)?;
        let again = ripple
            .and_then(|ripple| Some((tachometer(&records, &ripple, bench.counted()).into_iter().next()?, ripple)));
        let known = answers.iter().any(|(turning, _)| same(turning.tachometer(), again.as_ref().map(|(read, _)| read)));
        let turning = match again {
            Some((read, ripple)) => {
                let raw = Raw::of(&bench, &fitted.rig, asked.threads)?;
                let turning = Turning::in_step(&raw, &ripple, &first.point, read)?;
                (!known || turning.ripple_off_kpa(first) > REDONE_KPA).then_some(turning)
            }
            None if known => None,
            None => Some(Turning::as_stated(rig, &records, &fitted.point)),
        };
        if let Some(turning) = turning {
            let answer = turning.answer(asked, usable, progress)?;
            answers.push((turning, answer));
        }
    }
    let plainest = plainest(&answers);
    answers.into_iter().nth(plainest).ok_or_else(|| fit::FitError::NoRecordings.into())
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

/// Whether nothing is left to be explained, and nothing had to be added for it.
fn is_whole(answer: &Answer) -> bool {
    answer.found.best.terms.is_empty() && answer.judgement.excess_kpa[1].iter().all(|kpa| *kpa < FLOOR_KPA)
}

/// Whether two readings are one.
fn same(one: Option<&Tachometer>, other: Option<&Tachometer>) -> bool {
    match (one, other) {
        (None, None) => true,
        // Of opposite slips the beats are alike, the angles run the other way.
        (Some(one), Some(other)) => {
            let turns = |read: &Tachometer| read.turns.copysign(read.slip);
            (turns(one) - turns(other)).abs() < APART_TURNS
        }
        _ => false,
    }
}

/// Which answer explains most for what it asks to be believed: terms, and a speed and an angle for each recording.
fn plainest(answers: &[Answered]) -> usize {
    let price = |(turning, answer): &Answered| {
        let believed = answer.found.best.terms.len() + usize::from(turning.read.is_some());
        answer.cost + PRICE * believed as f64
    };
    let priced = answers.iter().map(price).enumerate();
    priced.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(index, _)| index)
}

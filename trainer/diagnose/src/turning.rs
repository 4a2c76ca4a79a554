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
use fit::simulate::{Arcs, Course, Fidelity, Run, Tachometer, Track, refined_starts, tachometer, track};
use model::mechanism::{Mechanism, PumpDroop, PumpSpeed};
use model::rig::{Attached, Pump, Rig};

use crate::answer::{Answer, Asked};
use crate::bench::{Bench, Effort};
use crate::diagnosis::Verdict;
use crate::error::DiagnoseError;
use crate::figures::{Figures, figures};
use crate::judge::{FLOOR_KPA, Judgement};

/// Turns of the ripple in the longest recording below which a reading may be something slow that is missing.
const CERTAIN_TURNS: f64 = 1.5;
/// Turns in the longest recording by which two readings are told apart.
const APART_TURNS: f64 = 0.25;
/// Drop in cost (half chi-square) that pays for a term, and for a reading: a speed and an angle for each recording.
const PRICE: f64 = 20.0;
/// Share of the stated speed from which on another one is missing physics; less is how such motors scatter.
const NAMED: f64 = 0.002;
/// Share of a droop, or of a change of speed, that is never known better: readings of the load have gains of their own.
const CALIBRATION: f64 = 0.01;
/// z of a two-sided interval of 90 %.
const NINETY: f64 = 1.645;
/// Angles of the crank over which strokes are averaged.
const ANGLES: usize = 4;

/// A mechanism of the pump that its ripple told.
#[derive(Debug, Clone)]
pub(crate) struct Heard {
    /// Its entry in the rig file.
    pub(crate) attached: Attached,
    /// Key of its number.
    pub(crate) key: &'static str,
    pub(crate) unit: &'static str,
    pub(crate) value: f64,
    /// Interval that holds it with 90 %.
    pub(crate) interval: [f64; 2],
    /// Log-likelihood that the ripple gains by it.
    pub(crate) log_likelihood: f64,
    /// Share of what was unexplained that goes with it.
    pub(crate) share: f64,
    /// How it shows, to be read after a semicolon.
    pub(crate) shows: String,
}

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
    /// Where the ripple was taken out: the rig fitted without what was heard, and the recordings as they came.
    without: Option<(Rig, Records)>,
}

impl Turning {
    /// By a ripple that kept step, or stood still.
    fn in_step(rig: &Rig, records: &Records, point: &[f64], read: Option<Tachometer>) -> Self {
        let mut turning = Turning {
            rig: rig.clone(),
            records: records.clone(),
            point: point.to_vec(),
            heard: None,
            fidelity: Fidelity::Detailed,
            read: None,
            without: None,
        };
        if let Some(read) = read
            && let Some(Pump::Piston(pump)) = turning.rig.pumps.get_mut(&read.pump)
        {
            turning.records = turning.records.with_cranks(&read.crank_rev);
            let stated_rpm = pump.speed_rpm;
            if read.slip.abs() < NAMED {
                pump.speed_rpm = read.speed_rpm;
            } else {
                let heard = Heard::steady(&read);
                turning.rig.mechanisms.push(heard.attached.clone());
                turning.heard = Some(heard);
            }
            turning.read = Some((read, stated_rpm));
        }
        turning
    }

    /// By a ripple that was followed; `bench` holds the recordings as they came, `fitted` is the rig as fitted to them.
    fn followed(
        bench: &Bench<'_>,
        fitted: &Rig,
        point: &[f64],
        followed: &Track,
        threads: Option<usize>,
    ) -> Result<Self, DiagnoseError> {
        let mut rig = bench.rig.clone();
        let strokes = strokes_kpa(bench, fitted)?;
        let readings = bench.records.readings_kpa().iter().zip(&followed.ripple_kpa).zip(strokes);
        let records =
            bench.records.with_readings(readings.map(|((r, ripple), stroke)| r - ripple - stroke).collect())?;
        let plain = Bench::new(bench.rig, &records, bench.counted(), Fidelity::Smooth, threads);
        let without = plain.fit(&[], &[], &[point.to_vec()], Effort::Polish)?.fitted.rig;
        if let (Course::Drooping { share, .. }, Some(Pump::Piston(pump))) =
            (followed.course, rig.pumps.get_mut(&followed.pump))
        {
            pump.speed_rpm *= 1.0 + share;
        }
        let heard = Heard::of(followed);
        rig.mechanisms.push(heard.attached.clone());
        Ok(Turning {
            rig,
            records,
            point: point.to_vec(),
            heard: Some(heard),
            fidelity: Fidelity::Smooth,
            read: None,
            without: Some((without, bench.records.clone())),
        })
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

    /// The re-identified rig without what was heard, given the one with it.
    fn without(&self, nominal: &Rig) -> Rig {
        if let Some((without, _)) = &self.without {
            return without.clone();
        }
        let mut rig = nominal.clone();
        if let Some(heard) = &self.heard {
            rig.mechanisms.retain(|attached| *attached != heard.attached);
        }
        rig
    }

    /// Figures of the re-identified rig without what was heard, given the one with it; with the ripple on the readings.
    pub(crate) fn reidentified(&self, bench: &Bench<'_>, nominal: &Rig, short: bool) -> Result<Figures, DiagnoseError> {
        let without = self.without(nominal);
        Ok(match &self.without {
            Some((_, records)) if records.rows() == bench.records.rows() => {
                let raw = Bench::new(&without, records, bench.counted(), Fidelity::Detailed, None);
                figures(&raw, &without, Fidelity::Detailed, short)?
            }
            _ => figures(bench, &without, bench.close.fidelity(), short)?,
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
            return Some(format!("the pump's ripple tells how it turned: {}", heard.shows));
        }
        self.read.as_ref().map(|(read, stated_rpm)| {
            format!(
                "the readings swing with the pump's ripple at {:.3} Hz: {} turns at {:.2} rev/min, not at {stated_rpm:.2} \
                 as in the rig file; taken into account",
                read.beat_hz, read.pump, read.speed_rpm
            )
        })
    }
}

impl Heard {
    /// A speed that keeps step.
    fn steady(read: &Tachometer) -> Self {
        let percent = 100.0 * read.slip;
        // The grid of the reading resolves a sixty-fourth of a turn.
        let error = percent.abs() / (64.0 * read.turns.max(1.0));
        let shows =
            format!("it beats at {:.2} Hz in the samples, as it does at {:.1} rev/min", read.beat_hz, read.speed_rpm);
        Heard::speed(&read.pump, percent, error, read.log_likelihood, 1.0, shows)
    }

    fn speed(pump: &str, percent: f64, error: f64, log_likelihood: f64, share: f64, shows: String) -> Self {
        Heard {
            attached: attached(pump, Mechanism::PumpSpeed(PumpSpeed { change_percent: percent })),
            key: "change_percent",
            unit: "%",
            value: percent,
            interval: [percent - error, percent + error],
            log_likelihood,
            share,
            shows,
        }
    }

    /// What a course of the speed is called.
    fn of(followed: &Track) -> Self {
        let Track { pump, log_likelihood, share, .. } = followed;
        let leading = followed.course.leading();
        let error = (NINETY * followed.error).max(CALIBRATION * leading.abs());
        match followed.course {
            Course::Drooping { per_bar, .. } => Heard {
                attached: attached(pump, Mechanism::PumpDroop(PumpDroop { speed_loss_per_bar: per_bar })),
                key: "speed_loss_per_bar",
                unit: "1/bar",
                value: per_bar,
                interval: [(per_bar - error).max(0.0), per_bar + error],
                log_likelihood: *log_likelihood,
                share: *share,
                shows: format!(
                    "it slows by {:.1} % per bar between the pump's ports, {:.1} % on average",
                    100.0 * per_bar,
                    -100.0 * followed.mean_share
                ),
            },
            Course::Constant { share: off } => {
                let shows = format!("it is {:+.2} % off the stated speed", 100.0 * off);
                Heard::speed(pump, 100.0 * off, 100.0 * error, *log_likelihood, *share, shows)
            }
            Course::Warming { share: end, time_s } => {
                let shows = format!(
                    "the speed moves by {:+.2} % from the start of each recording on, with a time constant of {time_s:.0} s; \
                     its mean of {:+.2} % is in the rig file",
                    100.0 * end,
                    100.0 * followed.mean_share
                );
                // Between where it starts and where it ends.
                let mut heard = Heard::speed(pump, 100.0 * followed.mean_share, 0.0, *log_likelihood, *share, shows);
                heard.interval = [end.min(0.0) * 100.0, end.max(0.0) * 100.0];
                heard
            }
        }
    }
}

fn attached(pump: &str, mechanism: Mechanism) -> Attached {
    Attached { component: pump.to_owned(), enabled: true, mechanism }
}

/// What the detailed simulation of a rig differs by from the averaged one, on average over where the crank starts, in kPa.
fn strokes_kpa(bench: &Bench<'_>, rig: &Rig) -> Result<Vec<f64>, DiagnoseError> {
    let arcs = refined_starts(&bench.fast, rig, &Arcs::free(bench.records))?;
    // Half a turn of a pair of pistons is all there is to see.
    let runs: Vec<Run> =
        (0..ANGLES).map(|k| Run { crank_rev: 0.5 * k as f64 / ANGLES as f64, ..Run::from(rig.clone()) }).collect();
    let mut less = vec![0.0; bench.records.layout().len()];
    for (simulator, sign) in [(&bench.close, 1.0), (&bench.fast, -1.0)] {
        for trace in simulator.run(&runs, &arcs) {
            let trace = trace.map_err(DiagnoseError::rig(rig))?;
            for (slot, kpa) in less.iter_mut().zip(trace) {
                *slot += sign * kpa / ANGLES as f64;
            }
        }
    }
    Ok(less)
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
    let mut readings = tachometer(&bench.fast, &fitted.rig, bench.fit_weights())?;
    let ambiguous = readings.first().is_some_and(|read| read.turns < CERTAIN_TURNS);
    if (readings.is_empty() || ambiguous)
        && let Some(followed) = track(&bench.fast, &fitted.rig, usable)?
    {
        let turning = Turning::followed(&bench, &fitted.rig, &fitted.point, &followed, asked.threads)?;
        // What the pump's speed does is known.
        asked.candidates.retain(|candidate| !["pump_droop", "pump_speed"].contains(&candidate.id.as_str()));
        let answer = turning.answer(asked, usable, progress)?;
        return Ok((turning, answer));
    }
    let mut point = fitted.point;
    if readings.len() > 1 && !ambiguous {
        let forwards = forwards(rig, &records, usable, asked.threads, readings, &point)?;
        (readings, point) = (vec![forwards.0], forwards.1);
    }
    let mut tried: Vec<Option<Tachometer>> = readings.into_iter().map(Some).collect();
    if ambiguous || tried.is_empty() {
        tried.push(None);
    }
    let mut answers = Vec::new();
    let mut work_out = |read: Option<Tachometer>, answers: &mut Vec<Answered>| -> Result<(), DiagnoseError> {
        let turning = Turning::in_step(rig, &records, &point, read);
        let answer = turning.answer(asked, usable, progress)?;
        answers.push((turning, answer));
        Ok(())
    };
    for read in tried {
        if !answers.iter().any(|(_, answer)| is_whole(answer)) {
            work_out(read, &mut answers)?;
        }
    }
    let again = match answers.get(plainest(&answers)) {
        Some((turning, answer)) if !answer.found.best.terms.is_empty() => {
            let with_terms = at_stated_speed(&turning.without(&answer.found.best.fitted.rig), rig);
            Some(tachometer(&bench.fast, &with_terms, bench.fit_weights())?.into_iter().next())
        }
        _ => None,
    };
    if let Some(again) = again
        && !answers.iter().any(|(turning, _)| same(turning.tachometer(), again.as_ref()))
    {
        work_out(again, &mut answers)?;
    }
    let plainest = plainest(&answers);
    answers.into_iter().nth(plainest).ok_or_else(|| fit::FitError::NoRecordings.into())
}

/// Which of two opposite readings is meant: the one with which the rig's own parameters explain more. With it, the
/// parameters as fitted then.
fn forwards(
    rig: &Rig,
    records: &Records,
    usable: &[f64],
    threads: Option<usize>,
    readings: Vec<Tachometer>,
    point: &[f64],
) -> Result<(Tachometer, Vec<f64>), DiagnoseError> {
    let mut best: Option<(f64, Tachometer, Vec<f64>)> = None;
    for read in readings {
        let turning = Turning::in_step(rig, records, point, Some(read.clone()));
        let bench = Bench::new(&turning.rig, &turning.records, usable, Fidelity::Averaged, threads);
        let fitted = bench.fit(&[], &[], &[point.to_vec()], Effort::Polish)?.fitted;
        let cost = fitted.comparable_cost(bench.records, bench.fit_weights());
        if best.as_ref().is_none_or(|(least, ..)| cost < *least) {
            best = Some((cost, read, fitted.point));
        }
    }
    best.map(|(_, read, point)| (read, point)).ok_or_else(|| fit::FitError::NoRecordings.into())
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

/// Which answer explains most for what it asks to be believed.
fn plainest(answers: &[Answered]) -> usize {
    let price = |(turning, answer): &Answered| {
        let believed = answer.found.best.terms.len() + usize::from(turning.read.is_some());
        answer.cost + PRICE * believed as f64
    };
    let priced = answers.iter().map(price).enumerate();
    priced.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(index, _)| index)
}

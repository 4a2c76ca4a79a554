//! Turning of the pump, and the answer that goes with it.
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
//! When it is asked again, sensors do not drift (that is what a slow ripple passes for), and of two opposite readings the
//! one is meant with which what was found explains more: before it was found, either may have looked the better.

use fit::data::Records;
use fit::simulate::{Fidelity, Ripple, Tachometer, Track, ripple_in_step, tachometer, track};
use model::rig::{Pump, Rig};
use proto::diagnosis::Verdict;

use crate::bench::{Bench, Effort};
use crate::error::DiagnoseError;
use crate::judge::{FLOOR_KPA, Judgement};
use crate::pump::answer::{Answer, Asked};
use crate::pump::crank;
use crate::pump::ripple::Heard;
use crate::report::figures::{Figures, figures};
use crate::search::{PRICE, PRICE_OF_A_PARAMETER};

mod late;
mod raw;
use raw::{Beside, Raw};

/// Turns of the ripple in the longest recording below which a reading may be something slow that is missing.
const CERTAIN_TURNS: f64 = 1.5;
/// Turns in the longest recording below which no frequency is stated: two periods are what it takes to see that something repeats.
const NAMED_TURNS: f64 = 2.0;
/// Turns in the longest recording by which two readings are told apart.
const APART_TURNS: f64 = 0.25;
/// Change of the ripple at which an answer is worked out again, in kPa: what a term must set right to be named.
const REDONE_KPA: f64 = 0.03;
/// Least ratio of what an answer leaves to what the ripples of two readings differ by, for the other reading not to be tried: it
/// would change a sixteenth of the mean square.
const NO_MATTER: f64 = 4.0;
/// By how much sensors that lag may cost more than late valves and be as good an answer: a ripple that neither explains moves such
/// costs by some tens.
const AS_GOOD: f64 = 2.0 * PRICE;
/// Share of the stated speed from which on another one is missing physics; less is how such motors scatter.
const NAMED: f64 = 0.002;

/// The rig with its pump at the speed that its ripple tells, the recordings with cranks where they stood or without
/// ripple, and the rig's own parameters as fitted.
pub(crate) struct Turning {
    pub(crate) rig: Rig,
    pub(crate) records: Records,
    pub(crate) point: Vec<f64>,
    /// Findings from the ripple that have a name.
    pub(crate) heard: Option<Heard>,
    /// Fidelity at which the recordings are to be simulated.
    fidelity: Fidelity,
    /// Reading of the ripple where it kept step, and the speed in the rig file in rev/min.
    read: Option<(Tachometer, f64)>,
    /// The ripple that was taken out of the readings, in kPa; empty for none.
    ripple_kpa: Vec<f64>,
    /// Steps by channel that the readings were rounded to before a ripple was taken out, in kPa; empty where none was.
    steps_kpa: Vec<f64>,
    /// The rig whose strokes the pump makes, if not the one that is fitted: sensors that lag see little of them.
    pub(crate) strokes_of: Option<Rig>,
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
            steps_kpa: Vec::new(),
            strokes_of: None,
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
        turning.steps_kpa = bench.steps_kpa();
        if let Some(Pump::Piston(pump)) = turning.rig.pumps.get_mut(&read.pump) {
            let stated_rpm = pump.speed_rpm;
            if read.slip.abs() < NAMED {
                pump.speed_rpm = read.speed_rpm;
            } else {
                let heard = Heard::steady(&read);
                turning.rig.mechanisms.extend(heard.attached());
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
        let plain = bench.over(&records, bench.counted(), Fidelity::Smooth);
        let without = plain.fit(&[], &[], &[point.to_vec()], Effort::Polish)?.fitted.rig;
        let heard = Heard::of(followed);
        if let Some(Pump::Piston(pump)) = rig.pumps.get_mut(&followed.pump) {
            pump.speed_rpm *= 1.0 + heard.unnamed_share;
        }
        rig.mechanisms.extend(heard.attached());
        Ok(Turning {
            heard: Some(heard),
            fidelity: Fidelity::Smooth,
            ripple_kpa: followed.ripple_kpa.clone(),
            steps_kpa: bench.steps_kpa(),
            without: Some((without, bench.records.clone())),
            ..Turning::as_stated(&rig, &records, point)
        })
    }

    /// By how much another one's ripple differs, root mean square in kPa; one that takes none out has a ripple of zero.
    fn ripple_off_kpa(&self, other: &Turning) -> f64 {
        let readings = self.ripple_kpa.len().max(other.ripple_kpa.len());
        let of = |turning: &Turning, i: usize| turning.ripple_kpa.get(i).copied().unwrap_or(0.0);
        let squares = (0..readings).map(|i| (of(self, i) - of(other, i)).powi(2)).sum::<f64>();
        (squares / readings.max(1) as f64).sqrt()
    }

    /// Tells whether an answer has no name and leaves so much that another reading of the ripple is nothing beside it. Of an answer
    /// that has one, a ripple may say that it is another: sensors that lag leave little of it.
    fn is_no_matter(&self, (other, answer): &Answered) -> bool {
        let left = answer.judgement.excess_kpa[2].iter().copied().fold(0.0, f64::max);
        answer.judgement.verdict == Verdict::UnknownMechanism && left > NO_MATTER * self.ripple_off_kpa(other)
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
    pub(crate) fn bench<'t>(&'t self, usable: &[f64], short: bool) -> Bench<'t> {
        let slow_ripple = self.tachometer().is_some_and(|read| read.turns < CERTAIN_TURNS);
        Bench::new(&self.rig, &self.records, usable, self.fidelity)
            .shortened(short)
            .beside_slow_ripple(slow_ripple)
            .rounded_to(&self.steps_kpa)
    }

    fn answer(
        &self,
        asked: &Asked<'_>,
        usable: &[f64],
        progress: &mut dyn FnMut(&str, f64),
    ) -> Result<Answer, DiagnoseError> {
        Answer::of(&self.bench(usable, asked.quick), asked, &self.point, self.strokes_of.as_ref(), progress)
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
                let raw = Bench::new(without, records, bench.counted(), Fidelity::Detailed);
                figures(&raw, without, Fidelity::Detailed, short)?
            }
            _ => fitted,
        })
    }

    /// Makes what was heard count as missing physics, whatever else there is.
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

    /// Note on how the pump turned.
    pub(crate) fn note(&self) -> Option<String> {
        if let Some(heard) = &self.heard {
            return Some(format!(
                "the pump's ripple tells how it turned: {}; errors and plots are of readings that it was taken out of",
                heard.shows()
            ));
        }
        self.read.as_ref().map(|(read, stated_rpm)| {
            if read.turns < NAMED_TURNS {
                return format!(
                    "a swing of the readings was taken out of them as the pump's ripple, at {:.2} rev/min instead of {stated_rpm:.2} \
                     as in the rig file: it turns {:.1} times in the longest recording, too few for a frequency, and may as well be \
                     a sensor that drifts; errors and plots are without it. Record {:.0} min in one run to tell",
                    read.speed_rpm,
                    read.turns,
                    (NAMED_TURNS / (60.0 * read.beat_hz)).ceil()
                );
            }
            format!(
                "the readings swing with the pump's ripple at {:.3} Hz: {} turns at {:.2} rev/min, not at {stated_rpm:.2} \
                 as in the rig file; errors and plots are of readings that it was taken out of",
                read.beat_hz, read.pump, read.speed_rpm
            )
        })
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
    let bench = Bench::new(rig, &records, usable, Fidelity::Detailed).shortened(asked.quick);
    let origin = vec![0.0; bench.nominal.len()];
    let fitted = bench.fit(&[], &[], &[origin], Effort::Full)?.fitted;
    let ripple = Ripple::of(&bench.fast, &fitted.rig)?;
    let readings = ripple.as_ref().map_or(Vec::new(), |ripple| tachometer(&records, ripple, bench.counted()));
    let ambiguous = readings.first().is_none_or(|read| read.turns < CERTAIN_TURNS);
    let followed =
        ripple.filter(|_| ambiguous).and_then(|ripple| track(&records, &fitted.rig, &ripple, bench.counted()));
    let begins_alike = readings.first().is_some_and(|read| match rig.pumps.get(&read.pump) {
        Some(Pump::Piston(pump)) => crank::stood_alike(pump, &read.crank_rev),
        _ => false,
    });
    let raw = Raw::of(&bench, &fitted.rig);
    let mut turnings = Vec::new();
    if let Some(followed) = &followed {
        turnings.push(Turning::followed(&raw, &fitted.point, followed)?);
        asked.knows_the_speed();
    } else {
        turnings.extend(raw.forwards(readings, &fitted.point)?);
    }
    if followed.is_none() && ambiguous {
        turnings.push(Turning::as_stated(rig, &records, &fitted.point));
    }
    let mut answers: Vec<Answered> = Vec::new();
    for turning in turnings {
        // A slow swing that begins alike in all recordings may be what begins anew in each of them: a sensor that drifts.
        let doubted = begins_alike && turning.read.is_none();
        let settled = |known: &Answered| is_whole(&known.1) || turning.is_no_matter(known);
        if doubted || !answers.iter().any(settled) {
            let answer = turning.answer(asked, usable, progress)?;
            answers.push((turning, answer));
        }
    }
    // With what was found in the rig the ripple may tell another speed, or be another one: a sensor that lags shows little, and what
    // was found late in a valve may have been such a sensor.
    let first_at = plainest(&answers);
    let (mut either, mut lagging) = (None, None);
    if let Some(first_answer @ (first, answer)) = answers.get(first_at)
        && followed.is_none()
        && !answer.found.best.terms.is_empty()
    {
        let found = Beside::of(answer, asked);
        let ripple = raw.ripple_beside(&found)?;
        let mut again = raw.read_again(&first.point, &found, ripple.as_ref())?;
        if again.is_none()
            && let Some(turning) = raw.followed_beside(&first.point, ripple.as_ref())?
        {
            let numbers = found.numbers(&bench);
            asked.begin_also_at(numbers);
            asked.knows_the_speed();
            let answer = turning.answer(asked, usable, progress)?;
            return Ok((turning, answer));
        }
        let mut in_place = false;
        if again.is_none()
            && first.tachometer().is_none()
            && let Some(in_sensors) = late::in_sensors(&bench, &found)
            && !(asked.quick && late::is_far_behind(&bench.reduced(&answer.reduced), &in_sensors)?)
        {
            in_place = true;
            again = raw.read_again(&first.point, &in_sensors, raw.ripple_beside(&in_sensors)?.as_ref())?;
            lagging = raw.lagging(&in_sensors)?.map(|(instead, cost)| (instead, cost - answer.cost));
        }
        let turning = match again {
            Some(again) => {
                let is_old = |turning: &Turning| {
                    same(turning.tachometer(), again.tachometer()) && again.ripple_off_kpa(turning) <= REDONE_KPA
                };
                let known = answers.iter().any(|(turning, _)| is_old(turning));
                (!known && !again.is_no_matter(first_answer)).then_some(again)
            }
            None if answers.iter().any(|(turning, _)| turning.read.is_none()) => {
                lagging.as_ref().filter(|(_, dearer)| *dearer < 0.0).map(|(lagging, _)| Turning {
                    strokes_of: Some(lagging.fitted.rig.clone()),
                    ..Turning::as_stated(rig, &records, &fitted.point)
                })
            }
            None => Some(Turning::as_stated(rig, &records, &fitted.point)),
        };
        if let Some(turning) = turning {
            let answer = turning.answer(asked, usable, progress)?;
            either = in_place.then_some([first_at, answers.len()]);
            answers.push((turning, answer));
        }
    }
    let plainest = plainest(&answers);
    let rival = either.filter(|either| either.contains(&plainest)).and_then(|either| {
        let [one, other] = either.map(|at| answers.get(at));
        let close = (price(one?) - price(other?)).abs() < PRICE;
        let rival = if either[0] == plainest { other } else { one };
        rival.filter(|_| close).map(|(_, answer)| answer.found.best.clone())
    });
    // Whatever the ripple was read as: valves are not late where sensors that lag explain as much.
    let as_good = lagging.filter(|(_, dearer)| plainest == first_at && *dearer < AS_GOOD).map(|(lagging, _)| lagging);
    let rival = rival.or(as_good);
    let mut chosen = answers.into_iter().nth(plainest).ok_or(fit::FitError::NoRecordings)?;
    if let Some(rival) = rival {
        late::contest(&mut chosen.1, rival, &asked.candidates);
    }
    Ok(chosen)
}

/// Tells whether nothing is left to be explained, and nothing had to be added for it.
fn is_whole(answer: &Answer) -> bool {
    answer.found.best.terms.is_empty() && answer.judgement.excess_kpa[1].iter().all(|kpa| *kpa < FLOOR_KPA)
}

/// Tells whether two readings are one.
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
    let priced = answers.iter().map(price).enumerate();
    priced.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(index, _)| index)
}

/// Price of an answer: what it leaves, on rows that were fitted and on rows that were not, and what it asks to be believed, terms
/// with their parameters, and a speed with an angle for each recording.
fn price((turning, answer): &Answered) -> f64 {
    let read = turning.tachometer().map_or(0, |read| 1 + read.crank_rev.len());
    let parameters = answer.found.best.set.len().saturating_sub(answer.found.nominal.set.len()) + read;
    let believed = answer.found.best.terms.len() + usize::from(read > 0);
    answer.cost + answer.cost_of_choice + PRICE * believed as f64 + PRICE_OF_A_PARAMETER * parameters as f64
}

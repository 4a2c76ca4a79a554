//! Mechanisms that the pump's ripple told, each with its name.
//!
//! Intervals come from the scatter between recordings (90 %), and are never narrower than sensors are right: a load that is
//! read 1 % too large makes a droop 1 % too small.

use fit::objective::NINETY;
use fit::simulate::{Droop, Tachometer, Track, Warming};
use fit::wording::{change_in_percent, percent};
use model::mechanism::{Mechanism, PumpDroop, PumpSpeed};
use model::rig::MechanismInstance;

/// Share of a droop, or of a change of speed, that is never known better: readings of the load have gains of their own.
const CALIBRATION: f64 = 0.01;

/// Share from which on a speed that is off besides a droop has a name: less is how such motors scatter under load.
const BESIDES: f64 = 0.01;
/// Share of the mean droop from which on such a speed has a name: loads are read with gains and zeros of their own.
const OF_THE_DROOP: f64 = 0.1;
/// Standard errors from which on such a speed has a name.
const CERTAIN: f64 = 3.0;

/// Findings from the pump's ripple.
#[derive(Debug, Clone)]
pub(crate) struct Heard {
    /// Mechanisms of the pump.
    pub(crate) told: Vec<Told>,
    /// Share by which the pump is off the stated speed besides, which has no name.
    pub(crate) unnamed_share: f64,
    /// Log-likelihood that the ripple gains by it.
    pub(crate) log_likelihood: f64,
    /// Share of what was unexplained that goes with it.
    pub(crate) share: f64,
}

/// A mechanism that it told.
#[derive(Debug, Clone)]
pub(crate) struct Told {
    /// Entry of the mechanism in the rig file.
    pub(crate) attached: MechanismInstance,
    pub(crate) numbers: Vec<Number>,
    /// Words on how it shows, to be read after a semicolon.
    pub(crate) shows: String,
}

/// One of its numbers.
#[derive(Debug, Clone)]
pub(crate) struct Number {
    /// As in the rig file.
    pub(crate) key: &'static str,
    pub(crate) unit: &'static str,
    pub(crate) value: f64,
    /// Interval that holds it with 90 %.
    pub(crate) interval: [f64; 2],
}

impl Number {
    fn within(key: &'static str, unit: &'static str, value: f64, error: f64) -> Self {
        Number { key, unit, value, interval: [value - error, value + error] }
    }

    /// The number with its interval cut off at zero, for what is never negative.
    fn positive(self) -> Self {
        let [low, high] = self.interval;
        Number { interval: [low.max(0.0), high], ..self }
    }
}

impl Heard {
    /// A speed that keeps step.
    pub(crate) fn steady(read: &Tachometer) -> Self {
        let percent = 100.0 * read.slip;
        // The grid of the reading resolves a sixty-fourth of a turn.
        let error = percent.abs() / (64.0 * read.turns.max(1.0));
        let shows =
            format!("it beats at {:.2} Hz in the samples, as it does at {:.1} rev/min", read.beat_hz, read.speed_rpm);
        let told = vec![Told::steady(&read.pump, percent, error, shows)];
        Heard { told, unnamed_share: 0.0, log_likelihood: read.log_likelihood, share: 1.0 }
    }

    /// Findings from a course of the speed.
    pub(crate) fn of(followed: &Track) -> Self {
        let Track { pump, course, errors, .. } = followed;
        let error_of = |error: f64, value: f64| (NINETY * error).max(CALIBRATION * value.abs());
        let mean_droop = course.droop.map_or(0.0, |_| (course.share - followed.mean_share) / (1.0 + course.share));
        let mut told = Vec::new();
        if let (Some(Droop { per_bar, .. }), Some(error)) = (course.droop, errors.droop) {
            let loss = Number::within("speed_loss_per_bar", "1/bar", per_bar, error_of(error.per_bar, per_bar));
            told.push(Told {
                attached: attached(pump, Mechanism::PumpDroop(PumpDroop { speed_loss_per_bar: per_bar })),
                numbers: vec![loss.positive()],
                shows: format!(
                    "it slows by {} per bar between the pump's ports, {} on average",
                    percent(per_bar, 1),
                    percent(mean_droop, 1)
                ),
            });
        }
        if let (Some(Warming { share: end, time_s }), Some(error)) = (course.warming, errors.warming) {
            let percent = Number::within("change_percent", "%", 100.0 * end, 100.0 * error_of(error.share, end));
            let time = Number::within("time_constant_s", "s", time_s, error_of(error.time_s, time_s));
            let speed = PumpSpeed { change_percent: 100.0 * end, time_constant_s: time_s };
            told.push(Told {
                attached: attached(pump, Mechanism::PumpSpeed(speed)),
                numbers: vec![percent, time.positive()],
                shows: format!(
                    "the speed moves by {} from the start of each recording on, with a time constant of {time_s:.0} s",
                    change_in_percent(end, 2)
                ),
            });
        }
        let off = course.share;
        let by_load = OF_THE_DROOP * mean_droop.abs();
        let stands_out = course.warming.is_none() && off.abs() > BESIDES.max(by_load).max(CERTAIN * errors.share);
        let steady = course.droop.is_none() && course.warming.is_none();
        if steady || stands_out {
            let error = error_of(errors.share, off).max(CALIBRATION * mean_droop.abs());
            let besides = if steady { "" } else { " without load" };
            let shows = format!("it is {} off the stated speed{besides}", change_in_percent(off, 2));
            told.push(Told::steady(pump, 100.0 * off, 100.0 * error, shows));
        }
        Heard {
            told,
            unnamed_share: if steady || stands_out { 0.0 } else { off },
            log_likelihood: followed.log_likelihood,
            share: followed.share,
        }
    }

    /// Entries of the rig file.
    pub(crate) fn attached(&self) -> impl Iterator<Item = MechanismInstance> + '_ {
        self.told.iter().map(|told| told.attached.clone())
    }

    /// Words on how all of them show.
    pub(crate) fn shows(&self) -> String {
        self.told.iter().map(|told| told.shows.as_str()).collect::<Vec<_>>().join(", and ")
    }
}

impl Told {
    /// Another speed all the time.
    fn steady(pump: &str, percent: f64, error: f64, shows: String) -> Self {
        let speed = PumpSpeed { change_percent: percent, time_constant_s: 0.0 };
        Told {
            attached: attached(pump, Mechanism::PumpSpeed(speed)),
            numbers: vec![Number::within("change_percent", "%", percent, error)],
            shows,
        }
    }
}

fn attached(pump: &str, mechanism: Mechanism) -> MechanismInstance {
    MechanismInstance { component: pump.to_owned(), enabled: true, mechanism }
}

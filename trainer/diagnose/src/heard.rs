//! What the pump's ripple told, as a mechanism that is named.
//!
//! Intervals come from the scatter between recordings (90 %), and are never narrower than sensors are right: a load that is
//! read 1 % too large makes a droop 1 % too small.

use fit::objective::NINETY;
use fit::simulate::{Course, Tachometer, Track};
use model::mechanism::{Mechanism, PumpDroop, PumpSpeed};
use model::rig::Attached;

/// Share of a droop, or of a change of speed, that is never known better: readings of the load have gains of their own.
const CALIBRATION: f64 = 0.01;

/// A mechanism of the pump that its ripple told.
#[derive(Debug, Clone)]
pub(crate) struct Heard {
    /// Its entry in the rig file.
    pub(crate) attached: Attached,
    pub(crate) numbers: Vec<Number>,
    /// Log-likelihood that the ripple gains by it.
    pub(crate) log_likelihood: f64,
    /// Share of what was unexplained that goes with it.
    pub(crate) share: f64,
    /// How it shows, to be read after a semicolon.
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

impl Heard {
    /// A speed that keeps step.
    pub(crate) fn steady(read: &Tachometer) -> Self {
        let percent = 100.0 * read.slip;
        // The grid of the reading resolves a sixty-fourth of a turn.
        let error = percent.abs() / (64.0 * read.turns.max(1.0));
        let shows =
            format!("it beats at {:.2} Hz in the samples, as it does at {:.1} rev/min", read.beat_hz, read.speed_rpm);
        let speed = PumpSpeed { change_percent: percent, time_constant_s: 0.0 };
        Heard::speed(&read.pump, speed, error, read.log_likelihood, 1.0, shows)
    }

    fn speed(pump: &str, speed: PumpSpeed, error: f64, log_likelihood: f64, share: f64, shows: String) -> Self {
        let percent = speed.change_percent;
        Heard {
            attached: attached(pump, Mechanism::PumpSpeed(speed)),
            numbers: vec![Number {
                key: "change_percent",
                unit: "%",
                value: percent,
                interval: [percent - error, percent + error],
            }],
            log_likelihood,
            share,
            shows,
        }
    }

    /// What a course of the speed is called.
    pub(crate) fn of(followed: &Track) -> Self {
        let Track { pump, log_likelihood, share, .. } = followed;
        let leading = followed.course.leading();
        let error = (NINETY * followed.error).max(CALIBRATION * leading.abs());
        match followed.course {
            Course::Drooping { per_bar, .. } => Heard {
                attached: attached(pump, Mechanism::PumpDroop(PumpDroop { speed_loss_per_bar: per_bar })),
                numbers: vec![Number {
                    key: "speed_loss_per_bar",
                    unit: "1/bar",
                    value: per_bar,
                    interval: [(per_bar - error).max(0.0), per_bar + error],
                }],
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
                let speed = PumpSpeed { change_percent: 100.0 * off, time_constant_s: 0.0 };
                Heard::speed(pump, speed, 100.0 * error, *log_likelihood, *share, shows)
            }
            Course::Warming { share: end, time_s } => {
                let shows = format!(
                    "the speed moves by {:+.2} % from the start of each recording on, with a time constant of {time_s:.0} s",
                    100.0 * end
                );
                let speed = PumpSpeed { change_percent: 100.0 * end, time_constant_s: time_s };
                let mut heard = Heard::speed(pump, speed, 100.0 * error, *log_likelihood, *share, shows);
                let error_s = (NINETY * followed.time_error_s).max(CALIBRATION * time_s);
                heard.numbers.push(Number {
                    key: "time_constant_s",
                    unit: "s",
                    value: time_s,
                    interval: [(time_s - error_s).max(0.0), time_s + error_s],
                });
                heard
            }
        }
    }
}

fn attached(pump: &str, mechanism: Mechanism) -> Attached {
    Attached { component: pump.to_owned(), enabled: true, mechanism }
}

//! `controller run`: the daemon.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use controller::config::{Config, Pacing};
use controller::daemon::{self, Options};
use controller::machine::signals;
use controller::operator::console::{Admission, Throttle};
use controller::session::run_length::{Begins, RunClock, RunEnd, RunLength};
use flight::Recorded;
use proto::recording::EventLevel;

use super::Failure;
use super::console::tell;

pub(super) fn run(file: &Path, seconds: Option<f64>) -> Result<(), Failure> {
    if let Some(s) = seconds
        && !(s.is_finite() && s > 0.0)
    {
        return Err(Failure::input(format!("--seconds {s:?}: give a time above 0")));
    }
    // Examining a policy takes seconds, in which only an order to end ends the program.
    signals::hold_until_install().map_err(Failure::work)?;
    let (config, config_text) = Config::read_with_text(file)?;
    let loaded = daemon::load(&config)?;
    tell(format_args!(
        "{} controls, on the model {}, cRIO at {}",
        loaded.policy.as_ref().map_or("the feed-forward PI", |p| p.name()),
        loaded.rig.name,
        config.link.address
    ));
    let clock = if config.link.pacing == Pacing::Lockstep { RunClock::Lockstep } else { RunClock::Realtime };
    let options = Options {
        recording: None,
        length: seconds.map_or(RunLength::ENDLESS, |s| RunLength::seconds(s, Begins::WhenArmed, clock)),
        socket: true,
        extra: vec![("command".to_owned(), format!("controller run --config {}", file.display()))],
        attachments: Vec::new(),
        config_text,
        config_file: Some(file.to_owned()),
        observer: Box::new(say_events()),
        stop: Arc::new(AtomicBool::new(false)),
    };
    let daemon::Flight { recording: summary, end } = daemon::run(&config, loaded, options)?;
    match summary.files.as_slice() {
        [] => tell("no tick came, so nothing was recorded"),
        [file] => tell(format_args!("recorded {} ticks in {}", summary.ticks, file.display())),
        [first, .., last] => tell(format_args!(
            "recorded {} ticks in {} files, {} to {}",
            summary.ticks,
            summary.files.len(),
            first.display(),
            last.display()
        )),
    }
    match seconds {
        Some(seconds) if end == RunEnd::Before => Err(Failure::stopped_run(seconds)),
        _ => Ok(()),
    }
}

/// Prints what a person should know, a flood of it throttled; for the recorder's thread.
pub(super) fn say_events() -> impl FnMut(Recorded<'_>) + Send {
    let (mut throttle, mut errors) = (Throttle::default(), Throttle::default());
    move |recorded| {
        let Recorded::Event { level, message, .. } = recorded else { return };
        // Errors have a measure of their own: no flood of lesser notices may hide one.
        let throttle = if level == EventLevel::Error { &mut errors } else { &mut throttle };
        match throttle.admit(Instant::now()) {
            Admission::HoldBack => {}
            Admission::Print { held_back: 0 } => tell(format_args!("{message}")),
            Admission::Print { held_back } => {
                tell(format_args!("{message} ({held_back} notices before it were held back; the recording has them)"));
            }
        }
    }
}

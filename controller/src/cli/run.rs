//! `controller run`: the daemon.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use controller::config::{Config, Pacing};
use controller::daemon::{self, Options};
use controller::run_length::{Begins, RunClock, RunLength};
use flight::Recorded;

use super::Failure;
use super::console::tell;

pub(super) fn run(file: &Path, seconds: Option<f64>) -> Result<(), Failure> {
    if let Some(s) = seconds
        && !(s.is_finite() && s > 0.0)
    {
        return Err(Failure::input(format!("--seconds {s}: give a time above 0")));
    }
    let config = Config::read(file)?;
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
        config_text: std::fs::read_to_string(file).unwrap_or_default(),
        attachments: Vec::new(),
        observer: Box::new(say_events),
        stop: Arc::new(AtomicBool::new(false)),
    };
    let summary = daemon::run(&config, loaded, options)?;
    tell(format_args!("recorded {} ticks in {}", summary.ticks, summary.path.display()));
    Ok(())
}

/// Prints what a person should know; runs in the recorder's thread.
pub(super) fn say_events(recorded: Recorded<'_>) {
    if let Recorded::Event { message, .. } = recorded {
        tell(format_args!("{message}"));
    }
}

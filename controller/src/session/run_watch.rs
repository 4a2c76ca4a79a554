//! Tasks of the main thread while a run lasts: signals, configurations that are read again, a disk that does not answer.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, TryRecvError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use flight::Recorder;
use proto::recording::EventLevel;

use super::recording_folder::destination;
use super::session_recorder::TICK_END;
use crate::config::Config;
use crate::machine::clock::now_ns;
use crate::machine::signals::{Order, Signals};
use crate::operator::console::notice;
use crate::reload::{ReloadError, Reloaded, needs_restart, read_aside};

/// Between two looks of the main thread.
const LOOK: Duration = Duration::from_millis(20);

/// Things that the main thread looks after while the others work.
pub(super) struct Watch<'a> {
    signals: Signals,
    config: &'a Config,
    stem: &'static str,
    recorder: &'a Recorder,
    config_file: Option<PathBuf>,
    reloads: Sender<Reloaded>,
    reading: Option<Receiver<Result<Reloaded, ReloadError>>>,
    stalled: bool,
}

impl<'a> Watch<'a> {
    /// A watch over a run with this configuration, whose recordings' names begin with `stem`; what is read again goes to `reloads`.
    pub(super) fn new(
        config: &'a Config,
        config_file: Option<PathBuf>,
        recorder: &'a Recorder,
        stem: &'static str,
        signals: Signals,
        reloads: Sender<Reloaded>,
    ) -> Self {
        Watch { signals, config, stem, recorder, config_file, reloads, reading: None, stalled: false }
    }

    /// Returns once the thread has ended, or has had its time to end.
    pub(super) fn until_over<T>(&mut self, thread: &JoinHandle<T>, stop: &AtomicBool) {
        let mut since = None;
        while !thread.is_finished() {
            self.carry_out_orders();
            self.reloaded();
            self.disk();
            if stop.load(Ordering::Relaxed) && since.get_or_insert_with(Instant::now).elapsed() > TICK_END {
                return;
            }
            std::thread::sleep(LOOK);
        }
        // What came since the last look: the first signal of a run is the one that its status tells.
        self.carry_out_orders();
    }

    fn carry_out_orders(&mut self) {
        for order in self.signals.orders() {
            self.carry_out(order);
        }
    }

    fn say(&self, level: EventLevel, part: &'static str, text: String) {
        self.recorder.note(now_ns(), level, part, text);
    }

    fn carry_out(&mut self, order: Order) {
        match (order, &self.config_file) {
            (Order::Stop, _) => self.say(EventLevel::Info, "signal", "asked to end: vents open, goodbye".to_owned()),
            (Order::Nothing(name), _) => {
                self.say(EventLevel::Info, "signal", format!("{name} does nothing here; SIGTERM ends, SIGHUP reloads"));
            }
            (Order::Reload, None) => {
                self.say(EventLevel::Info, "signal", "SIGHUP: there is no configuration file to read again".to_owned());
            }
            (Order::Reload, Some(file)) => match read_aside(file.clone()) {
                Ok(from) => self.reading = Some(from),
                Err(error) => self.say(EventLevel::Warning, "reload", format!("nothing was read: {error}")),
            },
        }
    }

    /// Takes over what was read, if something was.
    fn reloaded(&mut self) {
        let Some(from) = &self.reading else { return };
        let read = match from.try_recv() {
            Ok(read) => read,
            Err(TryRecvError::Empty) => return,
            Err(TryRecvError::Disconnected) => return self.reading = None,
        };
        self.reading = None;
        let reloaded = match read {
            Ok(reloaded) => reloaded,
            Err(error) => {
                return self.say(EventLevel::Warning, "reload", format!("{error}; the configuration stays as it was"));
            }
        };
        let restart = needs_restart(self.config, &reloaded.config);
        let mut new = destination(&reloaded.config, self.stem);
        new.directory.clone_from(&self.config.record.directory);
        self.recorder.redirect(new);
        let mut text = "configuration read again: limits of recordings taken over".to_owned();
        if !restart.is_empty() {
            text.push_str(&format!("; changed, but needs a restart: {}", restart.join(", ")));
        }
        self.say(EventLevel::Info, "reload", text);
        // The socket's thread knows whether the rig is controlled; without one nobody takes it.
        let _ = self.reloads.send(reloaded);
    }

    /// Tells, past the recorder, that the recorder's disk does not answer.
    fn disk(&mut self) {
        let stalled = self.recorder.health().stalled();
        if let (Some(time), false) = (stalled, self.stalled) {
            notice(format_args!(
                "the disk for recordings has not answered for {:.1} s; the rig is controlled on, nothing new is armed",
                time.as_secs_f64()
            ));
        }
        if let (None, true) = (stalled, self.stalled) {
            self.say(EventLevel::Warning, "recorder", "the disk answers again".to_owned());
        }
        self.stalled = stalled.is_some();
    }
}

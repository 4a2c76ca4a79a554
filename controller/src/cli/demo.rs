//! `controller demo`: everything on one machine, over a real socket.
//!
//! An emulated cRIO with the rig `bench` behind it listens on loopback; the daemon, whose model is
//! `dual_pressure`, connects, arms itself and follows the paper's reference; at the end there is a table, a
//! recording and a report.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use clap::Args;
use controller::config::{Config, FALLBACK, Pacing};
use controller::daemon::{self, Options, PROGRAM};
use controller::machine::realtime::with_priority;
use controller::machine::signals::Signals;
use controller::operator::console::progress;
use controller::operator::notice::fault_name;
use controller::replay::run_file::attached;
use controller::session::run_length::{Begins, RunClock, RunEnd, RunLength};
use controller::session::session_recorder::attachment;
use controller::state::State;
use controller::yardstick::{self, Trial};
use flight::{
    CodeNames, Counterpart, FlightInfo, FlightStatistics, FlightSummary, Recorded, RunYardstick, StatisticsOptions,
    Verdict, flight_report,
};
use model::rig::Rig;
use proto::emulator::{Emulator, EmulatorConfig, EmulatorHandle, FaultScript, Pace, load_for_loop, rig_and_crio};
use proto::output::check_folder;
use proto::recording::{Attachment, read_mcap};

use super::Failure;
use super::console::say;

/// SCHED_FIFO priority of a demo's tick: above every ordinary program, and below the 80 that a daemon's tick has by default.
const TICK_PRIORITY: u8 = 20;
/// That of the emulated cRIO, above the tick: hardware is never late.
const CRIO_PRIORITY: u8 = 25;
/// Ticks between two live lines: one second.
const LIVE_TICKS: u64 = 50;

/// Room that a minute's recording and its report need at least (bytes).
const ROOM_BYTES: u64 = 4 << 20;
const STOPPED: &str = "stopped before the run began; nothing was written, and older results are as they were";

/// Flags of the demo.
#[derive(Debug, Args)]
pub(crate) struct Demo {
    /// Length of the run, whatever happens in it.
    #[arg(long, default_value_t = 60.0, value_name = "S")]
    seconds: f64,
    /// In lockstep, as fast as it goes, instead of in real time.
    #[arg(long)]
    fast: bool,
    /// Folder for recording and report.
    #[arg(long, default_value = "out/demo", value_name = "DIR")]
    out: PathBuf,
    /// The rig behind the emulated cRIO: a built-in name (bench, dual_pressure) or a file.
    #[arg(long, default_value = "bench", value_name = "FILE")]
    rig: String,
    /// The model behind MPObs and feed-forward.
    #[arg(long, default_value = "dual_pressure", value_name = "FILE")]
    model: String,
    /// Policy that controls: an ONNX file, or `fallback` for the feed-forward PI; by default the shipped policy.
    #[arg(long, value_name = "FILE|fallback")]
    policy: Option<PathBuf>,
    /// Reference to follow: CSV time_s,ref_pos_kpa,ref_neg_kpa; by default the paper's.
    #[arg(long, value_name = "FILE")]
    reference: Option<PathBuf>,
    /// Script of faults on the wire and at the sensors.
    #[arg(long, value_name = "FILE")]
    faults: Option<PathBuf>,
    /// Seed of the sensors' noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print one JSON object with the figures, and nothing else on standard output.
    #[arg(long)]
    json: bool,
}

impl Demo {
    pub(super) fn run(self) -> Result<(), Failure> {
        if !(self.seconds.is_finite() && self.seconds > 0.0 && self.seconds <= 86_400.0) {
            return Err(Failure::input(format!("--seconds {:?}: give a time above 0, a day at most", self.seconds)));
        }
        check_folder(&self.out, ROOM_BYTES).map_err(Failure::input)?;
        // From here on a signal ends the demo in order, whatever it is at.
        let stop = Arc::new(AtomicBool::new(false));
        let _signals = Signals::install(&stop).map_err(Failure::work)?;
        let emulator = self.emulator()?;
        let mut config = Config::for_address(&emulator.local_addr().to_string());
        config.link.pacing = if self.fast { Pacing::Lockstep } else { Pacing::Realtime };
        config.rig.file.clone_from(&self.model);
        config.control.auto_arm = true;
        config.realtime.enforce = false;
        config.realtime.priority = TICK_PRIORITY;
        config.policy.active = FALLBACK.to_owned();
        config.reference.file.clone_from(&self.reference);
        let mut loaded = daemon::load(&config)?;
        loaded.remarks.clear();
        let chosen = match &self.policy {
            None => Some(daemon::shipped_policy()?),
            Some(name) if name.as_os_str() == FALLBACK => None,
            Some(file) => Some(daemon::policy_file(file).map_err(Failure::input)?),
        };
        (loaded.policy, loaded.policy_bytes) =
            chosen.map_or((None, None), |(policy, bytes)| (Some(policy), Some(bytes)));
        let statistics = StatisticsOptions {
            pacing: self.pacing(),
            counterpart: Counterpart::SameComputer,
            ..StatisticsOptions::default()
        };
        let figures = Arc::new(Mutex::new(FlightStatistics::new(statistics)));
        self.announce(&loaded);
        let yardstick = self.yardstick(&loaded)?;
        if stop.load(Ordering::Relaxed) {
            return Err(Failure::work(STOPPED));
        }
        let recording = self.emptied_folder()?;
        let options = Options {
            recording: Some(recording),
            length: RunLength::seconds(self.seconds, Begins::WhenArmedOrSoon, self.clock()),
            socket: false,
            extra: vec![
                ("rig".to_owned(), format!("{} (emulated)", self.rig)),
                ("command".to_owned(), self.command()),
                ("seed".to_owned(), self.seed.to_string()),
            ],
            config_text: String::new(),
            attachments: vec![self.plant_attachment()?],
            config_file: None,
            observer: watcher(Arc::clone(&figures), self.json),
            stop,
        };
        let flown = daemon::run(&config, loaded, options)?;
        emulator.stop();
        emulator.join().map_err(Failure::work)?;
        let statistics = StatisticsOptions { yardstick, ..statistics };
        let report = self.report(&flown.recording.path, statistics)?;
        let mut figures = figures.lock().unwrap_or_else(PoisonError::into_inner);
        figures.judge_by(yardstick);
        let summary = figures.summary();
        self.say_results(&summary, &flown.recording.path, &report)?;
        match (flown.end, summary.verdict, summary.findings.first()) {
            (RunEnd::Before, ..) => Err(Failure::stopped_run(self.seconds)),
            (RunEnd::Whole, Verdict::Bad, Some(worst)) => {
                Err(Failure::not_good(format!("the run was not good: {worst}")))
            }
            (RunEnd::Whole, ..) => Ok(()),
        }
    }

    /// Makes the folder, takes an older recording out of it, and says where the new one goes.
    fn emptied_folder(&self) -> Result<PathBuf, Failure> {
        std::fs::create_dir_all(&self.out)
            .map_err(|e| Failure::work(format!("{}: cannot be made: {e}; choose another --out", self.out.display())))?;
        let recording = self.out.join("flight.mcap");
        for stale in [recording.clone(), proto::recording::unfinished_path(&recording)] {
            let _ = std::fs::remove_file(stale);
        }
        Ok(recording)
    }

    /// Errors of the feed-forward PI on the same rig and reference.
    fn yardstick(&self, loaded: &daemon::Loaded) -> Result<Option<RunYardstick>, Failure> {
        let rig = self.plant()?;
        let trial = Trial {
            rig: Some(&rig),
            model: &loaded.rig,
            reference: loaded.reference.clone(),
            seconds: self.seconds,
            seed: self.seed,
        };
        yardstick::yardstick(trial).map(Some).map_err(|e| Failure::input(format!("model {}: {e}", self.model)))
    }

    fn pacing(&self) -> flight::Pacing {
        if self.fast { flight::Pacing::Lockstep } else { flight::Pacing::Realtime }
    }

    /// The rig behind the emulated cRIO.
    fn plant(&self) -> Result<Rig, Failure> {
        load_for_loop(&self.rig, Some("--rig")).map_err(Failure::input)
    }

    /// The rig behind the emulated cRIO, as a file inside the recording.
    fn plant_attachment(&self) -> Result<Attachment, Failure> {
        let rig = self.plant()?;
        let text = rig.to_toml().map_err(|e| Failure::input(format!("rig {}: {e}", self.rig)))?;
        Ok(attachment(attached::PLANT, "application/toml", text))
    }

    fn clock(&self) -> RunClock {
        if self.fast { RunClock::Lockstep } else { RunClock::Realtime }
    }

    fn emulator(&self) -> Result<EmulatorHandle, Failure> {
        let rig = self.plant()?;
        let (behind, crio) = rig_and_crio(&rig).map_err(Failure::input)?;
        let faults = match &self.faults {
            Some(file) => FaultScript::read(file).map_err(Failure::input)?,
            None => FaultScript::none(),
        };
        let pace = if self.fast { Pace::LOCKSTEP } else { Pace::RealTime };
        let config = EmulatorConfig { crio, pace, seed: self.seed, faults, ..EmulatorConfig::default() };
        let start = move || Emulator::bind("127.0.0.1:0", config, Box::new(behind)).and_then(Emulator::start);
        // In lockstep nothing is late.
        let started = if self.fast { Ok(start()) } else { with_priority(CRIO_PRIORITY, start) };
        match started {
            Ok(started) => started.map_err(Failure::work),
            Err(_) => Err(Failure::work("the emulated cRIO could not be started")),
        }
    }

    fn announce(&self, loaded: &daemon::Loaded) {
        if self.json {
            return;
        }
        say(format_args!(
            "{PROGRAM}: {} s of {}{}\nrig `{}` behind the emulated cRIO, model `{}`, in control: {}; pressures in kPa gauge",
            self.seconds,
            self.reference.as_ref().map_or("the paper's reference".to_owned(), |file| file.display().to_string()),
            if self.fast { ", in lockstep" } else { "" },
            self.rig,
            loaded.rig.name,
            loaded.policy.as_ref().map_or("the feed-forward PI", |p| p.name()),
        ));
        say(format_args!("{}", FlightStatistics::live_header()));
    }

    fn command(&self) -> String {
        let mut command = format!(
            "controller demo --seconds {} --rig {} --model {} --seed {}",
            self.seconds, self.rig, self.model, self.seed
        );
        for (flag, file) in [("--policy", &self.policy), ("--reference", &self.reference), ("--faults", &self.faults)] {
            if let Some(file) = file {
                command.push_str(&format!(" {flag} {}", file.display()));
            }
        }
        command + if self.fast { " --fast" } else { "" }
    }

    fn report(&self, recording: &Path, options: StatisticsOptions) -> Result<PathBuf, Failure> {
        let content = read_mcap(recording).map_err(Failure::work)?;
        let codes = CodeNames { state: State::name, fault: fault_name };
        let title = format!("Demo: {} s on the emulated rig {}", self.seconds, self.rig);
        let info = FlightInfo::from_recording(&title, &content, codes, options);
        let path = self.out.join("report.html");
        proto::atomic_file::write(&path, flight_report(&content.ticks, &info).as_bytes()).map_err(Failure::work)?;
        Ok(path)
    }

    fn say_results(&self, summary: &FlightSummary, recording: &Path, report: &Path) -> Result<(), Failure> {
        if self.json {
            let mut object = serde_json::to_value(summary).map_err(Failure::work)?;
            object["recording"] = recording.to_string_lossy().into();
            object["report"] = report.to_string_lossy().into();
            say(format_args!("{object}"));
        } else {
            say(format_args!("\n{}", summary.table()));
            say(format_args!("recording  {}\nreport     {}", recording.display(), report.display()));
        }
        Ok(())
    }
}

/// Sees every tick in the recorder's thread: figures, a live line a second, and what happens.
fn watcher(figures: Arc<Mutex<FlightStatistics>>, quiet: bool) -> Box<dyn FnMut(Recorded<'_>) + Send> {
    let mut steered = 0;
    let mut say_events = super::run::say_events();
    Box::new(move |recorded| match recorded {
        Recorded::Tick(tick) => {
            let mut figures = figures.lock().unwrap_or_else(PoisonError::into_inner);
            figures.push(tick);
            steered += u64::from(tick.state == State::Run.code());
            if !quiet && steered > 0 && steered % LIVE_TICKS == 0 && tick.state == State::Run.code() {
                progress(format_args!("{}", figures.live_line("")));
            }
        }
        Recorded::Event { .. } => say_events(recorded),
    })
}

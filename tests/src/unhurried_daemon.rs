//! A daemon in lockstep on a rig that it does not know, at a pace that leaves processors to what computes beside it.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use proto::emulator::{EmulatedPlant, Emulator, EmulatorConfig, EmulatorHandle, Pace};
use serde_json::Value;

use crate::unknown_rig::UnknownRig;

/// Time in which the daemon must control.
const READY: Duration = Duration::from_secs(60);
/// Time in which it must end.
const ENDS: Duration = Duration::from_secs(10);

/// A plant whose ticks take a least time.
struct Unhurried {
    plant: Box<dyn EmulatedPlant>,
    least_tick: Duration,
    last: Instant,
}

impl EmulatedPlant for Unhurried {
    fn tick(&mut self, duty: [f64; 2], pump_on: bool) {
        self.plant.tick(duty, pump_on);
        std::thread::sleep(self.least_tick.saturating_sub(self.last.elapsed()));
        self.last = Instant::now();
    }

    fn pressures_gauge_kpa(&self) -> [f64; 2] {
        self.plant.pressures_gauge_kpa()
    }
}

/// The daemon, the rig behind the emulated cRIO, and the folder that both work in.
pub struct UnhurriedDaemon {
    daemon: Child,
    emulator: Option<EmulatorHandle>,
    programs: PathBuf,
    folder: PathBuf,
}

impl UnhurriedDaemon {
    /// Starts both in a folder, the rig with its sensors' noise of a seed, and waits until the daemon controls.
    ///
    /// # Panics
    /// If one of them does not start, or the daemon does not control in a minute.
    pub fn start(rig: &UnknownRig, seed: u64, least_tick: Duration, folder: &Path, programs: &Path) -> Self {
        Self::try_start(rig, seed, least_tick, folder, programs, "").unwrap_or_else(|refusal| panic!("{refusal}"))
    }

    /// As [`Self::start`], with further lines of the configuration (`table.key = value`), where the daemon may refuse what it is given.
    ///
    /// # Errors
    /// The daemon ended before it controlled: its last line.
    ///
    /// # Panics
    /// If one of them does not start, or the daemon neither ends nor controls in a minute.
    pub fn try_start(
        rig: &UnknownRig,
        seed: u64,
        least_tick: Duration,
        folder: &Path,
        programs: &Path,
        lines: &str,
    ) -> Result<Self, String> {
        let config = EmulatorConfig { crio: rig.crio(), pace: Pace::LOCKSTEP, seed, ..EmulatorConfig::default() };
        let plant = Unhurried { plant: rig.plant(), least_tick, last: Instant::now() };
        let emulator = Emulator::bind("127.0.0.1:0", config, Box::new(plant)).expect("an address of this machine");
        let text = format!(
            "link.address = \"{}\"\nlink.pacing = \"lockstep\"\nrecord.directory = \"recordings\"\nrecord.min_free_mib = 16\n\
             control.socket = \"s\"\ncontrol.auto_arm = true\nrealtime.enforce = false\n{lines}\n",
            emulator.local_addr()
        );
        let emulator = Some(emulator.start().expect("a thread for the emulator"));
        std::fs::write(folder.join("controller.toml"), text).expect("a configuration");
        let log = std::fs::File::create(folder.join("daemon.log")).expect("a log");
        let daemon = command(programs, folder, "controller", &["run", "--config", "controller.toml"])
            .stdout(Stdio::null())
            .stderr(log)
            .spawn()
            .expect("the daemon's program");
        let mut daemon = UnhurriedDaemon { daemon, emulator, programs: programs.to_owned(), folder: folder.to_owned() };
        let until = Instant::now() + READY;
        while daemon.status()["state"] != "run" {
            if let Ok(Some(_)) = daemon.daemon.try_wait() {
                let log = std::fs::read_to_string(folder.join("daemon.log")).unwrap_or_default();
                return Err(log.lines().last().unwrap_or("the daemon ended without a word").to_owned());
            }
            assert!(Instant::now() < until, "the daemon does not control: {}", folder.join("daemon.log").display());
            std::thread::sleep(Duration::from_millis(200));
        }
        Ok(daemon)
    }

    /// A program of the two, to be run where the daemon runs.
    pub fn command(&self, program: &str, arguments: &[&str]) -> Command {
        command(&self.programs, &self.folder, program, arguments)
    }

    /// `controller status`, or nothing where it does not answer.
    ///
    /// # Panics
    /// If the program cannot be started.
    pub fn status(&self) -> Value {
        let arguments = ["status", "--json", "--config", "controller.toml"];
        let said = self.command("controller", &arguments).output().expect("the program");
        serde_json::from_slice(&said.stdout).unwrap_or_default()
    }
}

impl Drop for UnhurriedDaemon {
    fn drop(&mut self) {
        if let Some(pid) = rustix::process::Pid::from_raw(self.daemon.id().cast_signed()) {
            let _ = rustix::process::kill_process(pid, rustix::process::Signal::TERM);
        }
        let until = Instant::now() + ENDS;
        while Instant::now() < until && matches!(self.daemon.try_wait(), Ok(None)) {
            std::thread::sleep(Duration::from_millis(50));
        }
        let _ = self.daemon.kill();
        let _ = self.daemon.wait();
        if let Some(emulator) = self.emulator.take() {
            emulator.stop();
            let _ = emulator.join();
        }
    }
}

fn command(programs: &Path, folder: &Path, program: &str, arguments: &[&str]) -> Command {
    let mut command = Command::new(programs.join(program));
    command.args(arguments).current_dir(folder).stdin(Stdio::null());
    command
}

//! An emulated cRIO within the test, and a configuration of the daemon for it: what a `controller experiment` is played on.

use std::path::PathBuf;
use std::process::Command;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use model::predict::DualPressureRig;
use model::rig::Rig;
use proto::emulator::{
    CrioConfig, EmulatedPlant, Emulator, EmulatorConfig, EmulatorHandle, Event, FaultScript, GroundTruth, Pace,
    TruthObserver, rig_and_crio,
};
use tests::{Folder, program};

/// Everything that the emulator saw.
#[derive(Default)]
pub(crate) struct Seen {
    pub(crate) ticks: Vec<GroundTruth>,
    pub(crate) sessions: u32,
    pub(crate) said_bye: bool,
}

#[derive(Clone, Default)]
pub(crate) struct PlaybackReport(Arc<Mutex<Seen>>);

impl TruthObserver for PlaybackReport {
    fn tick(&mut self, truth: &GroundTruth) {
        self.0.lock().unwrap().ticks.push(*truth);
    }

    fn event(&mut self, event: &Event) {
        let mut seen = self.0.lock().unwrap();
        seen.sessions += u32::from(matches!(event, Event::SessionOpened { .. }));
        seen.said_bye |= matches!(event, Event::Bye(_));
    }
}

/// An emulated cRIO with a rig, and a folder with a configuration for it.
pub(crate) struct Bench {
    pub(crate) folder: Folder,
    pub(crate) config: PathBuf,
    pub(crate) emulator: EmulatorHandle,
    pub(crate) seen: PlaybackReport,
}

/// A rig that takes its time: in lockstep a tick of it lasts a millisecond at least.
pub(crate) struct Unhurried(DualPressureRig);

impl EmulatedPlant for Unhurried {
    fn tick(&mut self, duty: [f64; 2], pump_on: bool) {
        std::thread::sleep(Duration::from_millis(1));
        self.0.tick(duty, pump_on);
    }

    fn pressures_gauge_kpa(&self) -> [f64; 2] {
        self.0.readings_kpa()
    }
}

pub(crate) struct Set {
    pub(crate) rig: Rig,
    pub(crate) unhurried: bool,
    pub(crate) pace: Pace,
    pub(crate) faults: &'static str,
    pub(crate) relay: bool,
}

impl Default for Set {
    fn default() -> Self {
        Set { rig: paper(""), unhurried: false, pace: Pace::LOCKSTEP, faults: "", relay: true }
    }
}

/// The paper's rig, with a mechanism or other lines at the end.
pub(crate) fn paper(more: &str) -> Rig {
    Rig::from_toml(&format!("{}\n{more}", model::rig::DUAL_PRESSURE)).unwrap()
}

impl Bench {
    pub(crate) fn new(set: Set) -> Self {
        let (behind, crio) = rig_and_crio(&set.rig).unwrap();
        let config = EmulatorConfig {
            crio: CrioConfig { pump_relay: set.relay, ..crio },
            pace: set.pace,
            faults: FaultScript::from_toml(set.faults, "faults.toml").unwrap(),
            ..EmulatorConfig::default()
        };
        let seen = PlaybackReport::default();
        let behind: Box<dyn EmulatedPlant> = if set.unhurried { Box::new(Unhurried(behind)) } else { Box::new(behind) };
        let emulator = Emulator::bind("127.0.0.1:0", config, behind).unwrap();
        let emulator = emulator.watched_by(Box::new(seen.clone())).start().unwrap();
        let pacing = if set.pace == Pace::RealTime { "realtime" } else { "lockstep" };
        let folder = Folder::new();
        let config = folder.write(
            "c.toml",
            format!(
                "[link]\naddress = \"{}\"\npacing = \"{pacing}\"\n[record]\ndirectory = \"kept\"\n[control]\nsocket = \"s\"\n",
                emulator.local_addr()
            ),
        );
        Bench { folder, config, emulator, seen }
    }

    pub(crate) fn command(&self, csv: &str) -> Command {
        let csv = self.folder.write("e.csv", csv);
        let mut command = Command::new(program("controller"));
        command.arg("experiment").arg(csv).arg("--config").arg(&self.config);
        command
    }

    /// The one recording.
    pub(crate) fn recording(&self) -> PathBuf {
        let names = self.folder.names("kept");
        assert!(names.len() == 1 && names[0].starts_with("experiment-") && names[0].ends_with(".mcap"), "{names:?}");
        self.folder.join("kept").join(&names[0])
    }

    /// Ends the emulator; what it saw.
    pub(crate) fn close(self) -> Seen {
        self.emulator.stop();
        self.emulator.join().unwrap();
        std::mem::take(&mut *self.seen.0.lock().unwrap())
    }
}

//! A concealed rig and a daemon on this machine: all of it before a real rig is touched.
//!
//! The rig is drawn by a seed around the paper's: volumes, valves and check valves off by some percent, and two to four
//! mechanisms that the daemon's model does not have. It stands behind `trainer rig` in lockstep, as fast as this machine
//! goes, with `controller run` beside it, both in a folder of their own. While this machine computes, both stand still: a real
//! rig goes on meanwhile.

use std::io::{BufRead, BufReader};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use environment::draws::{Purpose, stream};
use environment::{DomainRandomization, EnvironmentSettings, MechanismDraw, RigDraw};
use fit::wording::three_digits;
use model::rig::Rig;
use proto::parent_process::ends_with_this;
use proto::{atomic_file, rig_file};
use rustix::process::Signal;

use crate::daemon::Daemon;
use crate::programs::{Console, Programs, signal};
use crate::run::Pausable;
use crate::{AdaptError, make_folder};

/// Spread of parameters, in percent.
const PARAMETERS_PERCENT: f64 = 3.0;
/// Mechanisms that a concealed rig has at least and at most.
const MECHANISMS: std::ops::RangeInclusive<usize> = 2..=4;
/// Share of rigs that lack each of those below.
const ABSENT: f64 = 0.5;
/// Id, component, parameter and its range: what rigs on a bench have (docs/rig-files.md).
const CONCEALED: [(&str, &str, &str, [f64; 2]); 8] = [
    ("valve_hysteresis", "valve_pos", "half_width_duty", [0.0, 0.04]),
    ("valve_hysteresis", "valve_neg", "half_width_duty", [0.0, 0.04]),
    ("valve_lag", "valve_pos", "time_constant_ms", [0.01, 90.0]),
    ("valve_lag", "valve_neg", "time_constant_ms", [0.01, 90.0]),
    ("command_delay", "valve_pos", "delay_ms", [0.0, 60.0]),
    ("command_delay", "valve_neg", "delay_ms", [0.0, 60.0]),
    ("chamber_leak", "positive", "conductance_kg_per_s_pa2", [0.0, 2e-15]),
    ("chamber_thermal", "positive", "wall_conductance_w_per_k", [0.5, 1000.0]),
];
/// Time in which both programs must be there.
const READY: Duration = Duration::from_secs(30);
/// Time in which they must have ended.
const ENDED: Duration = Duration::from_secs(10);

/// Draws a concealed rig.
///
/// # Errors
/// A rig that does not compile, which none of these ranges gives.
pub fn draw_rig(seed: u64) -> Result<Rig, AdaptError> {
    let told = |error: &dyn std::fmt::Display| AdaptError::file(Path::new("the concealed rig"), error);
    let nominal = Rig::builtin("dual_pressure").map_err(|error| told(&error))?;
    let mechanism = |(id, component, parameter, range): (&str, &str, &str, [f64; 2])| MechanismDraw {
        id: id.to_owned(),
        component: component.to_owned(),
        none: ABSENT,
        ranges: [(parameter.to_owned(), range)].into(),
    };
    let settings = EnvironmentSettings {
        spread: DomainRandomization {
            volumes_percent: PARAMETERS_PERCENT,
            valves_percent: PARAMETERS_PERCENT,
            check_valves_percent: PARAMETERS_PERCENT,
            ..DomainRandomization::default()
        },
        mechanisms: CONCEALED.map(mechanism).into(),
        ..EnvironmentSettings::default()
    };
    let draw = RigDraw::new(&nominal, &settings).map_err(|error| told(&error))?;
    for number in 0.. {
        let mut rig = draw.draw(&mut stream(seed, Purpose::Rig, number, 0)).map_err(|error| told(&error))?;
        let drawn = rig.mechanisms.split_off(nominal.mechanisms.len());
        // One that stands at its lowest does nothing, or as good as nothing.
        let acts = drawn.into_iter().zip(CONCEALED).filter(|(drawn, (_, _, _, [low, high]))| {
            use model::rig::Numbers as _;
            drawn.mechanism.number(0) > low + 0.1 * (high - low)
        });
        rig.mechanisms.extend(acts.map(|(drawn, _)| drawn));
        if MECHANISMS.contains(&(rig.mechanisms.len() - nominal.mechanisms.len())) {
            "concealed".clone_into(&mut rig.name);
            return Ok(rig);
        }
    }
    Err(told(&"no draw has two to four mechanisms"))
}

/// Lines on what a rig conceals, one a mechanism.
pub fn concealed(rig: &Rig) -> Vec<String> {
    use model::rig::Numbers as _;
    let line = |m: &model::rig::MechanismInstance| {
        let numbers = m.mechanism.numbers();
        let numbers: Vec<String> = numbers
            .iter()
            .enumerate()
            .map(|(n, number)| format!("{} {}", three_digits(m.mechanism.number(n)), number.unit).trim_end().to_owned())
            .collect();
        format!("{} at {}: {}", m.mechanism.id(), m.component, numbers.join(", "))
    };
    rig.mechanisms.iter().filter(|m| m.enabled).map(line).collect()
}

/// Has a command end with this program, and not before it: a Ctrl-C on the terminal goes to a whole process group, and
/// what the rehearsal changed in the daemon is put back after it.
fn apart(command: &mut Command) -> &mut Command {
    ends_with_this(command).process_group(0)
}

/// A rehearsal that runs.
pub struct Rehearsal {
    config: PathBuf,
    rig: Option<Child>,
    daemon: Option<Child>,
}

impl Rehearsal {
    /// Starts a concealed rig and a daemon in `folder`, and waits until the rig is controlled.
    ///
    /// # Errors
    /// A program that cannot be started, or does not come up.
    pub fn start(
        rig: &Rig,
        seed: u64,
        folder: &Path,
        programs: &Programs,
        console: &mut dyn Console,
    ) -> Result<Self, AdaptError> {
        make_folder(folder.join("policies"))?;
        let rig_path = folder.join("concealed_rig.toml");
        rig_file::save(&rig_path, rig)?;
        let config = folder.join("controller.toml");
        let mut rehearsal = Rehearsal { config, rig: None, daemon: None };
        let arguments = ["rig", "--listen", "127.0.0.1:0", "--pace", "lockstep", "--seed", &seed.to_string(), "--rig"];
        console.command(&format!("trainer {} {}", arguments.join(" "), rig_path.display()));
        let mut command = Command::new(&programs.trainer);
        let log = folder.join("rig.log");
        let errors = std::fs::File::create(&log).map_err(|error| AdaptError::file(&log, error))?;
        command.args(arguments).arg(&rig_path).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(errors);
        let child = apart(&mut command)
            .spawn()
            .map_err(|source| AdaptError::Start { command: "trainer rig".into(), source })?;
        let out = rehearsal.rig.insert(child).stdout.take();
        let address = listening(out).ok_or_else(|| AdaptError::Failed {
            command: "trainer rig".into(),
            said: last_line(&log).unwrap_or_else(|| "it does not say where it listens".into()),
        })?;
        let text = format!(
            "[link]\naddress = \"{address}\"\npacing = \"lockstep\"\n[record]\ndirectory = \"recordings\"\nmin_free_mib = 64\n\
             [control]\nsocket = \"s\"\nauto_arm = true\n[realtime]\nenforce = false\n"
        );
        atomic_file::write(&rehearsal.config, text.as_bytes())?;
        console.command(&format!("controller run --config {}", rehearsal.config.display()));
        let log = folder.join("controller.log");
        let log = std::fs::File::create(&log).map_err(|error| AdaptError::file(&log, error))?;
        let mut command = Command::new(&programs.controller);
        command.args(["run", "--config"]).arg(&rehearsal.config);
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(log);
        let child = apart(&mut command)
            .spawn()
            .map_err(|source| AdaptError::Start { command: "controller run".into(), source })?;
        rehearsal.daemon = Some(child);
        rehearsal.wait_until_controlled(programs, console)?;
        Ok(rehearsal)
    }

    /// The daemon's configuration.
    pub fn config(&self) -> &Path {
        &self.config
    }

    fn wait_until_controlled(&self, programs: &Programs, console: &mut dyn Console) -> Result<(), AdaptError> {
        let daemon = Daemon { programs: programs.clone(), config: self.config.clone() };
        let began = Instant::now();
        loop {
            if daemon.status(console).is_ok_and(|status| status.is_running()) {
                return Ok(());
            }
            if console.stop() {
                return Err(AdaptError::Stopped);
            }
            if began.elapsed() > READY {
                let what = "the daemon does not control the concealed rig".to_owned();
                return Err(AdaptError::TooLong { what, seconds: READY.as_secs() });
            }
            std::thread::sleep(Duration::from_millis(100));
        }
    }

    /// Handle that lets both stand still and go on.
    pub fn pausable(&self) -> Box<dyn Pausable> {
        let id = |child: &Option<Child>| child.as_ref().map(Child::id);
        Box::new(Paused { ids: [id(&self.daemon), id(&self.rig)] })
    }
}

impl Drop for Rehearsal {
    fn drop(&mut self) {
        for child in [&mut self.daemon, &mut self.rig].into_iter().flatten() {
            signal(child, Signal::CONT);
            signal(child, Signal::TERM);
            let began = Instant::now();
            while matches!(child.try_wait(), Ok(None)) {
                if began.elapsed() > ENDED {
                    // It had its time; the folder is a scratch folder.
                    let _ = child.kill();
                    let _ = child.wait();
                    break;
                }
                std::thread::sleep(Duration::from_millis(20));
            }
        }
    }
}

/// Programs that stand still while others compute.
struct Paused {
    ids: [Option<u32>; 2],
}

impl Paused {
    fn send(&self, signal: Signal) {
        for id in self.ids.iter().flatten() {
            if let Some(pid) = rustix::process::Pid::from_raw(id.cast_signed()) {
                // One that has ended needs no signal.
                let _ = rustix::process::kill_process(pid, signal);
            }
        }
    }
}

impl Pausable for Paused {
    fn pause(&mut self) {
        self.send(Signal::STOP);
    }

    fn go_on(&mut self) {
        self.send(Signal::CONT);
    }
}

/// The address in the emulator's first line; what it says after that is read and thrown away.
fn listening(out: Option<impl std::io::Read + Send + 'static>) -> Option<String> {
    let mut out = BufReader::new(out?);
    let mut line = String::new();
    out.read_line(&mut line).ok()?;
    std::thread::spawn(move || {
        let mut nothing = std::io::sink();
        // The pipe ends with the emulator.
        let _ = std::io::copy(&mut out, &mut nothing);
    });
    line.trim().strip_prefix("listening on ").map(str::to_owned)
}

/// The last line of a program's log, without the program's name: why it ended.
fn last_line(log: &Path) -> Option<String> {
    let text = std::fs::read_to_string(log).ok()?;
    let line = text.lines().rfind(|line| !line.trim().is_empty())?;
    Some(line.trim().trim_start_matches("trainer: ").to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn concealed_rigs_differ_by_seed_and_have_what_the_model_lacks() {
        let nominal = Rig::builtin("dual_pressure").unwrap();
        let rigs: Vec<Rig> = (1..=6).map(|seed| draw_rig(seed).unwrap()).collect();
        for (n, rig) in rigs.iter().enumerate() {
            assert!(MECHANISMS.contains(&(rig.mechanisms.len() - nominal.mechanisms.len())), "{:?}", rig.mechanisms);
            assert!(rigs[..n].iter().all(|other| other != rig));
            model::predict::DualPressureRig::new(rig).unwrap();
            let told = concealed(rig);
            assert_eq!(told.len(), rig.mechanisms.iter().filter(|m| m.enabled).count());
            assert!(!told.concat().contains("e0") && !told.concat().contains("e-"), "no computer's numbers: {told:?}");
        }
        assert_eq!(rigs[0], draw_rig(1).unwrap());
    }

    #[test]
    fn a_log_says_why_its_program_ended() {
        let log = std::env::temp_dir().join(format!("rehearsal-log-{}", std::process::id()));
        std::fs::write(&log, "trainer: begins\ntrainer: rig.toml: valves: none\n\n").unwrap();
        assert_eq!(last_line(&log).as_deref(), Some("rig.toml: valves: none"));
        std::fs::write(&log, "").unwrap();
        assert_eq!(last_line(&log), None);
        std::fs::remove_file(log).unwrap();
    }
}

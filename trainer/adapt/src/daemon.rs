//! Questions and orders to the running daemon through `controller`, as its operator would give them.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::AdaptError;
use crate::programs::{Console, Programs, Said, Step};

/// The policy's name where none controls.
pub const FALLBACK: &str = "fallback";

/// Between two questions to the daemon.
pub(crate) const LOOK: Duration = Duration::from_millis(100);
/// Time in which a daemon that may arms itself again behind a session that was lost.
const ARMED_AGAIN: Duration = Duration::from_secs(20);

/// Time in which a person sees to a rig that was vented, and arms it.
const PERSON_ARMS: Duration = Duration::from_secs(600);

/// Words of the daemon where no tick took what it was asked, as on a computer that stalls …
const NO_TICK: &str = "no tick took it";
/// … and how often it is asked again.
const MORE_TRIES: usize = 2;

/// Words of the daemon while it examines what somebody else has given it …
const EXAMINES: [&str; 3] = ["is being loaded or checked", "another model is on its way", "is still being checked"];
/// … and time in which it has done so, on a busy machine as well.
const EXAMINED: Duration = Duration::from_secs(300);
/// Between two questions whether it has.
const EXAMINING: Duration = Duration::from_millis(500);

/// Beginning of the conditions that another model may explain: a reading and the model are apart.
const MODEL: &str = "model";

/// Meaning of a vented rig to a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Vented {
    /// The step cannot be done.
    Fails,
    /// A person is asked to see to it and to arm; the step goes on then.
    WaitsForPerson,
}

/// A running daemon.
#[derive(Debug, Clone)]
pub struct Daemon {
    /// The two programs.
    pub programs: Programs,
    /// The daemon's configuration.
    pub config: PathBuf,
}

/// State of the exploration around a policy's answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Exploration {
    /// Noise is put on the answers.
    On,
    /// The answers are applied as they are.
    Off,
}

impl Exploration {
    /// Word for it, as the daemon's command has it.
    pub fn as_str(self) -> &'static str {
        match self {
            Exploration::On => "on",
            Exploration::Off => "off",
        }
    }
}

/// State of a running daemon, and what it uses.
#[derive(Debug, Clone, PartialEq)]
pub struct DaemonStatus {
    /// The state's name.
    pub state: String,
    /// The condition that keeps it from controlling until a person acknowledges; empty where there is none.
    pub waits_for: String,
    /// Session and tick; 0 without one.
    pub at: (u32, u32),
    /// Name of the policy that controls, or `fallback`.
    pub policy: String,
    /// SHA-256 of the policy's file; empty for the fallback.
    pub policy_sha256: String,
    /// Tells whether the fallback controls in place of a policy that the daemon itself has set aside.
    pub is_set_aside: bool,
    /// Name of the model behind the predictions.
    pub model: String,
    /// SHA-256 of the model, comments left out.
    pub model_sha256: String,
    /// Name of the reference that is followed: its file's path, where it has one.
    pub reference: String,
    /// Exploration around the policy.
    pub exploration: Exploration,
    /// Commands that the safety filter has changed.
    pub interventions: u64,
}

impl DaemonStatus {
    /// Reads the answer of `controller status --json`; what is not there counts as nothing.
    fn of(reply: &Value) -> Self {
        let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
        let number = |key: &str| reply["status"][key].as_u64().unwrap_or_default();
        let small = |key: &str| u32::try_from(number(key)).unwrap_or_default();
        DaemonStatus {
            state: text(&reply["state"]),
            waits_for: text(&reply["status"]["latched"]).replace('_', " "),
            at: (small("session"), small("tick")),
            policy: text(&reply["running"]["policy"]),
            policy_sha256: text(&reply["running"]["policy_sha256"]),
            is_set_aside: reply["running"]["why_fallback"].is_string(),
            model: text(&reply["running"]["model"]),
            model_sha256: text(&reply["running"]["model_sha256"]),
            reference: text(&reply["running"]["reference"]),
            exploration: if reply["status"]["exploration"].is_null() { Exploration::Off } else { Exploration::On },
            interventions: number("filter_interventions"),
        }
    }

    /// Tells whether the rig is being controlled.
    pub fn is_running(&self) -> bool {
        ["run", "hold", "revert"].contains(&self.state.as_str())
    }

    /// The error that the rig is not being controlled, with what keeps it from that.
    pub fn not_running(self) -> AdaptError {
        AdaptError::NotRunning { state: self.state, waits_for: self.waits_for }
    }
}

impl Daemon {
    fn command(&self, arguments: &[&str]) -> Step<'_> {
        let config = self.config.to_string_lossy();
        self.programs.controller(arguments.iter().copied().chain(["--config", config.as_ref()]))
    }

    /// A command as a person would type it.
    pub fn text(&self, arguments: &[&str]) -> String {
        self.command(arguments).text()
    }

    /// Asks, as a step that is shown; a refusal is an error.
    ///
    /// # Errors
    /// The daemon's own line.
    pub fn tell(&self, arguments: &[&str], console: &mut dyn Console) -> Result<Said, AdaptError> {
        let step = self.command(arguments);
        step.require_success(once_free(&step, console)?)
    }

    /// Asks as a step, whatever the answer.
    ///
    /// # Errors
    /// The command cannot be started, or everything is stopped.
    pub fn try_to(&self, arguments: &[&str], console: &mut dyn Console) -> Result<Said, AdaptError> {
        once_free(&self.command(arguments), console)
    }

    /// Asks for JSON.
    fn ask(&self, question: &str, console: &mut dyn Console) -> Result<Value, AdaptError> {
        let step = self.command(&[question, "--json"]);
        let said = step.run_silently(console)?;
        let failed = |said: String| AdaptError::Failed { command: step.text(), said };
        match (said.status, serde_json::from_str(&said.out)) {
            (Some(0), Ok(reply)) => Ok(reply),
            (Some(0), Err(error)) => Err(failed(error.to_string())),
            _ => Err(failed(said.last_line())),
        }
    }

    /// State now.
    ///
    /// # Errors
    /// Nobody answers.
    pub fn status(&self, console: &mut dyn Console) -> Result<DaemonStatus, AdaptError> {
        Ok(DaemonStatus::of(&self.ask("status", console)?))
    }

    /// State of a daemon that controls. A session that was lost may be opened and armed anew by the daemon itself. A condition
    /// that waits for a person ends the wait at once, or is told and waited for where a model may explain it, as `vented` has it.
    ///
    /// # Errors
    /// Nobody answers; the rig is not being controlled.
    pub fn in_control(&self, vented: Vented, console: &mut dyn Console) -> Result<DaemonStatus, AdaptError> {
        let (began, mut is_told) = (Instant::now(), false);
        loop {
            let status = self.status(console)?;
            if status.is_running() {
                return Ok(status);
            }
            let most = match (status.waits_for.as_str(), vented) {
                ("", _) if !is_told => ARMED_AGAIN,
                ("", Vented::WaitsForPerson) => PERSON_ARMS,
                (why, Vented::WaitsForPerson) if why.starts_with(MODEL) => PERSON_ARMS,
                _ => Duration::ZERO,
            };
            if began.elapsed() > most {
                return Err(status.not_running());
            }
            if console.stop() {
                return Err(AdaptError::Stopped);
            }
            if most == PERSON_ARMS && !is_told {
                console.say(&format!("{}; this waits for it", status.not_running()));
                is_told = true;
            }
            console.waiting("the daemon does not control", began.elapsed(), Some(most));
            std::thread::sleep(LOOK);
        }
    }

    /// State of a policy and, where it was refused or is not to control, why.
    ///
    /// # Errors
    /// Nobody answers.
    pub fn policy(&self, name: &str, console: &mut dyn Console) -> Result<(String, String), AdaptError> {
        let reply = self.ask("policies", console)?;
        let entry =
            reply["policies"].as_array().and_then(|all| all.iter().find(|entry| entry["name"] == name).cloned());
        let entry = entry.unwrap_or_default();
        let why = match &entry["refusal"] {
            Value::Null => String::new(),
            refusal => format!(
                "{}: {}",
                refusal["stage"].as_str().unwrap_or_default(),
                refusal["reason"].as_str().unwrap_or_default()
            ),
        };
        Ok((entry["state"].as_str().unwrap_or("checking").to_owned(), why))
    }

    /// Plays an experiment; the path of its recording.
    ///
    /// # Errors
    /// The daemon's own line where it was refused or aborted.
    pub fn experiment(&self, csv: &Path, console: &mut dyn Console) -> Result<PathBuf, AdaptError> {
        let csv = csv.to_string_lossy();
        let step = self.command(&["experiment", csv.as_ref(), "--json"]);
        let mut said = once_free(&step, console)?;
        // Nothing is wrong with the experiment then, and a narrower one would fare no better.
        for _ in 0..MORE_TRIES {
            if said.status == Some(0) || !said.last_line().contains(NO_TICK) {
                break;
            }
            std::thread::sleep(LOOK);
            said = once_free(&step, console)?;
        }
        let said = step.require_success(said)?;
        let reply: Value = serde_json::from_str(&said.out).unwrap_or_default();
        match reply["recording"].as_str() {
            Some(path) => Ok(self.config.parent().unwrap_or(Path::new("")).join(path)),
            None => Err(AdaptError::Failed { command: step.text(), said: "it names no recording".to_owned() }),
        }
    }
}

/// Runs a command, again and again while the daemon examines something else: that answer says nothing of what was asked.
fn once_free(step: &Step<'_>, console: &mut dyn Console) -> Result<Said, AdaptError> {
    let began = Instant::now();
    let mut said = step.run(console)?;
    while said.status != Some(0)
        && EXAMINES.iter().any(|words| said.last_line().contains(words))
        && began.elapsed() < EXAMINED
    {
        if console.stop() {
            return Err(AdaptError::Stopped);
        }
        console.waiting("the daemon examines something else first", began.elapsed(), Some(EXAMINED));
        std::thread::sleep(EXAMINING);
        said = step.run_silently(console)?;
    }
    Ok(said)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::judging::tests::Said as Console;

    /// A stand-in for `controller` in a folder of its own: a shell script, with the folder as `$here`.
    pub(crate) fn stand_in(folder: &Path, script: &str) -> Programs {
        std::fs::create_dir_all(folder).unwrap();
        let controller = folder.join("controller");
        let script = format!("#!/bin/sh\nhere={}\n{script}", folder.display());
        // A child of its own writes it: one that another test starts meanwhile would hold it open, and it could not be run.
        let write = ["-c", "printf '%s' \"$1\" > \"$2\" && chmod 755 \"$2\"", "sh", script.as_str()];
        assert!(std::process::Command::new("sh").args(write).arg(&controller).status().unwrap().success());
        Programs { controller, trainer: "trainer".into() }
    }

    /// While it examines a policy that somebody has published it takes neither an experiment nor a model, and has refused neither.
    #[test]
    fn a_daemon_that_examines_something_else_is_asked_again() {
        let folder = std::env::temp_dir().join(format!("adapt-busy-{}", std::process::id()));
        let busy = "echo asked >> $here/asked
                    if [ $(wc -l < $here/asked) -lt 3 ]; then
                        echo 'controller: another policy, model or experiment is being loaded or checked; try again' >&2
                        exit 1
                    fi
                    echo '{\"recording\": \"recordings/experiment.mcap\"}'\n";
        let daemon = Daemon { programs: stand_in(&folder, busy), config: folder.join("c.toml") };
        let asked = || std::fs::read_to_string(folder.join("asked")).unwrap().lines().count();
        let played = daemon.experiment(Path::new("minute.csv"), &mut Console::default()).unwrap();
        assert_eq!((played, asked()), (folder.join("recordings/experiment.mcap"), 3));
        std::fs::remove_file(folder.join("asked")).unwrap();
        daemon.tell(&["model", "rig.toml"], &mut Console::default()).unwrap();
        assert_eq!(asked(), 3);
        // A refusal is one at once.
        let refused = "echo asked >> $here/asked; echo 'rig.toml: it predicts worse' >&2; exit 1\n";
        let daemon = Daemon { programs: stand_in(&folder, refused), ..daemon };
        assert!(daemon.tell(&["model", "rig.toml"], &mut Console::default()).is_err());
        assert_eq!(asked(), 4);
        std::fs::remove_dir_all(folder).unwrap();
    }
}

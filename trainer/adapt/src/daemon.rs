//! What the running daemon is asked, through `controller`: as its operator would.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::AdaptError;
use crate::programs::{Console, Programs, Said, Step};

/// The policy's name where none controls.
pub const FALLBACK: &str = "fallback";

/// A running daemon.
#[derive(Debug, Clone)]
pub struct Daemon {
    /// The two programs.
    pub programs: Programs,
    /// Its configuration.
    pub config: PathBuf,
}

/// What it is doing.
#[derive(Debug, Clone, PartialEq)]
pub struct DaemonStatus {
    /// Its state's name.
    pub state: String,
    /// Session and tick; 0 without one.
    pub at: (u32, u32),
    /// Name of the policy that controls, or `fallback`.
    pub policy: String,
    /// Name of the model behind the predictions.
    pub model: String,
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
            at: (small("session"), small("tick")),
            policy: text(&reply["running"]["policy"]),
            model: text(&reply["running"]["model"]),
            interventions: number("filter_interventions"),
        }
    }

    /// Whether the rig is being controlled.
    pub fn is_running(&self) -> bool {
        ["run", "hold", "revert"].contains(&self.state.as_str())
    }
}

impl Daemon {
    fn command(&self, arguments: &[&str]) -> Step<'_> {
        let config = self.config.to_string_lossy();
        self.programs.controller(arguments.iter().copied().chain(["--config", config.as_ref()]))
    }

    /// Asks, as a step that is shown; a refusal is an error.
    ///
    /// # Errors
    /// The daemon's own line.
    pub fn tell(&self, arguments: &[&str], console: &mut dyn Console) -> Result<Said, AdaptError> {
        self.command(arguments).done(console)
    }

    /// Asks as a step, whatever the answer.
    ///
    /// # Errors
    /// The command cannot be started, or everything is stopped.
    pub fn try_to(&self, arguments: &[&str], console: &mut dyn Console) -> Result<Said, AdaptError> {
        self.command(arguments).run(console)
    }

    /// Asks without showing it; a refusal is an error.
    ///
    /// # Errors
    /// The daemon's own line.
    pub fn try_silently(&self, arguments: &[&str], console: &mut dyn Console) -> Result<Said, AdaptError> {
        let step = self.command(arguments);
        let said = step.run_silently(console)?;
        match said.status {
            Some(0) => Ok(said),
            _ => Err(AdaptError::Failed { command: step.text(), said: said.last_line() }),
        }
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

    /// What it is doing.
    ///
    /// # Errors
    /// Nobody answers.
    pub fn status(&self, console: &mut dyn Console) -> Result<DaemonStatus, AdaptError> {
        Ok(DaemonStatus::of(&self.ask("status", console)?))
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
        let said = step.done(console)?;
        let reply: Value = serde_json::from_str(&said.out).unwrap_or_default();
        match reply["recording"].as_str() {
            Some(path) => Ok(self.config.parent().unwrap_or(Path::new("")).join(path)),
            None => Err(AdaptError::Failed { command: step.text(), said: "it names no recording".to_owned() }),
        }
    }
}

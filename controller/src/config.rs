//! The daemon's configuration file.
//!
//! TOML; every key has a default but `link.address`, an unknown key is an error that names it. Paths are
//! relative to the folder of the configuration file. What values may be stands in `config/checks.rs`.

mod checks;
pub mod sensor_limits;

use std::path::{Path, PathBuf};

use law::{AfterEnd, RepetitionLearning};
use proto::regular_file;
use serde::{Deserialize, Serialize};
use supervisor::Arming;

use checks::{check, check_places, parse_problem};

/// The largest configuration file that is read, in bytes.
const MOST_BYTES: u64 = 1 << 20;

/// The whole configuration.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The link to the cRIO.
    pub link: Link,
    /// The model behind MPObs.
    #[serde(default)]
    pub rig: RigChoice,
    /// Choice of what flies.
    #[serde(default)]
    pub policy: PolicyChoice,
    /// Reference to follow.
    #[serde(default)]
    pub reference: ReferenceChoice,
    /// Recordings.
    #[serde(default)]
    pub record: Record,
    /// Operator access.
    #[serde(default)]
    pub control: Control,
    /// Limits.
    #[serde(default)]
    pub safety: Safety,
    /// Scheduling.
    #[serde(default)]
    pub realtime: Realtime,
}

/// `[link]`
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Link {
    /// Host and port of the cRIO.
    pub address: String,
    /// Pacing: whether deadlines hold.
    #[serde(default)]
    pub pacing: Pacing,
}

/// Passage of time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Pacing {
    /// The cRIO sends 50 frames a second; one that does not come in time is missed.
    #[default]
    Realtime,
    /// The cRIO waits for every answer: no deadlines, for simulation.
    Lockstep,
}

/// `[rig]`
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct RigChoice {
    /// Name of a built-in rig, or a rig file.
    pub file: String,
}

impl Default for RigChoice {
    fn default() -> Self {
        RigChoice { file: "dual_pressure".to_owned() }
    }
}

/// `[policy]`
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct PolicyChoice {
    /// Folder with `NAME.onnx` files.
    pub directory: PathBuf,
    /// Name of the policy that runs, or `fallback`.
    pub active: String,
    /// Treatment of policies that are published into the folder.
    pub follow: Follow,
    /// True where a policy needs a signature beside it, `NAME.onnx.minisig`.
    pub require_signature: bool,
    /// The public key (minisign, base64) that signatures are checked with.
    pub public_key: String,
    /// Treatment of a policy that tracks clearly worse than the fallback on the model in force.
    pub when_behind: WhenBehind,
    /// Standard deviation of exploration as a share of the outputs' range, for a policy that states none.
    pub exploration_std: f64,
    /// The most that exploration ever adds to a duty.
    pub exploration_max_duty: f64,
}

impl PolicyChoice {
    /// File of the policy that is to run; nothing says that it is there.
    pub fn active_file(&self) -> PathBuf {
        self.directory.join(format!("{}.onnx", self.active))
    }
}

/// Treatment of a policy that is published into the folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Follow {
    /// It is checked and waits for `controller swap`.
    #[default]
    Manual,
    /// The newest that has passed all checks is adopted.
    Newest,
}

/// Treatment of a policy that tracks clearly worse than the fallback on the model in force.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum WhenBehind {
    /// The fallback takes over from it.
    #[default]
    Fallback,
    /// It goes on; that it is behind is told.
    Fly,
}

/// The name of the policy that ships with the program.
pub const DEFAULT_POLICY: &str = "default";
/// The name that stands for no policy at all.
pub const FALLBACK: &str = "fallback";

impl Default for PolicyChoice {
    fn default() -> Self {
        PolicyChoice {
            directory: "policies".into(),
            active: DEFAULT_POLICY.to_owned(),
            follow: Follow::default(),
            require_signature: false,
            public_key: String::new(),
            when_behind: WhenBehind::default(),
            exploration_std: 0.02,
            exploration_max_duty: 0.02,
        }
    }
}

/// `[reference]`
#[derive(Debug, Clone, PartialEq, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct ReferenceChoice {
    /// CSV file `time_s,ref_pos_kpa,ref_neg_kpa`; absent means `reference.csv` where there is one, else the
    /// paper's reference.
    pub file: Option<PathBuf>,
    /// True where the reference begins again at its end; otherwise its last row is held.
    pub repeat: bool,
    /// True where the fallback, and what corrects it, learns from each flight of the reference for the next one
    /// ([`law::repetition`]).
    pub learn: bool,
}

impl ReferenceChoice {
    /// Continuation at the reference's end.
    pub fn after_end(&self) -> AfterEnd {
        if self.repeat { AfterEnd::Repeat } else { AfterEnd::Hold }
    }

    /// Learning from flights of it.
    pub fn learning(&self) -> RepetitionLearning {
        if self.learn { RepetitionLearning::On } else { RepetitionLearning::Off }
    }
}

/// `[record]`
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Record {
    /// Folder for recordings; made if it is not there.
    pub directory: PathBuf,
    /// Size at which the next file begins, in MiB.
    pub max_mib: u64,
    /// Time after which the next file begins, in minutes.
    pub max_minutes: u64,
    /// Free space below which nothing is armed, in MiB.
    pub min_free_mib: u64,
    /// Days after which a recording is removed; 0 keeps all.
    pub keep_days: u64,
    /// Size that all recordings in the folder may have, in GiB, the oldest going first; 0 keeps all.
    pub keep_gib: u64,
}

impl Default for Record {
    fn default() -> Self {
        Record {
            directory: "recordings".into(),
            max_mib: 256,
            max_minutes: 60,
            min_free_mib: 500,
            keep_days: 0,
            keep_gib: 0,
        }
    }
}

/// `[control]`
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Control {
    /// Unix socket for `controller status`, `arm`, `disarm`.
    pub socket: PathBuf,
    /// Arms by itself once the link is sound: for simulation and tests.
    pub auto_arm: bool,
}

impl Default for Control {
    fn default() -> Self {
        Control { socket: "controller.sock".into(), auto_arm: false }
    }
}

impl Control {
    /// Choice of who arms.
    pub fn arming(&self) -> Arming {
        if self.auto_arm { Arming::Automatic } else { Arming::Manual }
    }
}

/// `[safety]`
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Safety {
    /// Above this gauge pressure (kPa) the positive chamber is vented.
    pub max_pos_kpa: f64,
    /// Below this gauge pressure (kPa) the negative chamber is vented.
    pub min_neg_kpa: f64,
}

impl Default for Safety {
    fn default() -> Self {
        Safety { max_pos_kpa: 160.0, min_neg_kpa: -95.0 }
    }
}

/// `[realtime]`
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Realtime {
    /// SCHED_FIFO priority of the tick, 1 … 95.
    pub priority: u8,
    /// CPU that the tick is pinned to; absent means the last one where there are several.
    pub cpu: Option<usize>,
    /// True where the rig is only armed with FIFO priority and locked memory.
    pub enforce: bool,
}

impl Default for Realtime {
    fn default() -> Self {
        Realtime { priority: 80, cpu: None, enforce: true }
    }
}

/// Faults of a configuration, in one line.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {source}; give the path of a configuration file", .file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// TOML or a key is wrong.
    #[error("{}: line {line}: {problem}", .file.display())]
    Parse {
        /// The file.
        file: PathBuf,
        /// Line from 1.
        line: usize,
        /// The problem.
        problem: String,
    },
    /// A value makes no sense.
    #[error("{}: {key}: {problem}", .file.display())]
    Value {
        /// The file.
        file: PathBuf,
        /// Dotted key.
        key: &'static str,
        /// Problem and mend.
        problem: String,
    },
}

impl Config {
    /// A configuration with all defaults for a cRIO at `address`.
    pub fn for_address(address: &str) -> Self {
        Config {
            link: Link { address: address.to_owned(), pacing: Pacing::default() },
            rig: RigChoice::default(),
            policy: PolicyChoice::default(),
            reference: ReferenceChoice::default(),
            record: Record::default(),
            control: Control::default(),
            safety: Safety::default(),
            realtime: Realtime::default(),
        }
    }

    /// Reads a configuration file, checks it and makes its paths absolute to the file's folder.
    ///
    /// # Errors
    /// The first thing that is wrong, with its line or key.
    pub fn read(file: &Path) -> Result<Self, ConfigError> {
        Ok(Self::read_with_text(file)?.0)
    }

    /// As [`Config::read`], with the text that was read: the same bytes, whatever happens to the file.
    ///
    /// # Errors
    /// As [`Config::read`].
    pub fn read_with_text(file: &Path) -> Result<(Self, String), ConfigError> {
        let text = regular_file::read_text(file, MOST_BYTES)
            .map_err(|source| ConfigError::Read { file: file.to_owned(), source })?;
        let mut config = Self::parse(&text, file)?;
        let folder = file.parent().unwrap_or(Path::new(""));
        for path in [&mut config.policy.directory, &mut config.record.directory, &mut config.control.socket] {
            *path = folder.join(&*path);
        }
        // Without a choice, `reference.csv` beside the configuration counts where there is one.
        let default = folder.join("reference.csv");
        config.reference.file = match config.reference.file.take() {
            Some(chosen) => Some(folder.join(chosen)),
            None => default.is_file().then_some(default),
        };
        if model::rig::Rig::builtin_text(&config.rig.file).is_none() {
            config.rig.file = folder.join(&config.rig.file).to_string_lossy().into_owned();
        }
        check_places(&config, file)?;
        Ok((config, text))
    }

    /// Reads a configuration from text; `file` is for messages only, and paths stay as they are.
    ///
    /// # Errors
    /// As [`Config::read`].
    pub fn parse(text: &str, file: &Path) -> Result<Self, ConfigError> {
        let config: Config = toml::from_str(text).map_err(|error| {
            let at = error.span().map_or(0, |span| span.start);
            let line = 1 + text.bytes().take(at).filter(|b| *b == b'\n').count();
            let problem = parse_problem(text, at, error.message());
            ConfigError::Parse { file: file.to_owned(), line, problem }
        })?;
        check(&config, file)?;
        Ok(config)
    }

    /// The configuration with every key, as a file: what [`Config::parse`] reads back.
    pub fn to_toml(&self) -> String {
        // Tables of plain values: there is nothing in it that TOML has no word for.
        toml::to_string(self).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Config, String> {
        Config::parse(text, Path::new("c.toml")).map_err(|e| e.to_string())
    }

    #[test]
    fn only_the_address_is_needed() {
        let config = parse("[link]\naddress = \"10.0.0.2:50500\"\n").unwrap();
        assert_eq!(config, Config::for_address("10.0.0.2:50500"));
        assert_eq!((config.safety.max_pos_kpa, config.safety.min_neg_kpa), (160.0, -95.0));
    }

    #[test]
    fn a_configuration_comes_back_from_its_own_text() {
        let mut config = Config::for_address("10.0.0.2:50500");
        config.control.auto_arm = true;
        config.link.pacing = Pacing::Lockstep;
        config.safety.max_pos_kpa = 123.456_789_012_345_68;
        assert_eq!(Config::parse(&config.to_toml(), Path::new("c.toml")).unwrap(), config);
    }

    #[test]
    fn bad_configurations_get_one_line_that_names_the_key() {
        let link = "[link]\naddress = \"10.0.0.2:50500\"\n";
        for (text, words) in [
            ("", vec!["line 1", "link"]),
            ("[link]\n", vec!["address"]),
            ("[link]\naddress = \"10.0.0.2\"\n", vec!["link.address", "host:port"]),
            (&format!("{link}speed = 3\n"), vec!["line 3", "speed"]),
            (&format!("{link}[safty]\n"), vec!["line 3", "safty"]),
            (&format!("{link}pacing = \"fast\"\n"), vec!["line 3: pacing: ", "fast", "lockstep"]),
            (&format!("safety.max_pos_kpa = \"high\"\n{link}"), vec!["line 1: safety.max_pos_kpa: ", "high"]),
            (&format!("{link}[safety]\nmax_pos_kpa = \"high\"\n"), vec!["line 4", "string"]),
            (&format!("{link}[safety]\nmax_pos_kpa = 500.0\n"), vec!["safety.max_pos_kpa", "500", "280"]),
            (&format!("{link}[safety]\nmin_neg_kpa = nan\n"), vec!["safety.min_neg_kpa", "NaN"]),
            (&format!("{link}[policy]\nactive = \"../x\"\n"), vec!["policy.active"]),
            (&format!("{link}[realtime]\npriority = 99\n"), vec!["realtime.priority", "99"]),
            (&format!("{link}[record]\nmax_mib = 0\n"), vec!["record.max_mib", "0 is outside 1"]),
            (&format!("{link}[record]\nkeep_days = -1\n"), vec!["line 4", "-1"]),
            (&format!("{link}[policy]\nfollow = \"all\"\n"), vec!["line 4", "all", "newest"]),
            (&format!("{link}[policy]\nrequire_signature = true\n"), vec!["policy.public_key", "minisign"]),
            (
                &format!("{link}[policy]\nrequire_signature = true\npublic_key = \"RWQabc\"\n"),
                vec!["policy.public_key", "RWQabc", "no minisign public key"],
            ),
        ] {
            let message = parse(text).expect_err(text);
            assert!(!message.contains('\n') && message.starts_with("c.toml"), "{message}");
            for word in words {
                assert!(message.contains(word), "`{word}` is not in: {message}");
            }
        }
    }
}

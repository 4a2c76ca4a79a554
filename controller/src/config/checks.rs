//! Bounds of the values of a configuration, and words for those that are something else.

use std::path::{Path, PathBuf};

use admission::SignatureRule;

use super::{Config, ConfigError};

/// A number of the configuration.
struct NumberKey {
    key: &'static str,
    kind: NumberKind,
    low: f64,
    high: f64,
    /// The unit, and what else is to be known of the range.
    more: &'static str,
    value: fn(&Config) -> Option<f64>,
}

/// Numbers that a key takes.
#[derive(Clone, Copy, PartialEq, Eq)]
enum NumberKind {
    Whole,
    Real,
}

const fn whole(key: &'static str, low: f64, high: f64, value: fn(&Config) -> Option<f64>) -> NumberKey {
    NumberKey { key, kind: NumberKind::Whole, low, high, more: "", value }
}

const fn real(
    key: &'static str,
    low: f64,
    high: f64,
    more: &'static str,
    value: fn(&Config) -> Option<f64>,
) -> NumberKey {
    NumberKey { key, kind: NumberKind::Real, low, high, more, value }
}

/// Every number of the configuration with its range, both ends included.
const NUMBERS: [NumberKey; 11] = [
    real("safety.max_pos_kpa", 10.0, 280.0, " kPa gauge; the cRIO trips at 300", |c| Some(c.safety.max_pos_kpa)),
    real("safety.min_neg_kpa", -100.0, -10.0, " kPa gauge", |c| Some(c.safety.min_neg_kpa)),
    whole("realtime.priority", 1.0, 95.0, |c| Some(c.realtime.priority.into())),
    // Which CPUs there are is the machine's to say.
    whole("realtime.cpu", 0.0, 65_535.0, |c| c.realtime.cpu.map(|cpu| cpu as f64)),
    // Below 1 MiB a file is little more than its header; 64 GiB is no limit any more.
    whole("record.max_mib", 1.0, 65_536.0, |c| Some(c.record.max_mib as f64)),
    whole("record.max_minutes", 1.0, 10_080.0, |c| Some(c.record.max_minutes as f64)),
    // An hour is 103 MB: with less than 16 MiB the disk is full within ten minutes.
    whole("record.min_free_mib", 16.0, 1_048_576.0, |c| Some(c.record.min_free_mib as f64)),
    whole("record.keep_days", 0.0, 36_500.0, |c| Some(c.record.keep_days as f64)),
    whole("record.keep_gib", 0.0, 1_048_576.0, |c| Some(c.record.keep_gib as f64)),
    // Half of the range is no noise on an answer any more.
    real("policy.exploration_std", 0.0, 0.5, " of the outputs' range", |c| Some(c.policy.exploration_std)),
    // What a duty may move in a tick: more the slew limit takes off again.
    real("policy.exploration_max_duty", 0.0, 0.1, " of duty", |c| Some(c.policy.exploration_max_duty)),
];

impl NumberKey {
    fn range(&self) -> String {
        format!("{} … {}{}", self.low, self.high, self.more)
    }

    /// Words for what the key takes, where something else stands there.
    fn wanted(&self) -> String {
        let kind = match self.kind {
            NumberKind::Whole => "a whole number",
            NumberKind::Real => "a number",
        };
        format!("{kind} in {}", self.range())
    }
}

/// Checks the values of a configuration; `file` is for messages only.
///
/// # Errors
/// The first that makes no sense, with its key.
pub(super) fn check(config: &Config, file: &Path) -> Result<(), ConfigError> {
    let wrong = |key, problem: String| Err(ConfigError::Value { file: file.to_owned(), key, problem });
    let address = &config.link.address;
    if !is_address(address) {
        return wrong(
            "link.address",
            format!(
                "`{}` is no address; write host:port with a port from 1 to 65535, such as 192.168.1.20:50500",
                address.escape_debug()
            ),
        );
    }
    for number in &NUMBERS {
        // What is no number lies in no range.
        if let Some(value) = (number.value)(config).filter(|value| !(number.low..=number.high).contains(value)) {
            return wrong(number.key, format!("{} is outside {}", plain(value), number.range()));
        }
    }
    let policy = &config.policy;
    if policy.require_signature {
        if policy.public_key.is_empty() {
            return wrong(
                "policy.public_key",
                "policy.require_signature needs it: the second line of minisign.pub".to_owned(),
            );
        }
        if let Err(error) = SignatureRule::required(&policy.public_key) {
            let problem = error.to_string().replace(|c: char| c.is_control(), " ");
            return wrong("policy.public_key", problem);
        }
    }
    let name = &policy.active;
    if name.is_empty() || !name.chars().all(|c| c.is_ascii_alphanumeric() || "._-".contains(c)) || name.starts_with('.')
    {
        return wrong(
            "policy.active",
            format!("`{}` is no policy name; letters, digits, `.`, `_` and `-`, without .onnx", name.escape_debug()),
        );
    }
    // Read as it stands it would be the folder of the configuration.
    let empty = paths(config).into_iter().find(|(key, path)| FILES.contains(key) && path.as_os_str().is_empty());
    if let Some((key, _)) = empty {
        return wrong(key, "it is empty; write the path of a file, or leave the key out".to_owned());
    }
    // The system would look for a folder of that name.
    let of_a_folder = paths(config)
        .into_iter()
        .find(|(key, path)| FILES.contains(key) && path.as_os_str().as_encoded_bytes().ends_with(b"/"));
    if let Some((key, _)) = of_a_folder {
        return wrong(key, "it ends with `/`, which makes a folder of it; write the path of a file".to_owned());
    }
    let no_path = paths(config).into_iter().find(|(_, path)| path.as_os_str().as_encoded_bytes().contains(&0));
    match no_path {
        Some((key, _)) => wrong(key, "a zero byte (\\u0000) stands in it, and no path has one; take it out".to_owned()),
        None => Ok(()),
    }
}

/// Checks that no two keys name one place where either would be in the other's way; their paths are absolute by now.
///
/// # Errors
/// The folder that has the place of a socket.
pub(super) fn check_places(config: &Config, file: &Path) -> Result<(), ConfigError> {
    let socket = &config.control.socket;
    let sockets = [place(socket), place(&live::source::live_socket(socket))];
    for (key, folder) in
        [("record.directory", &config.record.directory), ("policy.directory", &config.policy.directory)]
    {
        if sockets.contains(&place(folder)) {
            let problem = format!(
                "{} is also the place of control.socket or of the live viewers' socket beside it; give one of the two another path",
                folder.display()
            );
            return Err(ConfigError::Value { file: file.to_owned(), key, problem });
        }
    }
    Ok(())
}

/// Keys whose paths lead to no folder.
const FILES: [&str; 3] = ["rig.file", "control.socket", "reference.file"];

/// All paths of a configuration by their keys.
fn paths(config: &Config) -> Vec<(&'static str, &Path)> {
    let mut paths = vec![
        ("rig.file", Path::new(&config.rig.file)),
        ("policy.directory", &config.policy.directory),
        ("record.directory", &config.record.directory),
        ("control.socket", &config.control.socket),
    ];
    paths.extend(config.reference.file.as_deref().map(|file| ("reference.file", file)));
    paths
}

/// A path whose folder is named without links and detours, as far as that folder is there.
fn place(path: &Path) -> PathBuf {
    let folder = path.parent().and_then(|folder| folder.canonicalize().ok());
    match (folder, path.file_name()) {
        (Some(folder), Some(name)) => folder.join(name),
        _ => path.to_owned(),
    }
}

/// True for a host and a port that can be connected to: whether the host is there shows when it is.
fn is_address(address: &str) -> bool {
    let Some((host, port)) = address.rsplit_once(':') else { return false };
    let host_may_have = |c: char| c.is_ascii_alphanumeric() || ".-_:[]%".contains(c) || !c.is_ascii();
    !host.is_empty()
        && host.chars().all(|c| host_may_have(c) && !c.is_whitespace() && !c.is_control())
        && port.bytes().all(|byte| byte.is_ascii_digit())
        && port.parse::<u16>().is_ok_and(|port| port > 0)
}

/// A number in the form in which it is shortest: 1e300 has 300 digits otherwise.
fn plain(value: f64) -> String {
    if value.fract() == 0.0 && value.abs() < 1e7 { format!("{value}") } else { format!("{value:?}") }
}

/// Words for a value that TOML or its key does not take: the key where it stands, and its range where it is a number.
pub(super) fn parse_problem(text: &str, at: usize, message: &str) -> String {
    let message = message.replace('\n', "; ");
    let Some(key) = key_before(text, at) else { return message };
    let message = shortened(&message);
    let dotted = format!("{}{key}", table_before(text, at).map(|table| format!("{table}.")).unwrap_or_default());
    match (NUMBERS.iter().find(|number| number.key == dotted), message.split_once(", expected ")) {
        (Some(number), Some((found, _))) => format!("{key}: {found}, expected {}", number.wanted()),
        _ => format!("{key}: {message}"),
    }
}

/// A message in which a number in backticks is written in the form in which it is shortest.
fn shortened(message: &str) -> String {
    let parts = message.split('`').enumerate().map(|(index, part)| match part.parse::<f64>() {
        Ok(value) if index % 2 == 1 && part.len() > 20 => format!("{value:?}"),
        _ => part.to_owned(),
    });
    parts.collect::<Vec<_>>().join("`")
}

/// The key whose value stands at a place of the text; `None` where the place is the key's own.
fn key_before(text: &str, at: usize) -> Option<&str> {
    let begin = text.get(..at)?.rfind('\n').map_or(0, |end| end + 1);
    text.get(begin..at)?.split_once('=').map(|(key, _)| key.trim())
}

/// The table that a place of the text stands in; `None` before the first.
fn table_before(text: &str, at: usize) -> Option<&str> {
    let header = text.get(..at)?.lines().rev().map(str::trim).find(|line| line.starts_with('['))?;
    header.strip_prefix('[')?.split(']').next().map(str::trim)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(text: &str) -> String {
        let text = format!("{text}\n");
        let said = Config::parse(&text, Path::new("c.toml")).expect_err(&text).to_string();
        assert!(!said.contains('\n') && said.len() < 250, "{said}");
        said
    }

    #[test]
    fn only_a_host_and_a_port_are_an_address() {
        for good in ["10.0.0.1:50500", "crio-1.lab:1", "[::1]:50500", "::1:50500", "[fe80::1%eth0]:5", "kühler:5"] {
            assert!(is_address(good), "{good}");
        }
        for bad in
            ["", ":5", "x", "x:", "127.0.0.1:0", "127.0.0.1:+5", "a b:1", "x:65536", "http://x:5", "x\n:5", "x: 5"]
        {
            assert!(!is_address(bad), "{bad}");
        }
        assert!(said("link.address = \"127.0.0.1:0\"").contains("link.address: `127.0.0.1:0` is no address"));
    }

    #[test]
    fn a_number_that_is_none_for_its_key_is_told_with_its_range_and_in_short() {
        let link = "link.address = \"x:1\"";
        for (line, words) in [
            ("record.keep_days = -1", &["record.keep_days: ", "`-1`", "a whole number in 0 … 36500"][..]),
            ("[record]\nkeep_days = -1", &["keep_days: ", "`-1`", "a whole number in 0 … 36500"]),
            ("[record]\nmax_mib = 1.5", &["`1.5`", "a whole number in 1 … 65536"]),
            ("[record]\nmax_mib = 1e300", &["`1e300`", "a whole number in 1 … 65536"]),
            ("[realtime]\npriority = 300", &["`300`", "a whole number in 1 … 95"]),
            ("[realtime]\ncpu = -2", &["`-2`", "a whole number in 0 … 65535"]),
            ("[safety]\nmax_pos_kpa = 1e300", &["safety.max_pos_kpa: 1e300 is outside 10 … 280 kPa gauge"]),
            ("[safety]\nmin_neg_kpa = nan", &["safety.min_neg_kpa: NaN is outside -100 … -10 kPa gauge"]),
            ("[policy]\nexploration_std = 0.6", &["0.6 is outside 0 … 0.5"]),
            ("[policy]\nactive = 5", &["active: ", "string"]),
        ] {
            let said = said(&format!("{link}\n{line}"));
            for word in words {
                assert!(said.contains(word), "`{word}` is not in: {said}");
            }
        }
    }

    #[test]
    fn a_path_with_a_zero_byte_is_none() {
        let link = "link.address = \"x:1\"";
        for key in ["record.directory", "control.socket", "policy.directory", "reference.file", "rig.file"] {
            let said = said(&format!("{link}\n{key} = \"a\\u0000b\""));
            assert!(said.contains(&format!("{key}: a zero byte")), "{said}");
        }
    }

    #[test]
    fn an_empty_path_names_no_file() {
        for key in FILES {
            let said = said(&format!("link.address = \"x:1\"\n{key} = \"\""));
            assert!(said.contains(&format!("{key}: it is empty")), "{said}");
        }
        let folders = "link.address = \"x:1\"\nrecord.directory = \"\"\npolicy.directory = \"\"\n";
        Config::parse(folders, Path::new("c.toml")).unwrap();
    }

    #[test]
    fn a_socket_and_a_folder_do_not_have_one_place() {
        let mut config = Config::for_address("x:1");
        let refused = |config: &Config| check_places(config, Path::new("c.toml")).unwrap_err().to_string();
        check_places(&config, Path::new("c.toml")).unwrap();
        config.record.directory = std::env::temp_dir().join("x/../s.sock");
        config.control.socket = config.record.directory.clone();
        assert!(refused(&config).contains("record.directory: "));
        config.record.directory = config.control.socket.with_extension("live.sock");
        assert!(refused(&config).contains("record.directory: "));
        config.record.directory = "elsewhere".into();
        config.policy.directory = config.control.socket.clone();
        assert!(refused(&config).contains("policy.directory: "));
    }
}

//! The file beside a policy that says why it was refused, `NAME.onnx.refused.json`.
//!
//! It is there before `policies` says `refused`, and gone before it says `passed`, of a file that was examined: who reads
//! the one may read the other. For a policy that lost its place in flight it follows within moments.

use std::path::{Path, PathBuf};

use admission::Refusal;
use proto::atomic_file;

/// The path of the file beside a policy.
fn path(policy: &Path) -> PathBuf {
    let mut name = policy.as_os_str().to_owned();
    name.push(".refused.json");
    PathBuf::from(name)
}

/// Leaves the reason beside a policy, as a whole or not at all.
///
/// # Errors
/// If it cannot be written; the text names the file.
pub fn leave(policy: &Path, refusal: &Refusal) -> Result<(), String> {
    let file = path(policy);
    if atomic_file::is_no_file(&file) {
        // A pipe would hold whoever writes into it.
        return Err(format!("{}: it is not a regular file; remove it", file.display()));
    }
    serde_json::to_vec_pretty(refusal)
        .map_err(|error| error.to_string())
        .and_then(|text| atomic_file::write(&file, &text).map_err(|error| error.to_string()))
        .map_err(|problem| format!("{}: the reason of a refusal cannot be left there: {problem}", file.display()))
}

/// Takes it away; nothing where there is none.
pub fn take_away(policy: &Path) {
    let _ = std::fs::remove_file(path(policy));
}

#[cfg(test)]
mod tests {
    use admission::Stage;

    use super::*;

    #[test]
    fn a_pipe_in_its_place_holds_nobody() {
        let folder = std::env::temp_dir().join(format!("refusal-file-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir(&folder).unwrap();
        let (policy, refusal) = (
            folder.join("bad.onnx"),
            Refusal { stage: Stage::File, reason: "too large".to_owned(), sha256: None, figures: None },
        );
        assert!(std::process::Command::new("mkfifo").arg(path(&policy)).status().unwrap().success());
        assert!(leave(&policy, &refusal).unwrap_err().contains("bad.onnx.refused.json: it is not a regular file"));
        take_away(&policy);
        leave(&policy, &refusal).unwrap();
        assert!(std::fs::read_to_string(path(&policy)).unwrap().contains("too large"));
        std::fs::remove_dir_all(&folder).unwrap();
    }
}

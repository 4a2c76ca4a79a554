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
    serde_json::to_vec_pretty(refusal)
        .map_err(|error| error.to_string())
        .and_then(|text| atomic_file::write(&file, &text).map_err(|error| error.to_string()))
        .map_err(|problem| format!("{}: the reason of a refusal cannot be left there: {problem}", file.display()))
}

/// Takes it away; nothing where there is none.
pub fn take_away(policy: &Path) {
    let _ = std::fs::remove_file(path(policy));
}

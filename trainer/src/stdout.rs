//! Standard output: text for people or one JSON object, in one write each.
//!
//! A reader that has seen enough (`| head`) closes the pipe; that is no failure of the command.

use std::io::{self, Write};

use crate::failure::Failure;

/// Writes text, with a line end, and flushes it.
///
/// # Errors
/// Standard output cannot be written, other than because its reader has gone.
pub(crate) fn say(text: &str) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    let end = if text.ends_with('\n') { "" } else { "\n" };
    match out.write_all(format!("{text}{end}").as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(Failure::Stdout(error)),
        _ => Ok(()),
    }
}

/// Writes one JSON object.
///
/// # Errors
/// As [`say`].
pub(crate) fn say_json(value: &serde_json::Value) -> Result<(), Failure> {
    say(&format!("{value:#}"))
}

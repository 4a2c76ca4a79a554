//! Standard output: text for people or one JSON object, in one write each.
//!
//! A reader that has seen enough (`| head`) closes the pipe; that is no failure of the command. On a terminal sentences are broken
//! between words; tables and commands to paste stay lines.

use std::io::{self, Write};
use std::path::PathBuf;

use clap::builder::{PathBufValueParser, TypedValueParser};
use proto::terminal_lines;

use crate::failure::Failure;

/// Reads a path that must not be the sign for standard output; `why` says why not.
pub(crate) fn no_sign(why: &'static str) -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(move |path| if path.as_os_str() == "-" { Err(why) } else { Ok(path) })
}

/// Writes sentences and tables, with a line end, and flushes them.
///
/// # Errors
/// Standard output cannot be written, other than because its reader has gone.
pub(crate) fn say(text: &str) -> Result<(), Failure> {
    put(&terminal_lines::for_stream(text, &io::stdout()))
}

/// Writes one JSON object.
///
/// # Errors
/// As [`say`].
pub(crate) fn say_json(value: &serde_json::Value) -> Result<(), Failure> {
    put(&format!("{value:#}"))
}

/// Writes text as it is, with a line end, and flushes it.
///
/// # Errors
/// As [`say`].
pub(crate) fn put(text: &str) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    let end = if text.ends_with('\n') { "" } else { "\n" };
    match out.write_all(format!("{text}{end}").as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(Failure::Stdout(error)),
        _ => Ok(()),
    }
}

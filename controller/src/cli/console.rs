//! Lines for a person. A terminal that went away must not end a flight, and `println!` would panic, so what cannot be
//! printed is dropped.

use std::fmt::Display;
use std::io::{self, Write};

/// A line of results, on standard output.
pub(super) fn say(line: impl Display) {
    let _ = writeln!(io::stdout().lock(), "{line}");
}

/// A line of events, on standard error.
pub(super) fn tell(line: impl Display) {
    let _ = writeln!(io::stderr().lock(), "controller: {line}");
}

//! The live line of something that takes its time, on standard error.

use std::io::IsTerminal;
use std::time::Duration;

use controller::operator::console::overwrite;

use super::console::tell;

/// Place where live lines go; one that cannot be shown ends nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Screen {
    /// A terminal: each line is written over the one before.
    Terminal,
    /// A file or a pipe: one line after the other.
    Log,
}

impl Screen {
    /// Standard error.
    pub(super) fn of_stderr() -> Self {
        if std::io::stderr().is_terminal() { Screen::Terminal } else { Screen::Log }
    }

    /// Time between two live lines.
    pub(super) fn every(self) -> Duration {
        match self {
            Screen::Terminal => Duration::from_millis(200),
            Screen::Log => Duration::from_secs(5),
        }
    }

    /// Shows a live line.
    pub(super) fn show(self, text: &str) {
        match self {
            Screen::Terminal => overwrite(text),
            Screen::Log => tell(text),
        }
    }

    /// Takes the live line away, before a line that stays.
    pub(super) fn clear(self) {
        if self == Screen::Terminal {
            overwrite("");
        }
    }
}

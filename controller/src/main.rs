//! `controller`: see `controller --help`.

mod cli;

use std::process::ExitCode;

use clap::CommandFactory;
use controller::machine::signals::stopped_status;
use controller::operator::console::{self, Unprinted};
use manual::Explained;

fn main() -> ExitCode {
    proto::parent_process::end_with_parent();
    let arguments = match manual::parse::<cli::Arguments>() {
        Ok(arguments) => arguments,
        Err(error) => return explain(&error),
    };
    let has_an_end = arguments.has_an_end();
    let stopped = || stopped_status().filter(|_| has_an_end);
    let status = arguments.run().map_or_else(
        |failure| {
            console::notice(&failure.line);
            failure.status(stopped())
        },
        |()| GOOD,
    );
    ended(status, stopped)
}

/// Exit status of work that is done and good.
const GOOD: u8 = 0;

/// The exit status once all is printed: results that nobody could keep are no success, and those that nobody read before a signal came
/// were left undone by it. `stopped` gives the status of that.
fn ended(status: u8, stopped: impl Fn() -> Option<u8>) -> ExitCode {
    let Err(unprinted) = console::finish() else { return status.into() };
    console::notice(&unprinted);
    // Where standard error takes nothing either there is no one to tell.
    let _ = console::finish();
    match unprinted {
        _ if status != GOOD => status.into(),
        Unprinted::Failed(_) => ExitCode::FAILURE,
        Unprinted::Stopped => stopped().unwrap_or(status).into(),
    }
}

/// Help where it was asked for, two lines where the command line is wrong; the exit status.
fn explain(error: &clap::Error) -> ExitCode {
    let columns = proto::terminal_lines::width(&std::io::stdout());
    let status = match manual::explain(&cli::Arguments::command(), error, columns) {
        Explained::Help(text) => {
            console::result(text.trim_end());
            GOOD
        }
        Explained::Wrong(lines) => {
            lines.iter().for_each(console::notice);
            2
        }
    };
    ended(status, || None)
}

//! `controller`: see `controller --help`.

mod cli;

use std::process::ExitCode;

use clap::{CommandFactory, Parser};
use manual::Explained;

fn main() -> ExitCode {
    let arguments = match cli::Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) => return explain(&error),
    };
    let status = match arguments.run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            controller::console::notice(failure.line);
            ExitCode::from(failure.status)
        }
    };
    controller::console::finish();
    status
}

/// Help where it was asked for, two lines where the command line is wrong; the exit status.
fn explain(error: &clap::Error) -> ExitCode {
    let status = match manual::explain(&cli::Arguments::command(), error) {
        Explained::Help(text) => {
            controller::console::result(text.trim_end());
            ExitCode::SUCCESS
        }
        Explained::Wrong(lines) => {
            lines.iter().for_each(controller::console::notice);
            ExitCode::from(2)
        }
    };
    controller::console::finish();
    status
}

//! `controller`: see `controller --help`.

mod cli;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    // clap itself answers wrong usage with status 2 and help with 0.
    let status = match cli::Arguments::parse().run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            controller::console::notice(failure.line);
            ExitCode::from(failure.status)
        }
    };
    controller::console::finish();
    status
}

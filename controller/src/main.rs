//! `controller`: see `controller --help`.

mod cli;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    // clap itself answers wrong usage with status 2 and help with 0.
    match cli::Arguments::parse().run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("controller: {}", failure.line);
            ExitCode::from(failure.status)
        }
    }
}

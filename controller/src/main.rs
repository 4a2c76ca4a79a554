//! `controller`: see `controller --help`.

mod cli;

use std::process::ExitCode;

use clap::CommandFactory;
use controller::machine::signals::stopped_status;
use manual::Explained;

fn main() -> ExitCode {
    proto::parent_process::end_with_parent();
    let arguments = match manual::parse::<cli::Arguments>() {
        Ok(arguments) => arguments,
        Err(error) => return explain(&error),
    };
    let when_stopped = arguments.when_stopped();
    let outcome = arguments.run();
    let stopped = stopped_status().filter(|_| when_stopped.is_undone(&outcome));
    let status = match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            controller::operator::console::notice(failure.line);
            ExitCode::from(failure.status)
        }
    };
    ended(stopped.map_or(status, ExitCode::from))
}

/// The exit status once all is printed: results that nobody could keep are no success.
fn ended(status: ExitCode) -> ExitCode {
    let Err(line) = controller::operator::console::finish() else { return status };
    controller::operator::console::notice(line);
    // Where standard error takes nothing either there is no one to tell.
    let _ = controller::operator::console::finish();
    if status == ExitCode::SUCCESS { ExitCode::FAILURE } else { status }
}

/// Help where it was asked for, two lines where the command line is wrong; the exit status.
fn explain(error: &clap::Error) -> ExitCode {
    let columns = proto::terminal_lines::width(&std::io::stdout());
    let status = match manual::explain(&cli::Arguments::command(), error, columns) {
        Explained::Help(text) => {
            controller::operator::console::result(text.trim_end());
            ExitCode::SUCCESS
        }
        Explained::Wrong(lines) => {
            lines.iter().for_each(controller::operator::console::notice);
            ExitCode::from(2)
        }
    };
    ended(status)
}

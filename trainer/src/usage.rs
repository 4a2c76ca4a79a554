//! The command line gone wrong: clap's page of words as two plain lines, exit status 2.

use std::process::ExitCode;

use clap::CommandFactory;
use clap::error::ErrorKind;

use crate::failure::{BAD_INPUT, tell};
use crate::stdout;

/// Shows help where help was asked for; otherwise says what is wrong and where to look.
pub(crate) fn explain<C: CommandFactory>(error: &clap::Error) -> ExitCode {
    let text = error.to_string();
    match error.kind() {
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => match stdout::say(&text) {
            Ok(()) => ExitCode::SUCCESS,
            Err(failure) => failure.told(),
        },
        ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand | ErrorKind::MissingSubcommand => {
            tell(&format!("no command given; there are {}", commands::<C>().join(", ")));
            tell(&see(None));
            ExitCode::from(BAD_INPUT)
        }
        _ => {
            let given = std::env::args().nth(1).filter(|word| commands::<C>().contains(word));
            tell(&in_one_line(&text));
            tell(&see(given.as_deref()));
            ExitCode::from(BAD_INPUT)
        }
    }
}

fn commands<C: CommandFactory>() -> Vec<String> {
    C::command().get_subcommands().map(|command| command.get_name().to_owned()).collect()
}

fn see(command: Option<&str>) -> String {
    match command {
        Some(command) => format!("see trainer {command} --help"),
        None => "see trainer --help".to_owned(),
    }
}

/// What clap says before its usage line, in one line.
fn in_one_line(text: &str) -> String {
    let mut line = String::new();
    for part in text.lines().map(str::trim).take_while(|part| !part.starts_with("Usage:")) {
        if part.is_empty() || part.starts_with("For more information") {
            continue;
        }
        if !line.is_empty() {
            line.push_str(if line.ends_with(':') { " " } else { "; " });
        }
        line.push_str(part.strip_prefix("error: ").unwrap_or(part));
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn claps_paragraphs_become_one_line() {
        let missing = "error: the following required arguments were not provided:\n  --inputs <FILE>\n\nUsage: x\n\nFor more information, try '--help'.\n";
        assert_eq!(in_one_line(missing), "the following required arguments were not provided: --inputs <FILE>");
        let unknown =
            "error: unexpected argument '--rg' found\n\n  tip: a similar argument exists: '--rig'\n\nUsage: x\n";
        assert_eq!(in_one_line(unknown), "unexpected argument '--rg' found; tip: a similar argument exists: '--rig'");
    }
}

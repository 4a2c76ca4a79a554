//! A command line that is not to be carried out: help where it was asked for, two plain lines for what is wrong.

use clap::Command;
use clap::error::ErrorKind;

use crate::wrapped;

/// What to say to a command line that does not parse.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Explained {
    /// Help or version, for standard output; exit status 0.
    Help(String),
    /// What is wrong and where to look, for standard error; exit status 2.
    Wrong([String; 2]),
}

/// Puts clap's own words into this project's.
pub fn explain(command: &Command, error: &clap::Error) -> Explained {
    let text = error.to_string();
    let program = command.get_name();
    match error.kind() {
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => Explained::Help(wrapped(&text)),
        ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand | ErrorKind::MissingSubcommand => Explained::Wrong([
            format!("no command given; there are {}", commands(command).join(", ")),
            format!("see {program} --help"),
        ]),
        _ => {
            let given = std::env::args().nth(1).filter(|word| commands(command).contains(&word.as_str()));
            let see = match given {
                Some(command) => format!("see {program} {command} --help"),
                None => format!("see {program} --help"),
            };
            Explained::Wrong([in_one_line(&text), see])
        }
    }
}

fn commands(command: &Command) -> Vec<&str> {
    command.get_subcommands().filter(|c| !c.is_hide_set()).map(Command::get_name).collect()
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

//! A command line that is not to be carried out: help where it was asked for, two plain lines for what is wrong.

use clap::error::ErrorKind;
use clap::{Arg, Command, CommandFactory, FromArgMatches};

use crate::wrapped;

/// Answer to a command line that does not parse.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Explained {
    /// Help or version, for standard output; exit status 0.
    Help(String),
    /// Problem and where to look, for standard error; exit status 2.
    Wrong([String; 2]),
}

/// Parses the program's own command line. A number below zero behind an option that takes a value is its value, so that what is
/// said of it names the option.
///
/// # Errors
/// As clap has it; [`explain`] puts it into words.
pub fn parse<C: CommandFactory + FromArgMatches>() -> Result<C, clap::Error> {
    let mut matches = with_negative_numbers(C::command()).try_get_matches()?;
    C::from_arg_matches_mut(&mut matches).map_err(|error| error.format(&mut C::command()))
}

/// The command with each option, its own and those of the commands below, open to numbers below zero.
fn with_negative_numbers(command: Command) -> Command {
    let open = |arg: Arg| {
        let takes_value = !arg.is_positional() && arg.get_action().takes_values();
        if takes_value { arg.allow_negative_numbers(true) } else { arg }
    };
    command.mut_args(open).mut_subcommands(with_negative_numbers)
}

/// Puts clap's own words into this project's, help for a terminal of so many columns.
pub fn explain(command: &Command, error: &clap::Error, columns: usize) -> Explained {
    explain_of(command, error, std::env::args().skip(1), columns)
}

/// A run of words behind the program's name, likewise.
fn explain_of(
    command: &Command,
    error: &clap::Error,
    given: impl Iterator<Item = String>,
    columns: usize,
) -> Explained {
    let text = error.to_string();
    let (meant, name) = meant(command, given);
    match error.kind() {
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => Explained::Help(wrapped(&text, columns)),
        ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand | ErrorKind::MissingSubcommand => Explained::Wrong([
            format!("no command given; there are {}", commands(meant).join(", ")),
            format!("see {name} --help"),
        ]),
        _ => Explained::Wrong([about_numbers(in_one_line(&text)), format!("see {name} --help")]),
    }
}

/// The command that the first words name, down to the last that is one, and how it is called.
fn meant(program: &Command, given: impl Iterator<Item = String>) -> (&Command, String) {
    let (mut command, mut name) = (program, program.get_name().to_owned());
    for word in given {
        let Some(below) = command.get_subcommands().find(|below| !below.is_hide_set() && below.get_name() == word)
        else {
            break;
        };
        command = below;
        name = format!("{name} {word}");
    }
    (command, name)
}

fn commands(command: &Command) -> Vec<&str> {
    command.get_subcommands().filter(|c| !c.is_hide_set()).map(Command::get_name).collect()
}

/// Puts what the standard library says of a number that is none into words that name what would do; other lines stay.
fn about_numbers(line: String) -> String {
    const SAID: [(&str, &str); 5] = [
        ("invalid digit found in string", "a whole number, 0 or more, is needed"),
        ("cannot parse integer from empty string", "a whole number, 0 or more, is needed"),
        ("number too large to fit in target type", "that is too large"),
        ("invalid float literal", "a number is needed"),
        ("cannot parse float from empty string", "a number is needed"),
    ];
    let said = SAID.iter().find_map(|(theirs, ours)| Some(format!("{}{ours}", line.strip_suffix(theirs)?)));
    said.unwrap_or(line)
}

/// Message of clap before its usage line, in one line.
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
    fn a_command_below_another_names_its_own() {
        let program = Command::new("pump").subcommand(
            Command::new("fill")
                .subcommand_required(true)
                .subcommand(Command::new("slowly"))
                .subcommand(Command::new("fast")),
        );
        let said = |words: &[&str]| {
            let all = std::iter::once("pump").chain(words.iter().copied());
            let error = program.clone().try_get_matches_from(all).unwrap_err();
            explain_of(&program, &error, words.iter().map(|word| (*word).to_owned()), 80)
        };
        let wrong = |lines: [&str; 2]| Explained::Wrong(lines.map(str::to_owned));
        assert_eq!(said(&["fill"]), wrong(["no command given; there are slowly, fast", "see pump fill --help"]));
        let Explained::Wrong([_, see]) = said(&["fill", "fast", "--now"]) else { panic!("this is wrong") };
        assert_eq!(see, "see pump fill fast --help");
    }

    #[test]
    fn a_number_that_will_not_do_is_told_with_its_option() {
        let steps = Arg::new("steps").long("steps").value_name("N").value_parser(clap::value_parser!(u64));
        let pace = Arg::new("pace").long("pace").value_name("S").value_parser(clap::value_parser!(f64));
        let program = Command::new("pump").subcommand(Command::new("fill").args([steps, pace]));
        let said = |words: &[&str]| {
            let all = std::iter::once("pump").chain(words.iter().copied());
            let error = with_negative_numbers(program.clone()).try_get_matches_from(all).unwrap_err();
            match explain_of(&program, &error, words.iter().map(|word| (*word).to_owned()), 80) {
                Explained::Wrong([line, _]) => line,
                Explained::Help(text) => text,
            }
        };
        let whole = "invalid value '-5' for '--steps <N>': a whole number, 0 or more, is needed";
        assert_eq!(said(&["fill", "--steps", "-5"]), whole);
        assert_eq!(said(&["fill", "--steps=-5"]), whole);
        assert_eq!(said(&["fill", "--pace", "fast"]), "invalid value 'fast' for '--pace <S>': a number is needed");
        assert_eq!(
            said(&["fill", "--steps", "99999999999999999999"]),
            "invalid value '99999999999999999999' for '--steps <N>': that is too large"
        );
    }

    #[test]
    fn claps_paragraphs_become_one_line() {
        let missing = "error: the following required arguments were not provided:\n  --inputs <FILE>\n\nUsage: x\n\nFor more information, try '--help'.\n";
        assert_eq!(in_one_line(missing), "the following required arguments were not provided: --inputs <FILE>");
        let unknown =
            "error: unexpected argument '--rg' found\n\n  tip: a similar argument exists: '--rig'\n\nUsage: x\n";
        assert_eq!(in_one_line(unknown), "unexpected argument '--rg' found; tip: a similar argument exists: '--rig'");
    }
}

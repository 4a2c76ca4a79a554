//! Help, manual pages and shell completions, made from the same definitions that parse the command line.

mod usage;

use std::io;
use std::path::Path;

use clap::Command;
use clap_complete::Shell;

pub use usage::{Explained, explain, parse};

/// Writes `man1/PROGRAM.1`, `man1/PROGRAM-SUBCOMMAND.1` and completions for bash, zsh and fish into a folder.
///
/// # Errors
/// If a folder or file cannot be made.
pub fn write(command: Command, folder: &Path) -> io::Result<()> {
    let name = command.get_name().to_owned();
    let pages = folder.join("man1");
    std::fs::create_dir_all(&pages)?;
    clap_mangen::generate_to(command.clone().disable_help_subcommand(true), &pages)?;
    let source = format!("{name} {}", command.get_version().unwrap_or_default());
    for page in std::fs::read_dir(&pages)? {
        let page = page?.path();
        let file = page.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if file == format!("{name}.1") || file.starts_with(&format!("{name}-")) {
            std::fs::write(&page, edited(&std::fs::read_to_string(&page)?, source.trim()))?;
        }
    }
    for (shell, place) in [
        (Shell::Bash, format!("bash/{name}")),
        (Shell::Zsh, format!("zsh/_{name}")),
        (Shell::Fish, format!("fish/{name}.fish")),
    ] {
        let path = folder.join(place);
        if let Some(parent) = path.parent() {
            std::fs::create_dir_all(parent)?;
        }
        let mut text = Vec::new();
        clap_complete::generate(shell, &mut command.clone(), &name, &mut text);
        std::fs::write(path, text)?;
    }
    Ok(())
}

/// A manual page with the program and its version in its last line (a subcommand has none of its own), and with what stands
/// behind the options under a heading that says what it is, its examples line by line as they are typed.
fn edited(page: &str, source: &str) -> String {
    let mut out = String::with_capacity(page.len());
    let mut lines = page.lines().peekable();
    let mut extra = Extra::Before;
    while let Some(line) = lines.next() {
        extra = extra.at(line, &mut out);
        let title = line.strip_prefix(".TH ").and_then(|title| title.split('"').next());
        if let Some(title) = title {
            out.push_str(&format!(".TH {title}\"{source}\""));
        } else if line == EXTRA {
            let examples = lines.peek().is_some_and(|next| next.starts_with("Example"));
            out.push_str(if examples { ".SH EXAMPLES" } else { ".SH NOTES" });
            // The heading says it.
            lines.next_if(|next| ["Example:", "Examples:"].contains(next));
        } else {
            out.push_str(line);
        }
        out.push('\n');
    }
    extra.at("", &mut out);
    out
}

/// Heading that clap gives what stands behind the options.
const EXTRA: &str = ".SH EXTRA";

/// Place in a manual page: examples, which are indented, stand behind the options.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Extra {
    Before,
    Within,
    /// At lines that are not filled.
    Example,
}

impl Extra {
    /// The place of a line, behind the request that it needs: an example is no paragraph to be filled and hyphenated.
    fn at(self, line: &str, out: &mut String) -> Self {
        let is_example = line.starts_with("  ");
        match self {
            Extra::Within if is_example => {
                out.push_str(".nf\n");
                Extra::Example
            }
            Extra::Example if !is_example => {
                out.push_str(".fi\n");
                if line.starts_with(".SH") { Extra::Before } else { Extra::Within }
            }
            Extra::Before if line == EXTRA => Extra::Within,
            Extra::Within if line.starts_with(".SH") => Extra::Before,
            place => place,
        }
    }
}

/// Columns of a line of help at most: wider paragraphs are hard to read.
const WIDTH: usize = 80;

/// Breaks the lines of a help text at so many columns, 80 at most, further lines as far in as the text of the first.
///
/// Where a line has a left part (an option, a command) and its text beside it, two blanks or more apart, the text's
/// column counts.
pub fn wrapped(help: &str, width: usize) -> String {
    let width = width.min(WIDTH);
    let mut out = String::with_capacity(help.len() + help.len() / 8);
    for line in help.lines() {
        if line.chars().count() <= width {
            out.push_str(line);
            out.push('\n');
            continue;
        }
        let margin = text_column(line, width);
        let mut column = 0;
        for (number, word) in line.split(' ').enumerate() {
            let length = word.chars().count();
            if column > margin && column + 1 + length > width {
                out.push('\n');
                out.push_str(&" ".repeat(margin));
                column = margin;
            } else if number > 0 {
                out.push(' ');
                column += 1;
            }
            out.push_str(word);
            column += length;
        }
        out.push('\n');
    }
    out
}

/// The column at which a line's text begins; never beyond the middle of a line of this width.
fn text_column(line: &str, width: usize) -> usize {
    let indent = line.chars().take_while(|c| *c == ' ').count();
    let rest = line.get(indent..).unwrap_or_default();
    let beside = rest.find("  ").map_or(0, |gap| {
        let left = rest.get(..gap).unwrap_or_default().chars().count();
        let blanks = rest.get(gap..).unwrap_or_default().chars().take_while(|c| *c == ' ').count();
        left + blanks
    });
    let column = indent + beside;
    if column < width / 2 { column } else { indent }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn help_is_as_wide_as_the_terminal_80_columns_at_most_and_keeps_its_words() {
        let long = "very ".repeat(60);
        let help = format!("Usage: pump\n\n{long}\n  -o, --out <DIR>  {long}\n          {long}\n");
        for (terminal, widest) in [(200, 80), (80, 80), (60, 60)] {
            let text = wrapped(&help, terminal);
            let lines = || text.lines().map(|line| line.chars().count());
            assert!(lines().all(|line| line <= widest) && lines().any(|line| line > widest - 6), "{text}");
            assert_eq!(text.split_whitespace().collect::<Vec<_>>(), help.split_whitespace().collect::<Vec<_>>());
            assert!(text.contains("\n                   very"), "beside the option: {text}");
        }
        // A word that is longer than a line stays whole.
        assert_eq!(wrapped(&"x".repeat(100), 80), format!("{}\n", "x".repeat(100)));
    }
    use clap::Arg;

    #[test]
    fn every_command_has_a_page_and_every_shell_its_file() {
        let folder = std::env::temp_dir().join(format!("manual-{}", std::process::id()));
        let fill = Command::new("fill")
            .about("Fills a chamber.")
            .after_help("Example:\n  pump fill --kpa 90\n\nMore is in its guide.");
        let command =
            Command::new("pump").version("1.2").about("Pumps.").subcommand(fill.arg(Arg::new("kpa").long("kpa")));
        write(command, &folder).unwrap();
        for (file, word) in [
            ("man1/pump.1", "Pumps"),
            ("man1/pump-fill.1", "kpa"),
            ("man1/pump-fill.1", "\n.TH pump-fill 1  \"pump 1.2\"\n"),
            ("man1/pump-fill.1", "\n.SH EXAMPLES\n.nf\n  pump fill \\-\\-kpa 90\n.fi\n\nMore is"),
            ("bash/pump", "fill"),
            ("zsh/_pump", "fill"),
            ("fish/pump.fish", "fill"),
        ] {
            let text = std::fs::read_to_string(folder.join(file)).unwrap();
            assert!(text.contains(word), "{file}");
        }
        std::fs::remove_dir_all(folder).unwrap();
    }
}

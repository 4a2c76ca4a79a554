//! A terminal that is narrower than 80 columns: both programs ask it for its width, and break sentences and help for it.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::fs::File;
use std::io::Read;
use std::os::unix::fs::OpenOptionsExt;
use std::process::Command;

use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::Winsize;
use tests::program;

/// Lines that a command writes on a terminal of so many columns, standard error among them.
fn said(columns: u16, name: &str, arguments: &[&str]) -> Vec<String> {
    let other_end = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&other_end).unwrap();
    unlockpt(&other_end).unwrap();
    let path = ptsname(&other_end, Vec::new()).unwrap().into_string().unwrap();
    // No controlling terminal of this test, or its end would end the test.
    let flags = i32::try_from(OpenptFlags::NOCTTY.bits()).unwrap();
    let terminal = File::options().read(true).write(true).custom_flags(flags).open(path).unwrap();
    let size = Winsize { ws_row: 24, ws_col: columns, ws_xpixel: 0, ws_ypixel: 0 };
    rustix::termios::tcsetwinsize(&terminal, size).unwrap();
    let mut command = Command::new(program(name));
    command.args(arguments).env_remove("COLUMNS").stdin(std::process::Stdio::null());
    command.stdout(terminal.try_clone().unwrap()).stderr(terminal);
    let reader = std::thread::spawn(move || {
        let (mut text, mut other_end) = (Vec::new(), File::from(other_end));
        let mut piece = [0; 4096];
        // A terminal whose other side has gone ends with an error.
        while let Ok(read @ 1..) = other_end.read(&mut piece) {
            text.extend_from_slice(&piece[..read]);
        }
        String::from_utf8(text).unwrap()
    });
    command.status().unwrap();
    // With the command its ends of the terminal go.
    drop(command);
    reader.join().unwrap().lines().map(|line| line.trim_end().to_owned()).collect()
}

/// Text that a command writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Said {
    /// Long enough to use the width there is.
    Help,
    Message,
}

#[test]
fn help_and_messages_fit_the_terminal() {
    for (name, arguments, what) in [
        ("trainer", &["--help"][..], Said::Help),
        ("trainer", &["diagnose", "--help"], Said::Help),
        ("trainer", &["train", "--help"], Said::Help),
        ("controller", &["--help"], Said::Help),
        ("controller", &["demo", "--help"], Said::Help),
        (
            "trainer",
            &["validate", "--rig", "dual_pressure", "/nowhere/a_recording_that_is_not_there.csv"],
            Said::Message,
        ),
        ("controller", &["check", "--config", "/nowhere/a_configuration_that_is_not_there.toml"], Said::Message),
    ] {
        for columns in [60, 80] {
            let lines = said(columns, name, arguments);
            assert!(
                lines.len() > 1 || columns > 60,
                "{name} {arguments:?} says something, in several lines: {lines:?}"
            );
            for line in &lines {
                // A word that is longer than what is left of a line beside it stays whole.
                let longest = line.split(' ').map(|word| word.chars().count()).max().unwrap_or(0);
                let (columns, width) = (usize::from(columns), line.chars().count());
                assert!(
                    width <= columns || width <= columns / 2 + longest,
                    "{columns}: {width} in `{line}` of {name} {arguments:?}"
                );
            }
            let widest = lines.iter().map(|line| line.chars().count()).max().unwrap_or(0);
            if what == Said::Help {
                assert!(widest > usize::from(columns) - 8, "{columns} are used: {widest}");
            }
        }
    }
}

/// Text of a manual page's line, without the marks that its language needs.
fn unmarked(line: &str) -> String {
    line.replace("\\-", "-").replace("\\'", "'").replace("\\\\", "\\")
}

/// Help of the command that a manual page is about.
fn help_of(name: &str, words: &str) -> String {
    let help = |arguments: &[&str]| {
        let output = Command::new(program(name)).args(arguments).arg("--help").output().unwrap();
        output.status.success().then(|| String::from_utf8(output.stdout).unwrap())
    };
    let whole = if words.is_empty() { help(&[]) } else { help(&[words]) };
    // A command of a command: `evaluate-loads`.
    whole.or_else(|| words.split_once('-').and_then(|(first, rest)| help(&[first, rest]))).unwrap()
}

#[test]
fn examples_can_be_pasted_from_help_and_from_manual_pages() {
    const WIDEST: usize = 78;
    for name in ["controller", "trainer"] {
        let folder = tests::Folder::new();
        assert!(Command::new(program(name)).arg("generate").arg(folder.join("")).status().unwrap().success());
        let mut examples = 0;
        for page in std::fs::read_dir(folder.join("man1")).unwrap() {
            let page = page.unwrap().path();
            let about = page.file_stem().unwrap().to_str().unwrap().strip_prefix(name).unwrap().trim_start_matches('-');
            if about == "generate" {
                continue;
            }
            let text = std::fs::read_to_string(&page).unwrap();
            assert!(
                !["Example:", "Examples:"].iter().any(|word| text.contains(&format!("EXAMPLES\n{word}"))),
                "{text}"
            );
            let help = help_of(name, about);
            let told: Vec<&str> = help
                .split_once("\nExample")
                .map(|(_, examples)| examples.lines().skip(1).filter(|line| line.starts_with("  ")).collect())
                .unwrap_or_default();
            let unfilled: Vec<String> = text
                .split("\n.nf\n")
                .skip(1)
                .flat_map(|behind| behind.split("\n.fi").next().unwrap().lines())
                .map(unmarked)
                .collect();
            assert_eq!(told, unfilled, "{name} {about}");
            for line in &told {
                assert!(line.chars().count() <= WIDEST, "{name} {about}: {line}");
            }
            examples += told.len();
        }
        assert!(examples > 5, "{name}: {examples}");
    }
}

//! Next step after a diagnosis, as lines for a shell.

use std::path::{Path, PathBuf};

use model::rig::{ATMOSPHERE, Line, Rig};
use proto::diagnosis::{NextStep, RigKind, Verdict};
use proto::recording::Recording;

use crate::event::other_rig::OtherRig;
use crate::experiment::drives;
use crate::report::files::NEXT_EXPERIMENT;
use crate::run::Request;

/// Facts that the next step depends on.
pub(crate) struct Situation<'a> {
    pub(crate) request: &'a Request,
    pub(crate) verdict: Verdict,
    pub(crate) kind: RigKind,
    /// True where an experiment was planned.
    pub(crate) planned: bool,
    /// Names that the recordings do not tell apart, as `id:where`.
    pub(crate) groups: &'a [Vec<String>],
    /// True where the rig that was written is a part of the truth at most: much of it is left unexplained, or a parameter went
    /// where nobody would believe it.
    pub(crate) in_part: bool,
    /// Files that were recorded of another rig.
    pub(crate) other_rig: Option<&'a OtherRig>,
    /// Levels of a command that no recording came down to, in words.
    pub(crate) extrapolated: &'a [String],
    /// Parameters that would explain better what the rig as given leaves.
    pub(crate) parameters: Parameters,
}

/// Parameters of the given rig, where nothing is missing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Parameters {
    /// As good as fitted ones.
    AsGood,
    /// A little worse than fitted ones.
    ALittleOff,
}

/// The next step.
pub(crate) fn next_step(situation: &Situation<'_>) -> NextStep {
    let Situation { request, verdict, kind, planned, groups, in_part, other_rig, extrapolated, parameters } = situation;
    let rig_toml = shell(&request.out_dir.join("rig.toml").display().to_string());
    let of = |sources: &[&str], more: &str, out: &str| {
        format!("trainer diagnose --rig {} {}{more} --out {out}", shell(&request.rig_argument), named(sources))
    };
    let is_other = |source: &str| other_rig.is_some_and(|other| other.is_other(source));
    let sources: Vec<&str> =
        request.recordings.iter().map(Recording::source).filter(|source| !is_other(source)).collect();
    let again = |more: &str, out: &str| of(&sources, more, out);
    let step = |why: &str, commands: Vec<String>| NextStep { why: why.to_owned(), commands };
    let next_to_out = |ending: &str| shell(&named_after(&request.out_dir, ending).display().to_string());
    let next_out = next_to_out("2");
    if let (Verdict::Adequate, Some(other)) = (verdict, other_rig) {
        let each = other.differing.iter().enumerate().map(|(at, file)| {
            let out = next_to_out(&(at + 2).to_string());
            of(&[&file.source], WITH_THE_SAME, &out)
        });
        return step(
            "Diagnose each recording of another rig by itself: nothing needs to be done for the others.",
            each.collect(),
        );
    }
    match verdict {
        Verdict::Adequate if *parameters == Parameters::ALittleOff => {
            let out = next_to_out("fitted.toml");
            step(
                "Nothing needs to be done, unless what fitted parameters set right matters: then take these.",
                vec![format!(
                    "trainer identify --rig {} {} --out {out}",
                    shell(&request.rig_argument),
                    named(&sources)
                )],
            )
        }
        Verdict::Adequate => step(
            "Nothing needs to be done: nothing known explains these recordings better than the rig file.",
            Vec::new(),
        ),
        Verdict::Undecided if *planned && !drives(&request.rig) => step(
            "Play the commands of the proposed experiment once on the rig, with what you drive it with, record as before, then ask again \
             with that recording beside the others.",
            vec![again(WITH_ANOTHER, &next_out)],
        ),
        Verdict::Undecided if *planned => step(
            "Play the proposed experiment once on the rig, then ask again with its recording beside the others.",
            vec![
                format!(
                    "controller experiment {} --config controller.toml --out experiment.mcap",
                    shell(&request.out_dir.join(NEXT_EXPERIMENT).display().to_string())
                ),
                again(" experiment.mcap", &next_out),
            ],
        ),
        Verdict::Undecided => {
            let (why, more) = what_would_tell(&request.rig, groups);
            step(&why, vec![again(more, &next_out)])
        }
        Verdict::UnknownMechanism if request.quick => {
            step("Look again with the whole search, which takes a few minutes.", vec![again(WITH_THE_SAME, &next_out)])
        }
        Verdict::UnknownMechanism if *kind == RigKind::AsGiven => step(
            "Look in report.html at where and when the model is off, and record more of that operating region.",
            vec![again(WITH_ANOTHER, &next_out)],
        ),
        _ if *in_part && request.quick => step(
            "What was found is a part of the truth: look again with the whole search, which takes a few minutes.",
            vec![again(WITH_THE_SAME, &next_out)],
        ),
        _ if *in_part => step(
            "What was found is a part of the truth: look in report.html at where and when the model is off, and record more of that \
             operating region.",
            vec![again(WITH_ANOTHER, &next_out)],
        ),
        _ if !extrapolated.is_empty() => step(&extrapolated.join(" "), vec![again(WITH_ANOTHER, &next_out)]),
        _ if drives(&request.rig) => step(
            "Give a running daemon this model (or name the file under [rig] in its configuration).",
            vec![format!("controller model {rig_toml}")],
        ),
        _ => step(
            "Check the rig file on a recording that nothing was fitted to.",
            vec![format!("trainer validate --rig {rig_toml} new_recording.csv")],
        ),
    }
}

/// Recording that a command to ask again names where one is advised, and nothing where no recording would tell.
const WITH_ANOTHER: &str = " new_recording.csv";
const WITH_THE_SAME: &str = "";

/// Advice on what would tell rivals apart where no experiment can be planned: a recording that this rig can make, or a measurement. And
/// what a command to ask again has beside the recordings that there are.
fn what_would_tell(rig: &Rig, groups: &[Vec<String>]) -> (String, &'static str) {
    let among = |id: &str| groups.iter().flatten().any(|name| name.starts_with(id));
    let leaks = among("chamber_leak") || among("cross_leak") || among("piston_blowby");
    if among("sensor_drift") && among("chamber_leak") {
        let why = "End a recording with the chamber open to the air for 10 s: a sensor that drifted then reads off zero, and a leak leaves \
                   no trace.";
        (why.to_owned(), WITH_ANOTHER)
    } else if leaks && stays_shut(rig) {
        (format!("Add a pressure-decay (leak) test: 15 s with {}.", at_rest(rig)), WITH_ANOTHER)
    } else if leaks || among("parameters_moved") {
        let why = "Measure one volume, flow or resistance of the rig by other means, state it in the rig file, and ask again: recordings of \
                   pressures show only ratios of these, so that no further one would tell.";
        (why.to_owned(), WITH_THE_SAME)
    } else {
        let why = "Add a recording that uses the whole operating range: commands that step and sweep from one end to the other.";
        (why.to_owned(), WITH_ANOTHER)
    }
}

/// Tells whether gas stays in the rig's chambers where nothing is driven: a line to the open air that is in the rig file anyway
/// lets it out beside any leak.
fn stays_shut(rig: &Rig) -> bool {
    rig.lines.values().all(|line| {
        let (Line::Orifice { from, to, .. } | Line::Laminar { from, to, .. }) = line;
        from != ATMOSPHERE && to != ATMOSPHERE
    })
}

/// A rig at rest, by what it has: `the pump off and everything shut`.
fn at_rest(rig: &Rig) -> &'static str {
    match (rig.pumps.is_empty(), rig.valves.is_empty()) {
        (false, false) => "the pump off and everything shut",
        (false, true) => "the pump off",
        (true, false) => "everything shut",
        (true, true) => "a pressure in it and nothing that flows in or out",
    }
}

/// Path beside a folder, called after it: `found_2` beside `found`, and `2` inside of one that is given by no name of its own, as `.` is.
fn named_after(folder: &Path, ending: &str) -> PathBuf {
    match folder.file_name() {
        Some(name) => {
            let mut name = name.to_owned();
            name.push("_");
            name.push(ending);
            folder.with_file_name(name)
        }
        None => folder.join(ending),
    }
}

/// Recordings as arguments for a shell. One that a daemon still writes loses `.partial` when it ends, which may be before a command is
/// pasted.
fn named(sources: &[&str]) -> String {
    let at_its_end = |source: &&str| match source.strip_suffix(".partial.mcap") {
        Some(stem) => shell(&format!("{stem}.mcap")),
        None => shell(source),
    };
    sources.iter().map(at_its_end).collect::<Vec<_>>().join(" ")
}

/// A word for a POSIX shell.
fn shell(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "_-./:=+@%,".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(rig: Rig) -> Request {
        Request {
            rig,
            rig_argument: "my rig.toml".to_owned(),
            recordings: Vec::new(),
            out_dir: "found".into(),
            quick: true,
        }
    }

    fn next(request: &Request, verdict: Verdict, planned: bool, groups: &[Vec<String>]) -> NextStep {
        next_step(&Situation {
            request,
            verdict,
            kind: RigKind::Extended,
            planned,
            groups,
            in_part: false,
            other_rig: None,
            extrapolated: &[],
            parameters: Parameters::AsGood,
        })
    }

    /// Where fitted parameters explain what the given ones leave, the command that takes them is named.
    #[test]
    fn parameters_that_are_a_little_off_can_be_taken() {
        let request = request(Rig::builtin("dual_pressure").unwrap());
        let of = |parameters| {
            next_step(&Situation {
                request: &request,
                verdict: Verdict::Adequate,
                kind: RigKind::AsGiven,
                planned: false,
                groups: &[],
                in_part: false,
                other_rig: None,
                extrapolated: &[],
                parameters,
            })
        };
        assert!(of(Parameters::AsGood).commands.is_empty());
        let step = of(Parameters::ALittleOff);
        let [command] = &step.commands[..] else { panic!("{step:?}") };
        assert!(command.starts_with("trainer identify --rig 'my rig.toml'"), "{command}");
        assert!(command.ends_with("--out found_fitted.toml"), "{command}");
    }

    #[test]
    fn a_part_of_the_truth_is_not_given_to_the_daemon() {
        let mut request = request(Rig::builtin("dual_pressure").unwrap());
        let at_hand = |request: &Request| {
            let (verdict, kind) = (Verdict::MissingPhysics, RigKind::Extended);
            next_step(&Situation {
                request,
                verdict,
                kind,
                planned: false,
                groups: &[],
                in_part: true,
                other_rig: None,
                extrapolated: &[],
                parameters: Parameters::AsGood,
            })
        };
        let step = at_hand(&request);
        assert!(step.commands[0].starts_with("trainer diagnose") && !step.commands[0].contains("--quick"), "{step:?}");
        request.quick = false;
        let step = at_hand(&request);
        assert!(step.commands[0].contains("new_recording.csv"), "{step:?}");
    }

    #[test]
    fn an_undecided_answer_is_followed_by_its_experiment_and_the_question_again() {
        let request = request(Rig::builtin("dual_pressure").unwrap());
        let step = next(&request, Verdict::Undecided, true, &[]);
        assert_eq!(step.commands.len(), 2);
        assert!(step.commands[0].starts_with("controller experiment found/next_experiment.csv --config"));
        assert!(step.commands[1].contains("--rig 'my rig.toml'") && step.commands[1].contains("experiment.mcap"));
        assert_eq!(next(&request, Verdict::MissingPhysics, false, &[]).commands, ["controller model found/rig.toml"]);
    }

    #[test]
    fn a_rig_without_commands_is_told_which_recording_would_tell() {
        let mut rig = Rig::builtin("dual_pressure").unwrap();
        rig.valves.clear();
        let groups = [vec!["sensor_drift:chamber".to_owned(), "chamber_leak:chamber".to_owned()]];
        let step = next(&request(rig), Verdict::Undecided, false, &groups);
        assert!(step.why.contains("open to the air"), "{}", step.why);
    }

    #[test]
    fn what_would_tell_is_something_that_the_rig_can_do() {
        let mut rig = Rig::builtin("dual_pressure").unwrap();
        let leak = [vec!["chamber_leak:cell".to_owned(), "sensor_bias:cell".to_owned()]];
        assert!(what_would_tell(&rig, &leak).0.contains("the pump off and everything shut"));
        rig.pumps.clear();
        assert!(what_would_tell(&rig, &leak).0.contains("15 s with everything shut"));
        rig.valves.clear();
        assert!(!what_would_tell(&rig, &leak).0.contains("pump"));
        let ratios = [vec!["parameters_moved".to_owned(), "pump_droop:p".to_owned()]];
        let (said, more) = what_would_tell(&rig, &ratios);
        assert!(said.contains("Measure one volume") && !said.contains("range"), "{said}");
        // What no further recording would tell is not asked again with one.
        let command = &next(&request(rig), Verdict::Undecided, false, &ratios).commands[0];
        assert!(more.is_empty() && !command.contains("new_recording"), "{command}");
    }

    #[test]
    fn an_experiment_for_a_rig_that_the_daemon_does_not_drive_is_played_by_its_owner() {
        let mut rig = Rig::builtin("dual_pressure").unwrap();
        rig.valves.clear();
        let step = next(&request(rig), Verdict::Undecided, true, &[]);
        assert!(step.commands.len() == 1 && !step.commands[0].contains("controller"), "{step:?}");
    }

    /// A slash behind a folder, or a folder without a name of its own, makes no name that nobody meant.
    #[test]
    fn what_comes_next_is_named_after_the_folder() {
        let out = |folder: &str| {
            let request = Request { out_dir: folder.into(), ..request(Rig::builtin("dual_pressure").unwrap()) };
            let command = next(&request, Verdict::UnknownMechanism, false, &[]).commands.remove(0);
            let beside = named_after(Path::new(folder), "fitted.toml").display().to_string();
            [command.rsplit_once(" --out ").unwrap().1.to_owned(), beside]
        };
        for folder in ["found", "found/", "found/."] {
            assert_eq!(out(folder), ["found_2", "found_fitted.toml"], "{folder}");
        }
        assert_eq!(out("a/found/"), ["a/found_2", "a/found_fitted.toml"]);
        assert_eq!(out("."), ["./2", "./fitted.toml"]);
        assert_eq!(out("../.."), ["../../2", "../../fitted.toml"]);
    }

    /// A recording that a daemon still writes is called otherwise once it ends.
    #[test]
    fn a_recording_is_named_as_it_is_called_at_its_end() {
        let time_s = (0..3).map(|row| 0.02 * f64::from(row)).collect();
        let recording = Recording::new("runs/run 1.partial.mcap", time_s, Vec::new()).unwrap();
        let rig = Rig::builtin("dual_pressure").unwrap();
        let request = Request { recordings: vec![recording], ..request(rig) };
        let command = next(&request, Verdict::UnknownMechanism, false, &[]).commands.remove(0);
        assert!(command.contains(" 'runs/run 1.mcap' --out "), "{command}");
    }

    #[test]
    fn words_are_quoted_for_a_shell() {
        assert_eq!(shell("a/b-1.csv"), "a/b-1.csv");
        assert_eq!(shell("a b's"), r"'a b'\''s'");
    }
}

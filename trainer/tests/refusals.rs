//! Wrong usage and bad input, end to end: status 2, one or two plain lines that name the place and the mend.

// What fails here fails the test, helper functions included.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod program;

use model::rig::Rig;
use program::{Folder, refused, run};

const HEADER: &str = "time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa";

/// Each bad file must be refused with these words by every command that reads recordings.
#[test]
fn bad_recordings_get_one_line_with_line_and_column() {
    let folder = Folder::new("bad-csv");
    let rows = |rows: &str| format!("{HEADER}\n0,1,1,0,0\n{rows}");
    let cases: [(&str, Vec<u8>, &str); 13] = [
        ("missing", b"time_s,u_pos,u_neg,p_pos_kpa\n0,1,1,0\n".to_vec(), "column p_neg_kpa is missing"),
        ("no_command", b"time_s,u_pos,p_pos_kpa,p_neg_kpa\n0,1,0,0\n".to_vec(), "line 1: column u_neg is missing"),
        ("no_time", b"u_pos,u_neg\n1,1\n".to_vec(), "line 1: column time_s is missing"),
        ("nan", rows("0.02,1,1,NaN,0\n").into(), "line 3, column 4 (p_pos_kpa): NaN is not a finite number"),
        ("text", rows("0.02,1,open,0,0\n").into(), "line 3, column 3 (u_neg): \"open\" is not a number"),
        ("back", rows("0.02,1,1,0,0\n0.01,1,1,0,0\n").into(), "line 4, column 1 (time_s): 0.01 s does not come after"),
        ("ragged", rows("0.02,1,1,0\n").into(), "line 3: 4 cells where the header has 5 columns"),
        ("empty", Vec::new(), "the file is empty"),
        ("only_header", format!("{HEADER}\n").into(), "no row of data"),
        ("percent", rows("0.02,85,1,0,0\n").into(), "line 3, column 2 (u_pos): 85 is outside 0 … 1"),
        ("ms", format!("{HEADER}\n0,1,1,0,0\n20,1,1,0,0\n40,1,1,0,0\n").into(), "milliseconds"),
        ("semicolons", HEADER.replace(',', ";").into(), "no row of data"),
        ("binary", vec![0x89, b'P', 0xFF, 0xFE, b'\n', 0, 1], "a binary file of a kind that is not read"),
    ];
    for (name, bytes, words) in cases {
        let path = folder.with(&format!("{name}.csv"), bytes);
        let out = folder.path("out.csv");
        let simulated = refused(["simulate", "--inputs", &path, "--out", &out]);
        assert!(simulated.starts_with(&format!("trainer: {path}: ")) && simulated.contains(words), "{simulated}");
        assert_eq!(simulated.lines().count(), 1, "{simulated}");
        assert!(!std::path::Path::new(&out).exists(), "{name} left a file");
        assert_eq!(refused(["validate", &path]), simulated, "{name}");
    }
}

/// Places that nothing can be written to are told before the work; below a file nobody can make one, whatever his rights.
#[test]
fn results_that_have_no_place_are_refused_before_the_work() {
    let folder = Folder::new("no-place");
    let rows: String = (0..3).map(|k| format!("{},1,1,0,0\n", 0.02 * f64::from(k))).collect();
    let inputs = folder.with("in.csv", format!("{HEADER}\n{rows}"));
    let below = format!("{inputs}/below");
    for args in [
        vec!["simulate", "--inputs", &inputs, "--out", &below],
        vec!["train", "--steps", "1000000", "--out", &below],
        vec!["diagnose", &inputs, "--out", &below],
        vec!["identify", &inputs, "--out", &below],
    ] {
        let said = refused(args.as_slice());
        assert!(said.contains("below: nothing can be written here"), "{args:?}: {said}");
    }
    assert_eq!(std::fs::read_dir(folder.path("")).unwrap().count(), 1, "nothing is left");
}

/// Settings that a run which is gone on with cannot honour are refused, and not passed over in silence.
#[test]
fn a_run_that_is_gone_on_with_takes_no_other_settings() {
    for (command, options) in [
        (
            "train",
            vec![["--seed", "2"], ["--variant", "raw"], ["--rig", "bench"], ["--config", "paper"], ["--out", "x"]],
        ),
        ("finetune", vec![["--seed", "2"], ["--updates-per-tick", "4"], ["--out", "x"]]),
        ("adapt", vec![["--seed", "2"], ["--train-rounds", "5"], ["--run-seconds", "30"], ["--out", "x"]]),
    ] {
        for option in options {
            let said = refused([command, "--resume", "nowhere", option[0], option[1]]);
            assert!(said.contains("--resume") && said.contains(option[0]), "{command} {option:?}: {said}");
        }
    }
}

/// A command that begins from any policy names every kind of file that it takes where one is not there.
#[test]
fn a_policy_that_is_not_there_is_told_with_what_would_do() {
    let folder = Folder::new("no-policy");
    let (here, out) = (folder.path(""), folder.path("out"));
    let said = refused(["finetune", "--recordings", &here, "--publish", &here, "--from", "nowhere", "--out", &out]);
    assert!(said.contains("nowhere: cannot be read") && said.contains("an ONNX file"), "{said}");
    assert!(!std::path::Path::new(&out).exists(), "nothing is left behind");
}

#[test]
fn gaps_without_pressures_cannot_be_started_anew() {
    let folder = Folder::new("bad-gap");
    let text: String =
        (0..8).map(|k| format!("{},1,1\n", 0.02 * f64::from(k) + if k > 4 { 1.0 } else { 0.0 })).collect();
    let path = folder.with("gap.csv", format!("time_s,u_pos,u_neg\n{text}"));
    let said = refused(["simulate", "--inputs", &path, "--out", &folder.path("out.csv")]);
    assert!(said.contains("a gap before 1.1 s and no pressures"), "{said}");
}

#[test]
fn bad_rigs_get_one_line_with_line_and_key() {
    let folder = Folder::new("bad-rig");
    let recording = folder.with("in.csv", format!("{HEADER}\n0,1,1,0,0\n0.02,1,1,0,0\n0.04,1,1,0,0\n"));
    let paper = model::rig::DUAL_PRESSURE;
    let cases = [
        (paper.replace("volume_l = 0.75", "volume_l = -0.75"), "volumes.positive.volume_l: -0.75 L"),
        (paper.replace("volume_l = 0.75", "volume_ml = 750.0"), "volume_ml"),
        (paper.replace("volume_l = 0.75", "volume_l = "), "volumes.positive"),
        (paper.replace("from = \"positive\"", "from = \"positve\""), "`positve` joins nothing"),
        (String::new(), "missing field"),
    ];
    for (index, (text, words)) in cases.into_iter().enumerate() {
        let rig = folder.with(&format!("{index}.toml"), text);
        let said = refused(["validate", "--rig", &rig, &recording]);
        assert!(said.starts_with(&format!("trainer: {rig}: line ")) && said.contains(words), "{said}");
        assert_eq!(said.lines().count(), 1, "{said}");
        assert_eq!(refused(["rig", "--listen", "127.0.0.1:0", "--rig", &rig]), said);
    }
    // Sound by themselves, and of no use here.
    let slow = folder.with("slow.toml", paper.replace("tick_ms = 20.0", "tick_ms = 30.0"));
    let out = folder.path("out");
    for command in [
        vec!["validate", "--rig", &slow, &recording],
        vec!["simulate", "--rig", &slow, "--inputs", &recording, "--out", &out],
        vec!["identify", "--rig", &slow, &recording, "--out", &out],
        vec!["diagnose", "--rig", &slow, &recording, "--out", &out],
    ] {
        let said = refused(command.as_slice());
        assert!(said.contains(&format!("{slow}: integrator.tick_ms: rows are 20 ms apart")), "{command:?}: {said}");
    }
    let quick = folder.with("quick.toml", paper.replace("tick_ms = 20.0", "tick_ms = 10.0"));
    assert_eq!(run(["validate", "--rig", &quick, &recording]).status, 0);
    let said = refused(["rig", "--listen", "127.0.0.1:0", "--rig", &quick]);
    assert!(said.contains(": integrator.tick_ms: a tick of 10 ms"), "{said}");
    let blind = folder.with("blind.toml", paper.replace("column = \"p_neg_kpa\"", "column = \"vacuum_kpa\""));
    assert!(refused(["rig", "--listen", "127.0.0.1:0", "--rig", &blind]).contains("p_neg_kpa"));
}

/// Before anything is run, with the file, the option that named it, and the key: a loop over such a rig would learn on another clock.
#[test]
fn a_rig_that_no_loop_can_be_closed_over_is_refused_by_file_option_and_key() {
    let folder = Folder::new("no-loop");
    let paper = model::rig::DUAL_PRESSURE;
    let quick = folder.with("quick.toml", paper.replace("tick_ms = 20.0", "tick_ms = 10.0"));
    let blind = folder.with("blind.toml", paper.replace("column = \"p_neg_kpa\"", "column = \"vacuum_kpa\""));
    let out = folder.path("out");
    for (bad, words) in
        [(&quick, "integrator.tick_ms: a tick of 10 ms; the cRIO samples every 20 ms"), (&blind, "p_neg_kpa")]
    {
        let commands: [(&[&str], &str); 8] = [
            (&["train", "--rig", bad], "--rig"),
            (&["train", "--model", bad], "--model"),
            (&["improve", "--rig", bad], "--rig"),
            (&["improve", "--model", bad], "--model"),
            (&["evaluate", "comparison", "--rig", bad], "--rig"),
            (&["evaluate", "comparison", "--model", bad], "--model"),
            (&["evaluate", "loads", "--rig", bad], "--rig"),
            (&["adapt", "--rehearse", "--rig", bad], ""),
        ];
        for (command, option) in commands {
            let said = refused([command, &["--out", &out]].concat());
            assert!(said.starts_with(&format!("trainer: {bad}")), "{command:?}: {said}");
            assert!(said.contains(words) && said.contains(option), "{command:?}: {said}");
            assert!(!std::path::Path::new(&out).exists(), "{command:?} left something");
        }
        let small = "[policy]\nhidden = [32, 32]\nfeatures = \"errors\"\n";
        let corrects = format!("{small}contract = 2\n[environment]\ncorrection_duty = 0.06\n");
        for (command, settings) in [("train", small), ("improve", corrects.as_str())] {
            let settings = folder.with("settings.toml", format!("{settings}[rig]\nevaluated_on = [\"{bad}\"]\n"));
            let said = refused([command, "--config", &settings, "--out", &out]);
            assert!(said.contains(&format!("{bad} (rig.evaluated_on): ")) && said.contains(words), "{command}: {said}");
        }
    }
}

#[test]
fn missing_files_are_named() {
    let folder = Folder::new("missing-file");
    let (none, out) = (folder.path("none.csv"), folder.path("out.csv"));
    assert!(refused(["simulate", "--inputs", &none, "--out", &out]).contains(&format!("{none}: cannot read")));
    let said = refused(["validate", "--rig", "benhc", &none]);
    assert!(said.contains("benhc: there is neither a file nor a built-in rig of that name"), "{said}");
    assert!(said.contains("dual_pressure, bench"), "{said}");
    let (recordings, nowhere) = (folder.path(""), folder.path("nowhere"));
    let finetune = |recordings: &str, publish: &str| {
        refused(["finetune", "--recordings", recordings, "--from", &none, "--publish", publish, "--out", &out])
    };
    assert!(
        finetune(&nowhere, &recordings).contains("nowhere: is no folder; give the one that the daemon records into")
    );
    assert!(finetune(&recordings, &nowhere).contains("nowhere: is no folder; make it, or give the one"));
    let said = refused(["rig", "--listen", "127.0.0.1:0", "--faults", &folder.path("none.toml")]);
    assert!(said.contains("none.toml: cannot read the fault script"), "{said}");
    let faults = folder.with("faults.toml", "[[fault]]\nkind = \"lose\"\nframe = \"sense\"\n");
    let said = refused(["rig", "--listen", "127.0.0.1:0", "--faults", &faults]);
    assert!(said.contains(&format!("{faults}:1: fault 1: key ")), "{said}");
}

#[test]
fn the_input_is_never_written_over() {
    let folder = Folder::new("over");
    let text = format!("{HEADER}\n0,1,1,0,0\n");
    let path = folder.with("run.csv", &text);
    let said = refused(["simulate", "--inputs", &path, "--out", &folder.path("./run.csv")]);
    assert!(said.contains("would be lost"), "{said}");
    assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
    // The rig that is fitted is somebody's own file, with comments and parts that a fit does not write.
    let rig = folder.with("rig.toml", Rig::builtin("dual_pressure").unwrap().to_toml().unwrap());
    let before = std::fs::read_to_string(&rig).unwrap();
    let said = refused(["identify", "--rig", &rig, &path, "--out", &folder.path("./rig.toml")]);
    assert!(said.contains("the rig file that is read, which would be lost"), "{said}");
    assert_eq!(std::fs::read_to_string(rig).unwrap(), before);
}

/// Errors of a run that ends before it can leave its start are 0, and mean nothing.
#[test]
fn a_recording_too_short_to_tell_anything_is_no_perfect_fit() {
    let folder = Folder::new("short");
    let path = folder.with("run.csv", format!("{HEADER}\n0,1,1,0,0\n0.02,1,1,0,0\n"));
    let said = refused(["validate", &path]);
    assert!(said.contains("run.csv: 2 of at least 3 rows") && said.contains("times in seconds?"), "{said}");
}

#[test]
fn a_file_whose_folder_is_not_there_is_refused_before_the_work() {
    let folder = Folder::new("no-folder");
    let path = folder.with("run.csv", format!("{HEADER}\n0,1,1,0,0\n"));
    let said = run(["simulate", "--inputs", &path, "--out", &folder.path("nowhere/out.csv")]);
    assert_eq!((said.status, said.err.lines().count()), (2, 1), "{}", said.err);
    assert!(said.err.contains("nowhere is not there; make it"), "{}", said.err);
    // What is there and no file is written to, and stays what it is.
    let said = run(["simulate", "--inputs", &path, "--out", "/dev/full"]);
    assert_eq!(said.status, 1, "{}", said.err);
    assert!(!std::fs::metadata("/dev/full").unwrap().is_file());
}

#[test]
fn wrong_usage_is_told_in_two_lines() {
    let cases: [(&[&str], &str, &str); 10] = [
        (&["evaluate"], "no command given; there are comparison, ablation, loads, join", "see trainer evaluate --help"),
        (&[], "no command given; there are rig, simulate, identify, validate, diagnose, bench", "see trainer --help"),
        (&["simluate"], "unrecognized subcommand 'simluate'", "see trainer --help"),
        (&["simulate"], "--inputs <FILE>; --out <CSV>", "see trainer simulate --help"),
        (&["simulate", "--input", "x"], "unexpected argument '--input'", "see trainer simulate --help"),
        (&["validate"], "<RECORDING>...", "see trainer validate --help"),
        (
            &["validate", "--least-kpa", "far", "f"],
            "a pressure from 0 to 1000 kPa is meant",
            "see trainer validate --help",
        ),
        (&["bench", "--ticks", "0"], "invalid value '0' for '--ticks <N>'", "see trainer bench --help"),
        (&["rig", "--listen", "50500"], "HOST:PORT is meant", "see trainer rig --help"),
        (&["rig", "--pace", "fast"], "[possible values: real, lockstep]", "see trainer rig --help"),
    ];
    for (args, problem, mend) in cases {
        let said = refused(args);
        let lines: Vec<&str> = said.lines().collect();
        assert!(lines.len() == 2 && lines[0].contains(problem) && lines[1].contains(mend), "{said}");
    }
    // A name with a line end must not make more lines of the message.
    assert_eq!(refused(["validate", "no\nsuch\nfile.csv"]).lines().count(), 1);
}

#[test]
fn help_is_complete_and_on_standard_output() {
    for args in
        [&["--help"][..], &["rig", "--help"], &["simulate", "--help"], &["validate", "--help"], &["bench", "--help"]]
    {
        let said = run(args);
        assert_eq!((said.status, said.err.as_str()), (0, ""), "{args:?}");
        assert!(said.out.contains("Example") && said.out.contains("Usage: trainer"), "{}", said.out);
        for words in said.out.lines().filter(|line| line.trim_start().starts_with("--")) {
            assert!(words.len() > 4, "an option without a word on it: {words}");
        }
    }
    assert!(run(["--version"]).out.starts_with("trainer "));
}

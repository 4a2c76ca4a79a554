//! Fault scripts: the shipped example, and one clear line for each mistake.

// A test may stop at the first thing that is not as it must be; helpers here are part of tests.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::path::Path;

use proto::emulator::FaultScript;

#[test]
fn the_example_is_sound_and_shows_every_kind() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("faults.example.toml");
    let script = FaultScript::read(&path).unwrap();
    assert_eq!(script.len(), 13);
    let text = std::fs::read_to_string(&path).unwrap();
    for kind in ["lose", "delay", "corrupt", "repeat", "drop_link", "sensor", "trip"] {
        assert!(text.contains(&format!("kind = \"{kind}\"")), "{kind} is not shown");
    }
    for effect in ["broken_wire", "stuck", "nan", "reading", "offset"] {
        assert!(text.contains(&format!("effect = \"{effect}\"")), "{effect} is not shown");
    }
}

#[test]
fn an_empty_script_is_sound() {
    assert!(FaultScript::from_toml("", "empty.toml").unwrap().is_empty());
}

#[test]
fn every_mistake_gets_its_one_line() {
    let fault = |keys: &str| format!("seed = 1\n\n[[fault]]\n{keys}\n");
    let cases = [
        (fault("kind = \"loose\"\nticks = [1]"), "f.toml:4:8: unknown variant `loose`"),
        (fault("kind = \"lose\"\nframe = \"sense\"\ntick = [1]"), "f.toml:6:1: unknown field `tick`"),
        (fault("frame = \"sense\"\nticks = [1]"), "missing field `kind`"),
        (fault("kind = \"lose\"\nframe = \"sense\"\nticks = [-1]"), "f.toml:6:10: invalid value: integer `-1`"),
        (fault("kind = \"lose\"\nframe = sense"), "f.toml:5:"),
        ("sed = 3".to_owned(), "f.toml:1:1: unknown field `sed`"),
        (fault("kind = \"lose\"\nframe = \"sense\""), "f.toml:3: fault 1: key `ticks`: is missing"),
        (fault("kind = \"lose\"\nticks = [1]"), "fault 1: key `frame`: is missing"),
        (fault("kind = \"lose\"\nframe = \"sense\"\nticks = []"), "key `ticks`: is empty"),
        (fault("kind = \"lose\"\nframe = \"sense\"\nticks = [1]\nlast = 3"), "key `ticks`: cannot stand beside"),
        (fault("kind = \"lose\"\nframe = \"sense\"\nfirst = 5\nlast = 3"), "key `last`: is before first"),
        (fault("kind = \"lose\"\nframe = \"sense\"\nevery = 0"), "key `every`: must be at least 1"),
        (fault("kind = \"lose\"\nframe = \"sense\"\nprobability = 1.5"), "key `probability`: must be above 0"),
        (fault("kind = \"lose\"\nframe = \"sense\"\nprobability = nan"), "key `probability`: must be above 0"),
        (
            fault("kind = \"lose\"\nframe = \"sense\"\nfirst = 0\nby_ms = 3.0"),
            "key `by_ms`: does not go with this kind",
        ),
        (fault("kind = \"delay\"\nframe = \"sense\"\nfirst = 0"), "key `by_ms`: is missing"),
        (fault("kind = \"delay\"\nframe = \"sense\"\nfirst = 0\nby_ms = -1.0"), "key `by_ms`: must be from 0"),
        (fault("kind = \"delay\"\nframe = \"sense\"\nfirst = 0\nby_ms = inf"), "key `by_ms`: must be from 0"),
        (
            fault("kind = \"delay\"\nframe = \"sense\"\nfirst = 0\nby_ms = 1.0\nby_ticks = 1"),
            "key `by_ms`: cannot stand",
        ),
        (fault("kind = \"corrupt\"\nframe = \"command\"\nfirst = 0\nbyte = 44"), "key `byte`: is beyond the end"),
        (fault("kind = \"corrupt\"\nframe = \"command\"\nfirst = 0\nxor = 0"), "key `xor`: of 0 changes nothing"),
        (fault("kind = \"corrupt\"\nframe = \"command\"\nfirst = 0\nxor = 256"), "invalid value: integer `256`"),
        (fault("kind = \"repeat\"\nframe = \"command\"\nfirst = 0\ntimes = 0"), "key `times`: must be at least 1"),
        (fault("kind = \"drop_link\"\nticks = [1]\nrefuse_s = nan"), "key `refuse_s`: must be from 0"),
        (fault("kind = \"sensor\"\nticks = [1]"), "key `sensor`: is missing"),
        (fault("kind = \"sensor\"\nsensor = \"positive\"\nticks = [1]"), "key `effect`: is missing"),
        (fault("kind = \"sensor\"\nsensor = \"positive\"\neffect = \"offset\"\nticks = [1]"), "key `kpa`: is missing"),
        (
            fault("kind = \"sensor\"\nsensor = \"positive\"\neffect = \"offset\"\nkpa = nan\nticks = [1]"),
            "key `kpa`: must be a finite number",
        ),
        (
            fault("kind = \"sensor\"\nsensor = \"positive\"\neffect = \"nan\"\nkpa = 1.0\nticks = [1]"),
            "key `kpa`: goes with reading and offset only",
        ),
        (fault("kind = \"trip\"\nticks = [1]"), "key `reason`: is missing"),
        (
            fault("kind = \"trip\"\nreason = \"sensor\"\nticks = [1]\n\n[[fault]]\nkind = \"trip\"\nticks = [1]"),
            "f.toml:8: fault 2: key `reason`",
        ),
    ];
    for (toml, says) in cases {
        let error = FaultScript::from_toml(&toml, "f.toml").expect_err(&toml).to_string();
        assert!(!error.contains('\n'), "{error}");
        assert!(error.starts_with("f.toml:") && error.contains(says), "{error}\nfor\n{toml}");
    }
}

#[test]
fn a_missing_file_is_named() {
    let error = FaultScript::read(Path::new("no/such/file.toml")).unwrap_err().to_string();
    assert!(error.starts_with("no/such/file.toml: cannot read the fault script: "), "{error}");
}

//! `controller experiment` against the emulated cRIO, over TCP: what is played, what is recorded, what stops it.
//!
//! The emulator runs in the test, so that the rig's own truth can be laid beside the recording; where the
//! recording must serve a diagnosis, the cRIO is `trainer rig`, a process of its own.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod experiment_bench;

use std::process::Command;
use std::time::Duration;

use controller::config::Pacing;
use experiment_bench::{Bench, Set, paper};
use fit::data::quality::Quality;
use fit::data::{Records, noise};
use model::rig::Rig;
use proto::emulator::Pace;
use proto::recording::{McapContent, Recording, TickRecord, read_mcap};
use proto::wire::{CrioState, Frame};
use serde_json::Value;
use tests::Stream::Err;
use tests::laboratory::emulated_rig;
use tests::programme::{ProgrammeRow, csv, programme};
use tests::{Folder, RunStatus, Running, alone, finish, program};

/// Generous: how long anything may take on a machine that does other things as well.
const SOON: Duration = Duration::from_secs(60);

fn constant(rows: usize, duty: f64) -> String {
    csv(&vec![(duty, duty, 1); rows])
}

/// The ticks in which rows were played.
fn played(content: &McapContent) -> Vec<&TickRecord> {
    content.ticks.iter().filter(|tick| tick.mode == 1).collect()
}

/// The last line on standard error, after a failure with status 1.
fn aborted(ended: &RunStatus) -> String {
    aborted_with(1, ended)
}

/// The last line on standard error, after a failure with this status.
fn aborted_with(status: i32, ended: &RunStatus) -> String {
    assert_eq!(ended.status, Some(status), "{ended:?}");
    ended.stderr.lines().last().unwrap_or_default().to_owned()
}

/// Checks of every experiment that was cut short: the rows played are the file's first, then both vents are open
/// and stay open, and the recording says so and can be read.
fn check_kept(bench: &Bench, rows: &[ProgrammeRow], line: &str) -> McapContent {
    let path = bench.recording();
    assert!(line.contains("experiment aborted after") && line.contains(path.to_str().unwrap()), "{line}");
    let content = read_mcap(&path).unwrap();
    let run = played(&content);
    assert!(!run.is_empty() && run.len() < rows.len(), "{} of {}", run.len(), rows.len());
    for (tick, row) in run.iter().zip(rows) {
        assert_eq!(tick.command_before_filter, [row.0, row.1], "what is asked is the file's");
        // Only on the way to a limit is it bent, toward vent, and the recording says so.
        assert!(
            (tick.u_pos, tick.u_neg) == (row.0, row.1)
                || (tick.filter_active && tick.u_pos >= row.0 && tick.u_neg >= row.1)
        );
    }
    let last = run.last().unwrap().tick;
    let after = content.ticks.iter().filter(|tick| tick.tick > last);
    assert!(after.clone().all(|tick| (tick.u_pos, tick.u_neg, tick.pump_on, tick.mode) == (1.0, 1.0, false, 0)));
    let told = content.events.last().unwrap();
    assert!(told.message.starts_with(&format!("EXPERIMENT ABORTED after {} of {}", run.len(), rows.len())), "{told:?}");
    let recording = Recording::read(&path).unwrap();
    assert!(recording.notes().iter().any(|note| note.contains("EXPERIMENT ABORTED")), "{:?}", recording.notes());
    content
}

#[test]
fn rows_are_played_and_recorded_bit_for_bit() {
    let bench = Bench::new(Set::default());
    let rows = programme(500);
    let text = csv(&rows);
    let ended = finish(bench.command(&text).arg("--json"));
    assert_eq!(ended.status, Some(0), "{ended:?}");
    let result: Value = serde_json::from_str(&ended.stdout).unwrap();
    assert_eq!((&result["completed"], &result["aborted"]), (&true.into(), &Value::Null), "{result}");
    assert_eq!((&result["rows_played"], &result["played"]["not_applied"]), (&500.into(), &0.into()), "{result}");
    assert!(ended.stderr.contains("pump off in lines 202-251 (1.00 s)"), "{}", ended.stderr);

    let content = read_mcap(&bench.recording()).unwrap();
    let run = played(&content);
    let first = run[0].tick;
    assert_eq!(run.len(), rows.len());
    for (k, (tick, row)) in run.iter().zip(&rows).enumerate() {
        assert_eq!(
            (tick.tick, tick.u_pos, tick.u_neg, u8::from(tick.pump_on)),
            (first + k as u32, row.0, row.1, row.2)
        );
    }
    let attached = content.attachments.iter().find(|file| file.name == "experiment.csv").unwrap();
    assert_eq!(attached.data, text.as_bytes());

    // The convention of rows: reading at t_k, command in force from t_k to t_k+1; so the step that ends at edge k+1 was
    // driven by row k, and the reading of row k is what the sensors showed at edge k.
    let kept = Recording::read(&bench.recording()).unwrap();
    let seen = bench.close();
    let truth = |tick: u32| {
        seen.ticks
            .iter()
            .find(|truth| truth.session_tick.is_some_and(|(_, t)| t == tick))
            .expect("an edge of the session")
    };
    let [u_pos, u_neg, p_pos, p_neg, pump] =
        kept.require(["u_pos", "u_neg", "p_pos_kpa", "p_neg_kpa", "pump_on"]).unwrap();
    // A second of rest before the rows, and all that came after its beginning.
    let waited = content.ticks.iter().take_while(|tick| tick.tick < first).count();
    let from = waited.saturating_sub(50);
    assert_eq!((kept.rows(), kept.segments().len()), (content.ticks.len() - from, 1));
    for k in 0..kept.rows() - 1 {
        let (now, next) = (truth(content.ticks[from + k].tick), truth(content.ticks[from + k].tick + 1));
        assert_eq!(next.duty, [u_pos[k] as f32, u_neg[k] as f32], "row {k}");
        assert_eq!(f64::from(u8::from(next.pump_on)), pump[k], "row {k}");
        // The data sheets: 1 … 5 V for 0 … 1000 and 0 … −101 kPa; f64 rounds the 16-bit steps at 1e-12.
        let read = [(f64::from(now.volts[0]) - 1.0) * 250.0, (f64::from(now.volts[1]) - 1.0) * -25.25];
        assert!((p_pos[k] - read[0]).abs() < 1e-9 && (p_neg[k] - read[1]).abs() < 1e-9, "row {k}");
    }
    // It begins and ends at rest, and moved in between.
    let at = |tick: u32| truth(tick).pressures_kpa;
    assert!(at(first).iter().all(|kpa| kpa.abs() < 1.0), "{:?}", at(first));
    let end = at(content.ticks.last().unwrap().tick);
    assert!(end.iter().all(|kpa| kpa.abs() < 3.0), "{end:?}");
    assert!(p_pos.iter().fold(0.0_f64, |a, b| a.max(*b)) > 60.0);
    // The emulated rig is the model's: the forecast is what came, but for the converter's noise (0.3 kPa, five times).
    for c in 0..2 {
        for edge in 0..2 {
            let of = |value: &Value| value[c][edge].as_f64().unwrap();
            assert!((of(&result["forecast_kpa"]) - of(&result["played"]["range_kpa"])).abs() < 1.5, "{result}");
        }
    }
}

#[test]
fn a_rig_that_differs_from_its_model_is_stopped_at_the_limit() {
    // By the model well below the limit; with a clogged muffler behind the valve, far above.
    let rows = vec![(0.75, 0.85, 1); 1000];
    let rig = paper("[[mechanisms]]\nid = \"exhaust_restriction\"\ncomponent = \"valve_pos\"\narea_mm2 = 0.5\n");
    let bench = Bench::new(Set { rig, ..Set::default() });
    let line = aborted(&finish(&mut bench.command(&csv(&rows))));
    assert!(
        line.contains("kPa is above safety.max_pos_kpa") && line.contains("both vents were commanded open"),
        "{line}"
    );
    let content = check_kept(&bench, &rows, &line);
    let over = content.ticks.iter().find(|tick| tick.p_pos_kpa > 160.0).unwrap();
    assert_eq!((over.fault, over.u_pos, over.u_neg, over.mode), (4, 1.0, 1.0, 0), "vented in the tick of the reading");
    let end = content.ticks.last().unwrap();
    // A pressure limit waits for a person; the vents stay open meanwhile.
    assert!(end.p_pos_kpa.abs() < 3.0 && end.mode == 0, "at rest again: {} kPa", end.p_pos_kpa);
    assert_eq!(bench.close().sessions, 1);
}

#[test]
fn a_lost_link_and_a_broken_sensor_end_it_and_nothing_is_tried_again() {
    let rows = programme(600);
    for (faults, words, last_fault) in [
        ("[[fault]]\nkind = \"drop_link\"\nticks = [300]\n", "the link to the cRIO is lost", None),
        (
            "[[fault]]\nkind = \"sensor\"\nsensor = \"negative\"\neffect = \"broken_wire\"\nfirst = 300\nlast = 301\n",
            "the negative sensor reads 0.0",
            Some(3),
        ),
        (
            "[[fault]]\nkind = \"trip\"\nreason = \"operator_stop\"\nticks = [300]\n",
            "the cRIO tripped (operator",
            Some(6),
        ),
    ] {
        let bench = Bench::new(Set { faults, ..Set::default() });
        let line = aborted(&finish(&mut bench.command(&csv(&rows))));
        assert!(line.contains(words), "{line}");
        let content = check_kept(&bench, &rows, &line);
        let fault = content.ticks.iter().map(|tick| tick.fault).find(|fault| *fault != 0);
        assert_eq!(fault, last_fault, "{words}");
        let seen = bench.close();
        assert_eq!(seen.sessions, 1, "{words}");
        // Without a link, or tripped, the session is over and plant time stands still; with one the vents were open.
        if last_fault == Some(3) {
            assert_eq!(seen.ticks.last().unwrap().duty, [1.0, 1.0], "{words}");
        }
    }
}

#[test]
fn one_lost_frame_costs_a_reading_and_not_the_experiment() {
    let _alone = alone();
    // A busy machine may begin to play as late as tick 250, a fast one before tick 100: 300 is of the experiment either way.
    let rows = programme(300);
    let faults = "[[fault]]\nkind = \"lose\"\nframe = \"sense\"\nticks = [300]\n";
    let bench = Bench::new(Set { faults, pace: Pace::RealTime, ..Set::default() });
    let ended = finish(bench.command(&csv(&rows)).arg("--json"));
    let result: Value = serde_json::from_str(&ended.stdout).unwrap();
    // A busy machine may lose more than this one; two in a row would end it.
    if result["completed"] == false {
        let stalls = ["no frame for", "got no command", "deadlines missed"];
        assert!(stalls.iter().any(|stall| ended.stderr.contains(stall)), "{ended:?}");
        println!("SKIPPED: this machine stalled for two ticks");
        return;
    }
    assert!(result["played"]["without_reading"].as_u64().unwrap() >= 1, "{result}");
    let content = read_mcap(&bench.recording()).unwrap();
    let run = played(&content);
    let first = run[0].tick;
    for tick in run {
        let row = rows[(tick.tick - first) as usize];
        assert_eq!((tick.u_pos, tick.u_neg), (row.0, row.1), "tick {}", tick.tick);
    }
}

#[test]
fn ctrl_c_and_sigterm_open_the_vents_and_keep_the_recording() {
    let rows = programme(3000);
    for (signal, status) in [("INT", 130), ("TERM", 143)] {
        let bench = Bench::new(Set { unhurried: true, ..Set::default() });
        let running = Running::start(&mut bench.command(&csv(&rows)));
        running.line(Err, "the first row is played", SOON);
        running.signal(signal);
        let line = aborted_with(status, &running.wait(SOON));
        assert!(line.contains("stopped by hand"), "{line}");
        check_kept(&bench, &rows, &line);
        // The BYE has ended the session, and with it every command but open vents.
        let seen = bench.close();
        assert!(seen.said_bye && seen.sessions == 1, "{signal}");
    }
}

#[test]
fn the_operator_may_look_and_stop_and_nothing_else() {
    let rows = programme(6000);
    let bench = Bench::new(Set { unhurried: true, ..Set::default() });
    let running = Running::start(&mut bench.command(&csv(&rows)));
    running.line(Err, "the first row is played", SOON);
    let ask =
        |question: &str| finish(Command::new(program("controller")).args([question, "--config"]).arg(&bench.config));
    let status = ask("status");
    assert!(status.stdout.contains("run"), "{status:?}");
    let refused = ask("arm");
    assert!(refused.status == Some(1) && refused.stderr.contains("an experiment is under way"), "{refused:?}");
    // Neither the daemon nor a second experiment comes in between.
    for second in [["run", "--config"], ["experiment", bench.folder.join("e.csv").to_str().unwrap()]] {
        let mut command = Command::new(program("controller"));
        command.args(second);
        if second[0] == "experiment" {
            command.arg("--config");
        }
        let ended = finish(command.arg(&bench.config));
        let why = if second[0] == "run" { "another controller answers" } else { "an experiment is under way" };
        assert!(ended.status == Some(1) && ended.stderr.contains(why), "{ended:?}");
    }
    assert_eq!(ask("disarm").status, Some(0));
    let line = aborted(&running.wait(SOON));
    assert!(line.contains("disarmed by the operator"), "{line}");
    check_kept(&bench, &rows, &line);
}

#[test]
fn a_pump_that_cannot_be_stopped_is_told_before_anything_moves() {
    let rows = programme(300);
    let bench = Bench::new(Set { relay: false, ..Set::default() });
    let line = aborted(&finish(&mut bench.command(&csv(&rows))));
    for words in ["after 0 of 300 rows", "no pump relay", "needs the pump off in lines 202-251 (1.00 s)"] {
        assert!(line.contains(words), "`{words}` is not in: {line}");
    }
    let seen = bench.close();
    assert!(seen.ticks.iter().all(|tick| tick.duty == [1.0, 1.0] && tick.state != CrioState::Running));

    // A model without a relay says so without the rig.
    let bench = Bench::new(Set::default());
    let rig = model::rig::DUAL_PRESSURE.replace("relay = \"pump_on\"\n", "");
    bench.folder.write("fixed.toml", rig);
    let text = std::fs::read_to_string(&bench.config).unwrap();
    std::fs::write(&bench.config, text + "[rig]\nfile = \"fixed.toml\"\n").unwrap();
    let ended = finish(&mut bench.command(&csv(&rows)));
    assert_eq!(ended.status, Some(2), "{ended:?}");
    assert!(
        ended.stderr.contains("lines 202-251 (1.00 s): pump_on is 0") && ended.stderr.contains("no relay"),
        "{ended:?}"
    );
    assert_eq!(bench.close().sessions, 0);
}

#[test]
fn a_pump_without_a_relay_starts_from_its_balance() {
    let rig = model::rig::DUAL_PRESSURE.replace("relay = \"pump_on\"\n", "");
    let behind = Rig::from_toml(&rig).unwrap();
    let bench = Bench::new(Set { rig: behind, relay: false, ..Set::default() });
    bench.folder.write("fixed.toml", rig);
    let text = std::fs::read_to_string(&bench.config).unwrap();
    std::fs::write(&bench.config, text + "[rig]\nfile = \"fixed.toml\"\n").unwrap();
    let ended = finish(bench.command(&constant(200, 0.9)).arg("--json"));
    let result: Value = serde_json::from_str(&ended.stdout).unwrap();
    assert_eq!((ended.status, &result["rows_played"]), (Some(0), &200.into()), "{ended:?}");
    // It stood well above the atmosphere before the first row, as foreseen.
    let least = |key: &Value| key[0][0].as_f64().unwrap();
    let (foreseen, came) = (least(&result["forecast_kpa"]), least(&result["played"]["range_kpa"]));
    assert!(foreseen > 10.0 && (foreseen - came).abs() < 1.5, "{result}");
}

#[test]
fn bad_programmes_are_refused_before_anything_is_connected() {
    let folder = Folder::new();
    // Nobody listens there: a connection would be told, and is not.
    let config = folder.write("c.toml", "[link]\naddress = \"127.0.0.1:1\"\n[record]\ndirectory = \"kept\"\n");
    let good = csv(&programme(100));
    let line = |number: usize, text: &str| {
        let mut lines: Vec<&str> = good.lines().collect();
        lines[number - 1] = text;
        lines.join("\n") + "\n"
    };
    for (text, words) in [
        (String::new(), vec!["empty"]),
        ("time_s,u_pos,pump_on\n0,0.5,1\n".to_owned(), vec!["line 1", "u_neg is missing"]),
        (line(9, "0.14,nan,0.8,1"), vec!["line 9", "(u_pos)", "give every row a duty"]),
        (line(9, "0.14,0.8,1.5,1"), vec!["line 9", "(u_neg)", "1.5 is outside 0 … 1"]),
        (line(9, "0.14,80,0.8,1"), vec!["line 9", "(u_pos)", "not a percentage"]),
        (line(9, "0.14,0.8,0.8,2"), vec!["line 9", "(pump_on)", "on (1) or off (0)"]),
        (line(9, "0.12,0.8,0.8,1"), vec!["line 9", "(time_s)", "does not come after"]),
        (line(101, "2.5,0.8,0.8,1"), vec!["line 101", "(time_s)", "2.5 s where 1.98 s", "20 ms apart"]),
        (constant(6001, 0.85), vec!["line 6002", "120.02 s", "120 s at most"]),
        (constant(500, 0.0), vec!["line ", "by the model dual_pressure the ", "passes safety.", "nothing was moved"]),
    ] {
        let file = folder.write("bad.csv", &text);
        let ended =
            finish(Command::new(program("controller")).arg("experiment").arg(file).arg("--config").arg(&config));
        assert_eq!((ended.status, ended.stdout.as_str(), ended.stderr.lines().count()), (Some(2), "", 1), "{ended:?}");
        assert!(ended.stderr.contains("bad.csv: "), "{ended:?}");
        for word in words {
            assert!(ended.stderr.contains(word), "`{word}` is not in: {}", ended.stderr);
        }
    }
    // A good one finds nobody, says so, and leaves nothing behind.
    let file = folder.write("good.csv", &good);
    let ended = finish(Command::new(program("controller")).arg("experiment").arg(file).arg("--config").arg(&config));
    assert!(aborted(&ended).contains("127.0.0.1:1: "), "{ended:?}");
    assert!(folder.names("kept").is_empty());
}

#[test]
fn an_experiment_on_a_rig_with_a_secret_can_be_diagnosed() {
    // A leak that the model knows nothing of.
    let secret =
        "[[mechanisms]]\nid = \"chamber_leak\"\ncomponent = \"positive\"\nconductance_kg_per_s_pa2 = 3.0e-15\n";
    let folder = Folder::new();
    let rig = folder.write("secret.toml", format!("{}\n{secret}", model::rig::DUAL_PRESSURE));
    let (_crio, address) = emulated_rig(rig.as_os_str(), Pacing::Lockstep);
    let config = folder.write("c.toml", format!("[link]\naddress = \"{address}\"\npacing = \"lockstep\"\n"));
    let rows = programme(1500);
    let file = folder.write("next_experiment.csv", csv(&rows));
    let out = folder.join("experiment.mcap");
    let mut command = Command::new(program("controller"));
    command.arg("experiment").arg(file).arg("--config").arg(config).arg("--out").arg(&out);
    let ended = finish(&mut command);
    assert!(ended.status == Some(0) && ended.stdout.contains(out.to_str().unwrap()), "{ended:?}");

    // As `trainer diagnose` reads it: columns, then the checks that come before any fit.
    let rig = Rig::builtin("dual_pressure").unwrap();
    let recording = Recording::read(&out).unwrap();
    assert!(recording.notes().iter().all(|note| note.contains("came to rest")), "{:?}", recording.notes());
    let records = Records::new(&rig, &[recording]).unwrap();
    let (u_pos, pump) = (records.input(0, "u_pos").unwrap(), records.input(0, "pump_on").unwrap());
    let start = (0..records.rows()).find(|k| pump[*k] == 1.0).unwrap();
    for (k, row) in rows.iter().enumerate() {
        assert_eq!((u_pos[start + k], pump[start + k]), (row.0, f64::from(row.2)), "row {k}");
    }
    let noise = noise(&records);
    let quality = Quality::of(&rig, &records, &noise).unwrap();
    assert_eq!(quality.refusal(), None);

    // A second experiment does not write over the first.
    let again = finish(&mut command);
    assert!(again.status == Some(2) && again.stderr.contains("experiment.mcap"), "{again:?}");
}

#[test]
fn the_wire_carries_the_rows_and_the_pump() {
    // The command's own bytes, as a cRIO would take them: duty in f32, the pump in bit 0.
    let bench = Bench::new(Set::default());
    let rows = programme(260);
    assert_eq!(finish(&mut bench.command(&csv(&rows))).status, Some(0));
    let content = read_mcap(&bench.recording()).unwrap();
    for (tick, row) in played(&content).iter().zip(&rows) {
        let Ok(Frame::Command(command)) = Frame::decode(&tick.command) else { panic!("a COMMAND") };
        assert_eq!((command.duty, command.pump_on()), ([row.0 as f32, row.1 as f32], row.2 == 1));
        assert_eq!(command.tick, tick.tick);
    }
}

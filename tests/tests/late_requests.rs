//! Requests that take work, and whose askers do not wait for it: nothing is carried out late, and nothing new begins before
//! the work is really over.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use controller::operator::socket::{Ask, Reply, ask};
use model::rig::Rig;
use proto::recording::TickInput;
use proto::wire::{Mode, Sense};
use serde_json::{Value, json};
use tests::Stream::Err;
use tests::laboratory::{Laboratory, Plan, SOCKET, SOON};
use tests::programme::{csv, programme};
use tests::scene::Scene;
use tests::{alone, finish};

/// Ticks after which a model can be compared on them, and that takes half a second or more.
const SOME_SECONDS: u64 = 650;
/// Longer than the daemon takes to see a request or a client that has left, shorter than comparing a model.
const MOMENT: Duration = Duration::from_millis(20);

fn send(laboratory: &Laboratory, request: &Value) -> UnixStream {
    let mut stream = UnixStream::connect(laboratory.folder.join(SOCKET)).unwrap();
    stream.set_read_timeout(Some(SOON)).unwrap();
    stream.write_all(format!("{request}\n").as_bytes()).unwrap();
    stream
}

fn answer(stream: UnixStream) -> Value {
    let mut line = String::new();
    BufReader::new(stream).read_line(&mut line).unwrap();
    serde_json::from_str(&line).unwrap_or_else(|e| panic!("{e}: {line:?}"))
}

fn is_busy(reply: &Value) -> bool {
    reply["error"].as_str().is_some_and(|error| error.contains("is being loaded or checked"))
}

/// An experiment of two minutes, of which checking on the paper's steps takes half a second or more.
fn long_experiment() -> Value {
    json!({"ask": "experiment", "file": "/e.csv", "csv": csv(&programme(6000))})
}

/// A daemon that believes in the rig in its own fine steps, so that checking takes its time.
fn slow_to_check() -> Laboratory {
    Plan::new("policy.active = \"fallback\"\nrig.file = \"dual_pressure\"").start()
}

/// Nothing moves in any tick after the last disarming, and no experiment began.
fn check_nothing_moved(laboratory: Laboratory) {
    // Longer than an experiment takes to come to rest and arm by itself, in ticks of a lockstep.
    std::thread::sleep(Duration::from_secs(1));
    let status = laboratory.status();
    assert_eq!((&status["state"], &status["experiment"]), (&"standby".into(), &Value::Null), "{status}");
    let ticks = laboratory.close().ticks();
    let is_disarmed = |inputs: u32| TickInput::of(inputs).any(|input| input == TickInput::Disarm);
    let disarmed = ticks.iter().rposition(|tick| is_disarmed(tick.inputs)).expect("a disarming");
    assert!(ticks.len() > disarmed + 300, "{} ticks, disarmed at {disarmed}", ticks.len());
    for tick in &ticks[disarmed..] {
        assert_eq!((tick.mode, tick.u_pos, tick.u_neg), (Mode::Vent.code(), 1.0, 1.0), "tick {}", tick.tick);
    }
    assert!(ticks.iter().all(|tick| tick.experiment == 0), "an experiment began");
}

/// Whoever is told that the vents are open does not find the rig under pressure seconds later, for somebody had asked before.
#[test]
fn an_experiment_that_is_checked_falls_with_a_disarming() {
    let _alone = alone();
    for is_under_control in [false, true] {
        let laboratory = slow_to_check();
        if is_under_control {
            laboratory.arm()
        } else {
            laboratory.stand_by()
        }
        let experiment = send(&laboratory, &long_experiment());
        std::thread::sleep(MOMENT);
        let disarmed = answer(send(&laboratory, &json!({"ask": "disarm"})));
        assert_eq!((&disarmed["ok"], &disarmed["venting"]), (&true.into(), &"open".into()), "{disarmed}");
        let refused = answer(experiment);
        let why = refused["error"].as_str().unwrap_or_default();
        assert!(
            why.starts_with("a disarming by ") && why.ends_with("came after it was asked for; ask again"),
            "{refused}"
        );
        check_nothing_moved(laboratory);
    }
}

#[test]
fn the_client_of_an_experiment_that_fell_with_a_disarming_says_so_with_status_1() {
    let _alone = alone();
    let laboratory = slow_to_check();
    laboratory.stand_by();
    let file = laboratory.folder.write("e.csv", csv(&programme(6000)));
    let mut client = laboratory.command(&["experiment", file.to_str().unwrap()]);
    let client = std::thread::spawn(move || finish(&mut client));
    // Whenever it asks, a disarming comes while that is checked.
    while !client.is_finished() {
        let disarmed = answer(send(&laboratory, &json!({"ask": "disarm"})));
        assert_eq!(disarmed["ok"], true, "{disarmed}");
        std::thread::sleep(MOMENT);
    }
    let ended = client.join().unwrap();
    assert_eq!(ended.status, Some(1), "{ended:?}");
    assert!(ended.stderr.contains("a disarming by ") && ended.stderr.contains("ask again"), "{ended:?}");
    check_nothing_moved(laboratory);
}

/// Asks while the cRIO goes on, each frame spoilt.
fn ask_while(scene: &mut Scene, question: Ask, spoil: impl Fn(&mut Sense)) -> Reply {
    let socket = scene.folder.join("s");
    let asking = std::thread::spawn(move || ask(&socket, &question));
    while !asking.is_finished() {
        scene.spoilt(&spoil);
        std::thread::sleep(Duration::from_millis(1));
    }
    asking.join().unwrap().unwrap_or_else(|e| panic!("{e}: {}", scene.daemon.said(Err)))
}

/// A wire that was broken for a moment while an experiment was checked, and that somebody has acknowledged since: by then the rig stands
/// by as it did when it was asked for.
#[test]
fn an_experiment_that_is_checked_falls_with_a_fault_also_where_that_is_acknowledged() {
    let _alone = alone();
    let mut scene = Scene::on(&Rig::builtin("dual_pressure").unwrap(), "rig.file = \"dual_pressure\"");
    (0..60).for_each(|_| _ = scene.step());
    let question = Ask::Experiment { file: "/e.csv".into(), csv: csv(&programme(6000)) };
    let socket = scene.folder.join("s");
    let experiment = std::thread::spawn(move || ask(&socket, &question));
    (0..10).for_each(|_| {
        scene.step();
        std::thread::sleep(Duration::from_millis(1));
    });
    assert!(ask_while(&mut scene, Ask::Status {}, |_| ()).status.unwrap().can_arm);
    assert_eq!(scene.spoilt(|sense| sense.volts[0] = f32::NAN), Some(Mode::Vent));
    (0..5).for_each(|_| _ = scene.step());
    let acknowledged = ask_while(&mut scene, Ask::Acknowledge {}, |_| ());
    assert!(acknowledged.ok, "{acknowledged:?}");
    let until = Instant::now() + SOON;
    while !experiment.is_finished() {
        assert!(Instant::now() < until, "no answer: {}", scene.daemon.said(Err));
        assert_eq!(scene.step(), Some(Mode::Vent), "it moves");
        std::thread::sleep(Duration::from_millis(1));
    }
    let refused = experiment.join().unwrap().unwrap();
    let why = refused.error.unwrap_or_default();
    assert!(why.contains("the rig was vented (positive sensor broken) after it was asked for"), "{why}");
    scene.check_latched();
    scene.end();
}

/// Tests of the thorough tier (docs/testing.md).
mod thorough {
    use super::*;

    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn a_model_whose_asker_has_left_never_comes_into_force_and_bars_others_until_its_work_is_over() {
        let _alone = alone();
        let laboratory = Plan::new("control.auto_arm = true\npolicy.active = \"fallback\"").in_real_time().start();
        let status = laboratory.wait_for("some seconds old", |s| s["status"]["tick"].as_u64() >= Some(SOME_SECONDS));
        assert_eq!(status["running"]["model"], "dual_pressure", "{status}");
        let bench = json!({"ask": "model", "file": "bench"});
        let experiment = json!({"ask": "experiment", "file": "/e.csv", "csv": "time_s,u_pos,u_neg\n0,1,1\n1,1,1\n"});

        let first = send(&laboratory, &bench);
        std::thread::sleep(MOMENT);
        let second = answer(send(&laboratory, &bench));
        assert!(is_busy(&second), "{second}");
        drop(first);
        std::thread::sleep(MOMENT);
        // Nobody waits for it any more, and still it computes: whatever began now would be beside it.
        for request in [&bench, &experiment, &json!({"ask": "swap", "name": "nobody"})] {
            let reply = answer(send(&laboratory, request));
            assert!(is_busy(&reply), "{request}: {reply}");
        }
        let until = Instant::now() + SOON;
        let reply = loop {
            let reply = answer(send(&laboratory, &json!({"ask": "swap", "name": "nobody"})));
            if !is_busy(&reply) {
                break reply;
            }
            assert!(Instant::now() < until, "{reply}");
            std::thread::sleep(MOMENT);
        };
        assert!(reply["error"].as_str().unwrap().contains("no policy nobody"), "{reply}");
        assert_eq!(reply["running"]["model"], "dual_pressure", "put in force after its asker had left: {reply}");

        // One that is waited for comes into force. Frames that a busy machine missed break the run, and it is asked again as it says.
        let until = Instant::now() + SOON;
        let reply = loop {
            let reply = answer(send(&laboratory, &bench));
            let is_too_short = reply["error"].as_str().is_some_and(|error| error.contains("keep the rig armed for"));
            if !is_too_short || Instant::now() > until {
                break reply;
            }
            std::thread::sleep(Duration::from_secs(1));
        };
        assert_eq!((&reply["ok"], &reply["running"]["model"]), (&true.into(), &"bench".into()), "{reply}");
        laboratory.close().check_replay();
    }
}

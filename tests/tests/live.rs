//! `controller live` beside a running daemon: Prometheus over a plain socket, Foxglove's protocol by a client made
//! elsewhere, the page in a browser; and a viewer that is killed, which the daemon never notices.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use proto::recording::read_mcap;
use tests::laboratory::{Laboratory, Plan};
use tests::live_viewer::{self, PATIENCE, get, sample, wait_for};
use tests::{Running, Stream, alone, finish};

struct Scene {
    laboratory: Laboratory,
    live: Running,
    /// Where viewers connect.
    address: String,
}

/// An emulated cRIO, the daemon armed on it, and a viewer's server.
fn scene() -> Scene {
    let laboratory = Plan::new("control.auto_arm = true").in_real_time().start();
    let (live, address) = live_viewer::start(&laboratory);
    laboratory.daemon.line(Stream::Err, "armed", PATIENCE);
    Scene { laboratory, live, address }
}

#[test]
fn a_run_is_watched_from_beside_and_a_killed_viewer_is_nothing_to_it() {
    let _alone = alone();
    let Scene { laboratory, live, address } = scene();
    let Laboratory { daemon, folder, rig: _rig, .. } = laboratory;
    wait_for("ticks at the viewer", || sample(&address, "controller_ticks_total").is_some_and(|ticks| ticks > 20.0));
    let before = sample(&address, "controller_ticks_total").unwrap();
    wait_for("more ticks", || sample(&address, "controller_ticks_total").is_some_and(|ticks| ticks > before + 20.0));
    assert_eq!(sample(&address, "controller_up"), Some(1.0));
    wait_for("a pressure that is not old", || {
        sample(&address, "controller_pressure_kpa{channel=\"positive\"}").is_some_and(|kpa| kpa.abs() < 200.0)
    });
    // Read-only, and for this machine's own names.
    assert!(get(&address, &address, "POST /metrics").contains("405"));
    assert!(get(&address, "evil.example", "GET /metrics").contains("403"));
    assert!(get(&address, &address, "GET /layout.json").contains("/tick.p_pos_kpa"));
    let page = get(&address, &address, "GET /");
    assert!(page.contains("EventSource") && !page.contains("https://"), "one page that loads nothing from elsewhere");

    live.signal("KILL");
    drop(live);
    std::thread::sleep(Duration::from_millis(500));
    daemon.terminate();
    let ended = daemon.wait(PATIENCE);
    assert_eq!(ended.status, Some(0), "{ended:?}");
    assert!(!folder.join("s.live.sock").exists(), "the stream's socket is gone with its daemon");
    let name = folder.names("recordings").into_iter().find(|name| name.ends_with(".mcap")).unwrap();
    let content = read_mcap(&folder.join("recordings").join(name)).unwrap();
    assert!(content.complete && content.ticks.iter().all(|tick| tick.records_dropped == 0));
}

/// A program that can load what a foreign viewer needs; `None` after a line that says so.
fn with_packages(program: &'static str, (option, load): (&str, &str), needed: &str) -> Option<&'static str> {
    let there = Command::new(program).args([option, load]).stderr(Stdio::null()).status();
    let there = there.is_ok_and(|status| status.success());
    if !there {
        println!("SKIPPED: no {program} with {needed} here, so no foreign viewer");
    }
    there.then_some(program)
}

/// Python with the package `websockets`, which is nobody's of this project.
fn client() -> Option<&'static str> {
    with_packages("python3", ("-c", "import websockets"), "the package websockets")
}

fn assert_lines(said: &str, lines: &[&str]) {
    for line in lines {
        assert!(said.lines().any(|found| found == *line), "{line} is not in {said}");
    }
}

#[test]
fn a_foreign_client_of_foxgloves_protocol_sees_every_tick() {
    let Some(python) = client() else { return };
    let _alone = alone();
    let scene = scene();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/live_client.py");
    let ended = finish(Command::new(python).arg(&script).args(["foxglove", &scene.address]));
    assert_eq!(ended.status, Some(0), "{ended:?}");
    assert_lines(
        &ended.stdout,
        &[
            "subprotocol foxglove.websocket.v1",
            "op serverInfo",
            "channel /tick protobuf pneumatic.Tick protobuf True",
            "channel /event protobuf foxglove.Log protobuf True",
            "channel /state json controller.State jsonschema True",
            "age_below_10_s True",
            "ticks 50",
        ],
    );
}

#[test]
fn foxgloves_own_client_decodes_what_comes_and_may_die_in_the_middle() {
    let load = "require('@foxglove/ws-protocol'); require('ws'); require('protobufjs/ext/descriptor')";
    let needed = "the npm packages @foxglove/ws-protocol, ws and protobufjs (NODE_PATH says where they are)";
    let Some(node) = with_packages("node", ("-e", load), needed) else { return };
    let _alone = alone();
    let scene = scene();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/foxglove_client.cjs");
    let killed = finish(Command::new(node).arg(&script).args([&scene.address, "dies"]));
    assert_eq!(killed.status, None, "{killed:?}");
    let ended = finish(Command::new(node).arg(&script).arg(&scene.address));
    assert_eq!(ended.status, Some(0), "{ended:?}");
    assert_lines(
        &ended.stdout,
        &[
            "server controller live []",
            "channel /tick protobuf pneumatic.Tick true",
            "channel /event protobuf foxglove.Log true",
            "channel /state json controller.State true",
            "state up",
            "status 1 advertise is not offered: this server is read-only",
            "forward true",
            "moves true",
            "gauge_kpa true",
            "now true",
        ],
    );
}

#[test]
fn prometheus_own_parser_reads_every_metric() {
    let parser = ("-c", "import prometheus_client");
    let Some(python) = with_packages("python3", parser, "the package prometheus_client") else { return };
    let _alone = alone();
    let scene = scene();
    wait_for("a tick at the viewer", || {
        sample(&scene.address, "controller_pressure_kpa{channel=\"positive\"}").is_some()
    });
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/live_client.py");
    let ended = finish(Command::new(python).arg(&script).args(["metrics", &scene.address]));
    assert_eq!(ended.status, Some(0), "{ended:?}");
    assert_lines(
        &ended.stdout,
        &[
            "type text/plain; version=0.0.4; charset=utf-8",
            "family controller_up gauge 1 True",
            "family controller_pressure_kpa gauge 2 True",
            "family controller_ticks counter 1 True",
            "family controller_info gauge 1 True",
            "family controller_tick_compute_seconds histogram 15 True",
        ],
    );
    // Every line that is no comment became a sample of some family, and none is of a type that was not declared.
    let text = get(&scene.address, &scene.address, "GET /metrics");
    let (_, text) = text.split_once("\r\n\r\n").unwrap();
    let samples = text.lines().filter(|line| !line.starts_with('#')).count();
    let families = || ended.stdout.lines().filter(|line| line.starts_with("family "));
    let parsed: usize = families().map(|line| line.split(' ').nth(3).unwrap().parse::<usize>().unwrap()).sum();
    assert_eq!(parsed, samples, "{}", ended.stdout);
    assert!(families().all(|line| !line.contains(" unknown ") && !line.contains(" untyped ")), "{}", ended.stdout);
}

#[test]
fn the_page_moves_in_a_browser() {
    let Some(python) = client() else { return };
    let Some(chromium) = ["chromium", "chromium-browser", "google-chrome"].into_iter().find(|name| {
        Command::new(name)
            .arg("--version")
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status()
            .is_ok_and(|s| s.success())
    }) else {
        println!("SKIPPED: no chromium here, so the live page is not looked at in a browser");
        return;
    };
    let _alone = alone();
    let scene = scene();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/live_client.py");
    let ended = finish(Command::new(python).arg(&script).args(["page", &scene.address, chromium]));
    assert_eq!(ended.status, Some(0), "{ended:?}");
    let shown: Vec<Vec<&str>> = ended.stdout.lines().map(|line| line.split(' ').collect()).collect();
    let ticks: Vec<u64> = shown.iter().map(|words| words[1].parse().unwrap()).collect();
    assert!(ticks.len() == 2 && ticks[1] > ticks[0] + 50, "{}", ended.stdout);
    // 420 pixels wide, and nothing sticks out.
    let fits =
        |words: &Vec<&str>| words.last().and_then(|width| width.parse().ok()).is_some_and(|width: u32| width <= 420);
    assert!(shown.iter().all(fits), "{}", ended.stdout);
    assert!(shown[1][3].parse::<f64>().is_ok(), "a pressure: {}", ended.stdout);
}

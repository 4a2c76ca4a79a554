//! `trainer rig`, end to end: a small daemon on loopback, signals, faults, counts.

// What fails here fails the test, helper functions included.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod program;

use std::io::{BufRead, BufReader, Lines, Read, Write};
use std::net::TcpStream;
use std::process::{Child, ChildStdout, Stdio};
use std::time::{Duration, Instant};

use program::{Folder, trainer};
use proto::emulator::{PSE540A_R06, PSE541A_R06};
use proto::wire::{Bye, ByeReason, Command, Frame, FrameReader, Hello, Mode, Sense, SequenceCounter};
use rustix::process::{Pid, Signal, kill_process};

const SESSION: u32 = 0x00C0_FFEE;

/// A running `trainer rig`, ended with the test.
struct Rig {
    child: Child,
    /// Standard output after its first line.
    lines: Option<Lines<BufReader<ChildStdout>>>,
    address: String,
}

impl Rig {
    fn start(args: &[&str]) -> Self {
        let mut child = trainer()
            .args(["rig", "--listen", "127.0.0.1:0"])
            .args(args)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let first = lines.next().unwrap().unwrap();
        let address = first.strip_prefix("listening on ").unwrap_or_else(|| panic!("{first}")).to_owned();
        Rig { child, lines: Some(lines), address }
    }

    fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).unwrap();
    }

    /// Waits for the end: status, the rest of standard output, standard error.
    fn end(mut self) -> (Option<i32>, String, String) {
        let rest: Vec<String> = self.lines.take().unwrap().map(Result::unwrap).collect();
        let mut err = String::new();
        self.child.stderr.take().unwrap().read_to_string(&mut err).unwrap();
        (self.child.wait().unwrap().code(), rest.join("\n"), err)
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        let _ = self.child.kill();
    }
}

struct Client {
    stream: TcpStream,
    reader: FrameReader,
    sequence: SequenceCounter,
}

impl Client {
    /// Connects and shakes hands.
    fn open(address: &str) -> Self {
        let stream = TcpStream::connect(address).unwrap();
        stream.set_nodelay(true).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        let mut client = Client { stream, reader: FrameReader::new(), sequence: SequenceCounter::new() };
        let hello = Hello::new(client.sequence.advance(), 1, SESSION, "test daemon");
        client.stream.write_all(&hello.encode()).unwrap();
        let answer = client.frame();
        assert!(matches!(answer, Some(Frame::Hello(hello)) if hello.session == SESSION), "{answer:?}");
        client
    }

    /// The next frame; `None` once the link is closed.
    fn frame(&mut self) -> Option<Frame> {
        loop {
            if let Some(received) = self.reader.next_frame().unwrap() {
                return Some(received.frame);
            }
            let read = self.reader.read_from(&mut self.stream);
            // The machine was held up, or a child of this test has ended.
            if read.as_ref().is_err_and(|error| error.kind() == std::io::ErrorKind::Interrupted) {
                continue;
            }
            if read.unwrap() == 0 {
                return None;
            }
        }
    }

    fn sense(&mut self) -> Sense {
        match self.frame() {
            Some(Frame::Sense(sense)) => sense,
            other => panic!("no SENSE but {other:?}"),
        }
    }

    fn answer(&mut self, sense: &Sense, duty: [f32; 2]) {
        let command = Command {
            sequence: self.sequence.advance(),
            clock_ns: 1,
            session: SESSION,
            tick: sense.tick,
            duty,
            mode: Mode::Run,
            ttl_ticks: 2,
            digital_outputs: Command::PUMP_ON,
        };
        self.stream.write_all(&command.encode()).unwrap();
    }

    fn bye(&mut self) {
        let bye = Bye { sequence: self.sequence.advance(), clock_ns: 1, session: SESSION, reason: ByeReason::Normal };
        self.stream.write_all(&bye.encode()).unwrap();
    }
}

fn kpa(sense: &Sense) -> [f64; 2] {
    [PSE540A_R06.gauge_kpa(f64::from(sense.volts[0])), PSE541A_R06.gauge_kpa(f64::from(sense.volts[1]))]
}

/// The paper's rig in lockstep, 20 s at duties 0.8 and 0.8: settled pressures from a table made elsewhere.
#[test]
fn a_daemon_brings_the_rig_where_it_settles() {
    let rig = Rig::start(&["--rig", "dual_pressure", "--pace", "lockstep"]);
    let mut client = Client::open(&rig.address);
    let mut last = client.sense();
    // Noise of 0.24 mV is 0.06 kPa (positive) and 0.006 kPa (negative); steps of 0.305 mV are 0.08 and 0.008 kPa.
    assert!(kpa(&last).iter().all(|kpa| kpa.abs() < 0.4), "not at rest: {:?}", kpa(&last));
    for tick in 0..1000 {
        assert_eq!(last.tick, tick);
        client.answer(&last, [0.8, 0.8]);
        last = client.sense();
    }
    let [pos, neg] = kpa(&last);
    // The table is rounded to 0.1 kPa, and where in the revolution it was read is good for another 0.1.
    assert!((pos - 95.0).abs() < 0.5 && (neg + 71.4).abs() < 0.25, "{pos} {neg}");
    client.bye();
    assert!(client.frame().is_none());
    rig.signal(Signal::TERM);
    let (status, out, err) = rig.end();
    assert_eq!((status, err.as_str()), (Some(0), ""), "{out}");
    for words in [
        "rig dual_pressure; lockstep; seed 1; 0 faults",
        "session 00C0FFEE opened by \"test daemon\"",
        "the daemon said BYE",
        "1  sessions",
        "1000  COMMANDs applied",
    ] {
        assert!(out.contains(words), "no `{words}` in\n{out}");
    }
}

#[test]
fn the_same_seed_gives_the_same_volts_and_another_one_others() {
    let volts = |seed: &str| {
        let rig = Rig::start(&["--pace", "lockstep", "--seed", seed]);
        let mut client = Client::open(&rig.address);
        (0..20)
            .map(|_| {
                let sense = client.sense();
                client.answer(&sense, [0.5, 0.5]);
                [sense.volts[0].to_bits(), sense.volts[1].to_bits()]
            })
            .collect::<Vec<_>>()
    };
    let first = volts("7");
    assert_eq!(first, volts("7"));
    assert_ne!(first, volts("8"));
}

/// The rig left out is `bench`, whose command delay of a tick keeps both valves where they were.
#[test]
fn bench_is_what_stands_behind_by_default() {
    let second = |args: &[&str]| {
        let rig = Rig::start(&[args, &["--pace", "lockstep"]].concat());
        let mut client = Client::open(&rig.address);
        let sense = client.sense();
        client.answer(&sense, [0.0, 0.0]);
        kpa(&client.sense())
    };
    let (left_out, bench, paper) = (second(&[]), second(&["--rig", "bench"]), second(&["--rig", "dual_pressure"]));
    assert_eq!(left_out, bench);
    assert!((left_out[1] - paper[1]).abs() > 0.1, "{left_out:?} {paper:?}");
}

#[test]
fn real_time_ends_by_itself_after_its_seconds() {
    let start = Instant::now();
    let rig = Rig::start(&["--seconds", "1"]);
    let mut client = Client::open(&rig.address);
    let mut ticks = 0;
    loop {
        match client.frame() {
            Some(Frame::Sense(sense)) => client.answer(&sense, [1.0, 1.0]),
            Some(Frame::Bye(bye)) => break assert_eq!(bye.reason, ByeReason::Normal),
            other => panic!("{other:?}"),
        }
        ticks += 1;
    }
    let (status, out, _) = rig.end();
    // Less than a second of ticks, for the client came a little late; a second, and what starting takes.
    assert!((20..=51).contains(&ticks), "{ticks}");
    assert!(start.elapsed() >= Duration::from_millis(980), "{:?}", start.elapsed());
    assert_eq!(status, Some(0), "{out}");
    assert!(out.contains("s of the rig's time"), "{out}");
}

#[test]
fn lockstep_counts_the_rigs_seconds_and_json_keeps_standard_output_clean() {
    let mut child = trainer()
        .args(["rig", "--listen", "127.0.0.1:0", "--pace", "lockstep", "--seconds", "3", "--json"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    let first = lines.next().unwrap().unwrap();
    let mut client = Client::open(first.strip_prefix("listening on ").unwrap());
    while let Some(Frame::Sense(sense)) = client.frame() {
        client.answer(&sense, [1.0, 1.0]);
    }
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0));
    let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    // Ticks pass while the word to stop is on its way: tens of them at most, at some 20,000 a second.
    let edges = value["edges"].as_u64().unwrap();
    assert!((150..1500).contains(&edges), "{value:#}");
    assert_eq!((&value["sessions"], &value["missed"]), (&1.into(), &0.into()), "{value:#}");
}

#[test]
fn faults_and_trips_are_told() {
    let folder = Folder::new("faults");
    let faults = folder.with(
        "faults.toml",
        "[[fault]]\nkind = \"repeat\"\nframe = \"sense\"\nticks = [1]\n[[fault]]\nkind = \"trip\"\nreason = \"operator_stop\"\nticks = [5]\n",
    );
    let rig = Rig::start(&["--pace", "lockstep", "--faults", &faults]);
    let mut client = Client::open(&rig.address);
    let tripped = loop {
        let sense = client.sense();
        client.answer(&sense, [0.9, 0.9]);
        if !sense.trips.is_empty() {
            break sense;
        }
    };
    assert_eq!((tripped.tick, tripped.duty), (5, [1.0, 1.0]));
    rig.signal(Signal::INT);
    let (status, out, _) = rig.end();
    assert_eq!(status, Some(0), "{out}");
    for words in ["2 faults", "tripped at tick 5", "fault script: 1 frames spoilt", "1  trips by an operator's stop"] {
        assert!(out.contains(words), "no `{words}` in\n{out}");
    }
}

#[test]
fn an_address_that_is_taken_is_work_that_failed() {
    let rig = Rig::start(&["--pace", "lockstep"]);
    let output = trainer().args(["rig", "--listen", &rig.address]).output().unwrap();
    let err = String::from_utf8(output.stderr).unwrap();
    assert_eq!((output.status.code(), err.lines().count()), (Some(1), 1), "{err}");
    assert!(err.contains(&format!("cannot listen on {}", rig.address)), "{err}");
}

/// The emulator outlives whoever read its lines.
#[test]
fn a_closed_standard_output_does_not_stop_the_rig() {
    let mut rig = Rig::start(&["--pace", "lockstep"]);
    let address = rig.address.clone();
    // The pipe's end is closed with its reader.
    rig.lines = None;
    for _ in 0..2 {
        let mut client = Client::open(&address);
        let sense = client.sense();
        client.answer(&sense, [1.0, 1.0]);
        client.bye();
        assert!(std::iter::from_fn(|| client.frame()).all(|frame| matches!(frame, Frame::Sense(_))));
    }
    rig.signal(Signal::TERM);
    assert_eq!(rig.child.wait().unwrap().code(), Some(0));
}

//! The daemon in real time beside an oracle: misses of the tick that the machine itself does not excuse.
//!
//! `oracle_hour [SECONDS] [--beside COMMAND…]` (3600): what [`tests::oracle`] says. Run it on a machine that does nothing else, or
//! beside `stress-ng`. Exit status 1: a miss that nothing excuses.
//!
//! A `COMMAND` is run in the daemon's folder once the rig is under control, such as `trainer finetune --recordings recordings --publish
//! policies --from policies/default.onnx --out tuned`: the reference repeats, the newest policy is taken, and the operator switches
//! exploration on whenever it is off. At the end the command is told to stop, and what it printed is shown.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::path::PathBuf;
use std::process::{Command, ExitCode};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use controller::operator::operator_protocol::Switch;
use controller::operator::socket::Ask;
use controller::state::State;
use flight::Recorded;
use proto::recording::EventLevel;
use tests::in_process::Daemon;
use tests::oracle::{CrioProcess, Oracles, Verdict, Witness, attend, be_the_crio};
use tests::{Folder, RunStatus, Running};

/// First argument of the process that is the cRIO.
const CRIO: &str = "--crio";
/// Time that a command beside the daemon has to end in.
const ENDS: Duration = Duration::from_secs(60);

/// A command that is run beside the daemon, in its folder.
struct Beside(Vec<String>);

impl Beside {
    /// The command behind `--beside`; `None` without it.
    fn of(arguments: &[String]) -> Option<Self> {
        let place = arguments.iter().position(|argument| argument == "--beside")?;
        Some(Beside(arguments[place + 1..].to_vec()))
    }

    fn start(&self, folder: &Folder) -> Running {
        let (program, arguments) = self.0.split_first().expect("--beside needs a command");
        // Relative to where this was called from: it runs elsewhere.
        let program = std::fs::canonicalize(program).unwrap_or_else(|_| PathBuf::from(program));
        Running::start(Command::new(program).args(arguments).current_dir(folder.join(".")))
    }
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let argument = arguments.first().map_or("3600", String::as_str);
    if argument == CRIO {
        be_the_crio();
        return ExitCode::SUCCESS;
    }
    let Ok(seconds) = argument.parse::<f64>() else {
        println!(
            "oracle_hour [SECONDS] [--beside COMMAND…]: the daemon in real time beside an oracle, an hour by default"
        );
        return if argument == "--help" { ExitCode::SUCCESS } else { ExitCode::from(2) };
    };
    let beside = Beside::of(&arguments);
    let folder = Folder::new();
    let crio = CrioProcess::start(Command::new(std::env::current_exe().unwrap()).arg(CRIO));
    let address = crio.address();
    let mut text = format!(
        "[link]\naddress = \"{address}\"\n[record]\ndirectory = \"recordings\"\nmin_free_mib = 16\n[control]\n\
         socket = \"s\"\nauto_arm = true\n[policy]\nactive = \"default\"\n"
    );
    if beside.is_some() {
        text += "directory = \"policies\"\nfollow = \"newest\"\n[reference]\nrepeat = true\n";
        let shipped = tests::root().join("controller/policies/default.onnx");
        std::fs::create_dir(folder.join("policies")).unwrap();
        std::fs::copy(shipped, folder.join("policies/default.onnx")).unwrap();
    }
    let file = folder.write("controller.toml", text);
    let witness = Arc::new(Mutex::new(Witness::default()));
    let sees = Arc::clone(&witness);
    let daemon = Daemon::start(&file, move |recorded| match recorded {
        Recorded::Tick(tick) => sees.lock().unwrap().see(tick),
        Recorded::Event { level, message, .. } => {
            // What this operator asks for in vain is no news.
            let is_news = level != EventLevel::Info && !message.starts_with("explore");
            if is_news || message.starts_with("policy") {
                println!("the daemon: {message}");
            }
        }
    });
    let oracles = Oracles::start();
    let until = Instant::now() + Duration::from_secs_f64(seconds);
    let (mut vented, mut running) = (0, None);
    while Instant::now() < until {
        std::thread::sleep(Duration::from_secs(1));
        match attend(&daemon) {
            Some(State::Vent | State::Fault) => vented += 1,
            Some(State::Run) => {
                if let (None, Some(command)) = (&running, &beside) {
                    running = Some(command.start(&folder));
                }
                if running.is_some() {
                    // Refused while it is on, and while a candidate is examined.
                    drop(daemon.ask(&Ask::Explore { switch: Switch::On, seed: None }));
                }
            }
            _ => {}
        }
    }
    if let Some(command) = running {
        command.terminate();
        let RunStatus { status, stdout, stderr } = command.wait(ENDS);
        println!("beside it, exit status {status:?}:\n{stdout}{stderr}");
    }
    daemon.end();
    let verdict = Verdict::of(&witness.lock().unwrap(), oracles, crio);
    if !verdict.refused.is_empty() {
        println!("SKIPPED: the oracle has no priority here: {}", verdict.refused.join("; "));
        return ExitCode::SUCCESS;
    }
    println!("the rig was vented {vented} times");
    verdict.unexcused.iter().for_each(|miss| println!("not excused: {miss}"));
    println!("{}", verdict.text);
    if verdict.unexcused.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

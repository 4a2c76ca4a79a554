//! `trainer rig`: the emulated cRIO as a program of its own.
//!
//! The first line on standard output is `listening on HOST:PORT`, written before the first client can come,
//! so that a script can ask for port 0. Events follow as they happen, counts at the end. The emulator goes on
//! if no one reads its lines: a rig must not stop because a log does.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::RecvTimeoutError;
use std::time::Duration;

use clap::{Args, ValueEnum};
use proto::emulator::{Emulator, EmulatorConfig, FaultScript, Pace, load_for_loop, rig_and_crio};
use proto::rig_file::RigFileError;
use signal_hook::consts::{SIGINT, SIGTERM};

use crate::failure::Failure;
use crate::rig_log::{self, Log, Seen};

/// Plays the cRIO: listens on TCP, with a rig behind it that the daemon controls.
///
/// Speaks the wire protocol (50 Hz, SENSE out, COMMAND in) with sensors in volts, noise and steps of the converter
/// included. Prints `listening on HOST:PORT` first, then a line per event, and counts at the end. SIGINT and SIGTERM
/// say BYE and stop it. Unlike in other commands the rig is bench where --rig is left out: the daemon's model knows
/// only dual_pressure, and a model is never the plant.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  trainer rig --listen 127.0.0.1:50500
  trainer rig --listen 127.0.0.1:0 --rig dual_pressure --pace lockstep \\
    --seconds 60 --json
  trainer rig --listen 0.0.0.0:50500 --faults faults.toml --seed 7")]
pub(crate) struct RigArgs {
    /// Address to listen on; port 0 takes a free one
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:50500", value_parser = address)]
    listen: String,
    /// Rig behind the cRIO: a built-in name (bench, dual_pressure) or a TOML file with the paper's inputs and sensors
    #[arg(long, value_name = "RIG", default_value = "bench")]
    rig: String,
    /// real: a tick every 20 ms; lockstep: the next tick as soon as the COMMAND is there, and no time without a client
    #[arg(long, value_enum, default_value = "real")]
    pace: PaceChoice,
    /// Script of faults (TOML): frames lost, late, corrupted or repeated, links dropped, sensors broken [default: none]
    #[arg(long, value_name = "FILE")]
    faults: Option<PathBuf>,
    /// Seed of the sensors' noise
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Stop after so many seconds of the rig's time [default: run until stopped]
    #[arg(long, value_name = "S", value_parser = clap::value_parser!(u32).range(1..))]
    seconds: Option<u32>,
    /// Print the final counts as one JSON object; everything else goes to standard error
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum PaceChoice {
    Real,
    Lockstep,
}

/// Ticks of the wire protocol in a second.
const TICKS_PER_S: u64 = 50;
/// Longest time without a look at signals and counts.
const LOOK: Duration = Duration::from_millis(50);

pub(crate) fn run(args: &RigArgs) -> Result<(), Failure> {
    let rig = load_for_loop(&args.rig, Some("--rig"))?;
    let (behind, crio) = rig_and_crio(&rig).map_err(|problem| RigFileError::Rig { file: args.rig.clone(), problem })?;
    let faults = args.faults.as_deref().map_or(Ok(FaultScript::none()), FaultScript::read)?;
    let faults_count = faults.len();
    let pace = match args.pace {
        PaceChoice::Real => Pace::RealTime,
        PaceChoice::Lockstep => Pace::LOCKSTEP,
    };
    let config = EmulatorConfig { crio, pace, seed: args.seed, faults, ..EmulatorConfig::default() };

    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&stop)).map_err(Failure::Signals)?;
    }
    let last_edge = args.seconds.map(|seconds| u64::from(seconds) * TICKS_PER_S);
    let (watcher, seen) = rig_log::watcher(last_edge);
    let emulator = Emulator::bind(&args.listen, config, Box::new(behind))?.watched_by(watcher);

    let mut log = Log::new(args.json);
    log.line(&format!("listening on {}", emulator.local_addr()));
    let pace = match args.pace {
        PaceChoice::Real => "real time",
        PaceChoice::Lockstep => "lockstep",
    };
    log.line(&format!("rig {}; {pace}; seed {}; {faults_count} faults", rig.name, args.seed));
    let handle = emulator.start()?;
    loop {
        match seen.recv_timeout(LOOK) {
            Ok(Seen::Event(event)) => log.event(&event),
            Ok(Seen::TimeOver) | Err(RecvTimeoutError::Disconnected) => break,
            Err(RecvTimeoutError::Timeout) => {}
        }
        let counts = handle.statistics();
        log.counts(&counts);
        // The mark of the time that is over may have found no room among events.
        if stop.load(Ordering::Relaxed) || last_edge.is_some_and(|last| counts.edges >= last) {
            break;
        }
    }
    handle.stop();
    let counts = handle.join()?;
    while let Ok(seen) = seen.try_recv() {
        if let Seen::Event(event) = seen {
            log.event(&event);
        }
    }
    log.end(&counts)
}

/// `host:port`, so that a forgotten port is told before anything else is done.
fn address(text: &str) -> Result<String, &'static str> {
    match text.rsplit_once(':') {
        Some((host, port)) if !host.is_empty() && port.parse::<u16>().is_ok() => Ok(text.to_owned()),
        _ => Err("HOST:PORT is meant, such as 127.0.0.1:50500"),
    }
}

#[cfg(test)]
mod tests {
    use model::rig::Rig;

    use super::*;

    #[test]
    fn an_address_is_a_host_and_a_port() {
        for sound in ["127.0.0.1:0", "localhost:50500", "[::1]:50500"] {
            assert_eq!(address(sound).as_deref(), Ok(sound));
        }
        for wrong in ["50500", "127.0.0.1", ":50500", "host:", "host:70000", ""] {
            assert!(address(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_rig_whose_sensor_leaves_the_volts_of_the_wire_is_refused() {
        let mut rig = Rig::builtin("bench").unwrap();
        rig.sensors["sensor_pos"].range_v = [0.0, 10.0];
        let path = std::env::temp_dir().join(format!("rig-of-10-v-{}.toml", std::process::id()));
        proto::rig_file::save(&path, &rig).unwrap();
        let args = RigArgs {
            listen: "127.0.0.1:0".to_owned(),
            rig: path.display().to_string(),
            pace: PaceChoice::Real,
            faults: None,
            seed: 1,
            // Where it is not refused, it ends by itself.
            seconds: Some(1),
            json: false,
        };
        let refused = run(&args);
        std::fs::remove_file(&path).unwrap();
        let error = refused.unwrap_err();
        assert_eq!(error.status(), crate::failure::BAD_INPUT);
        let beginning = format!("{} (--rig): sensors.sensor_pos.range_v: ", path.display());
        assert!(error.to_string().starts_with(&beginning), "{error}");
    }
}

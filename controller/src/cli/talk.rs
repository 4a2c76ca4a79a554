//! `controller status`, `arm`, `disarm`, `reference`: talk to a running daemon.

use std::path::{Path, PathBuf};

use clap::Args;
use controller::config::{Config, Control};
use controller::socket::{Ask, Reply, ask};

use super::Failure;
use super::console::say;

/// Which daemon.
#[derive(Debug, Args)]
pub(crate) struct Target {
    /// The daemon's configuration file, to find its socket.
    #[arg(long, value_name = "FILE", conflicts_with = "socket")]
    config: Option<PathBuf>,
    /// The daemon's socket; by default `controller.sock` here.
    #[arg(long, value_name = "PATH")]
    socket: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

impl Target {
    pub(super) fn status(&self) -> Result<(), Failure> {
        let reply = self.ask(&Ask::Status {})?;
        if !self.json {
            print_status(&reply);
        }
        Ok(())
    }

    pub(super) fn arm(&self) -> Result<(), Failure> {
        self.ask(&Ask::Arm {})?;
        self.done("armed")
    }

    pub(super) fn disarm(&self) -> Result<(), Failure> {
        self.ask(&Ask::Disarm {})?;
        self.done("disarmed; both vents open")
    }

    pub(super) fn reference(&self, file: &Path) -> Result<(), Failure> {
        // The daemon has another working directory.
        let file = std::path::absolute(file).map_err(|e| Failure::input(format!("{}: {e}", file.display())))?;
        self.ask(&Ask::Reference { file: file.clone() })?;
        self.done(&format!("following {}", file.display()))
    }

    fn done(&self, text: &str) -> Result<(), Failure> {
        if !self.json {
            say(format_args!("{text}"));
        }
        Ok(())
    }

    /// Asks; with `--json` prints the answer whatever it is.
    fn ask(&self, question: &Ask) -> Result<Reply, Failure> {
        let reply = ask(&self.path()?, question).map_err(Failure::work)?;
        if self.json {
            say(format_args!("{}", serde_json::to_string(&reply).map_err(Failure::work)?));
        }
        match &reply.error {
            Some(error) => Err(Failure::work(error)),
            None => Ok(reply),
        }
    }

    fn path(&self) -> Result<PathBuf, Failure> {
        match (&self.socket, &self.config) {
            (Some(socket), _) => Ok(socket.clone()),
            (None, Some(config)) => Ok(Config::read(config)?.control.socket),
            (None, None) => Ok(Control::default().socket),
        }
    }
}

fn print_status(reply: &Reply) {
    say(format_args!("state      {}", reply.state));
    let Some(s) = &reply.status else {
        say(format_args!("           no tick yet"));
        return;
    };
    let armable = if s.can_arm { ", can be armed" } else { "" };
    say(format_args!("session    {:08X}, tick {}{armable}", s.session, s.tick));
    if s.fault != 0 {
        say(format_args!("fault      {}", controller::notice::fault_name(s.fault)));
    }
    for (c, name) in ["positive", "negative"].into_iter().enumerate() {
        let (p, r, u) = (s.pressures_kpa[c], s.reference_kpa[c], s.duty[c]);
        say(format_args!("{name}   {p:8.2} kPa   reference {r:8.2} kPa   duty {u:.3}"));
    }
    say(format_args!(
        "deadlines  {} missed, {} frames missed, slowest tick {:.2} ms",
        s.deadline_misses, s.frames_missed, s.slowest_ms
    ));
    if let Some(problem) = &reply.recording_problem {
        say(format_args!("recording  {problem}"));
    }
}

//! `controller status`, `arm`, `disarm`, `reference`: talk to a running daemon.

use std::path::{Path, PathBuf};

use clap::Args;
use controller::config::{Config, Control};
use controller::cycle::duty_source::ExperimentPhase;
use controller::experiment::waiting::{Obstacles, waits_for};
use controller::operator::mailbox::Status;
use controller::operator::notice::why_barred;
use controller::operator::operator_protocol::Venting;
use controller::operator::running::ModelIdentity;
use controller::operator::socket::{Ask, Reply, Switch, ask};
use controller::state::State;
use proto::reference::{MOST_BYTES, Reference};
use proto::regular_file;
use proto::rig_file::RigFileError;

use super::Failure;
use super::console::{say, tell};

/// Daemon that is addressed.
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
        let reply = self.ask(&Ask::Arm {})?;
        self.done_with_remark("armed", &reply)
    }

    pub(super) fn disarm(&self) -> Result<(), Failure> {
        let reply = self.ask(&Ask::Disarm {})?;
        let text = reply.done.as_deref().unwrap_or("disarmed; `controller status` says what is known of the vents");
        match reply.venting {
            Some(Venting::Open) => self.done(text),
            // The work was done, and what was wanted by it is not known to be so.
            _ => Err(Failure::not_good(text)),
        }
    }

    pub(super) fn acknowledge(&self) -> Result<(), Failure> {
        let reply = self.ask(&Ask::Acknowledge {})?;
        self.done(reply.done.as_deref().unwrap_or("acknowledged; arm when you are ready"))
    }

    pub(super) fn reference(&self, file: &Path) -> Result<(), Failure> {
        // The daemon has another working directory.
        let file = std::path::absolute(file).map_err(|e| Failure::input(format!("{}: {e}", file.display())))?;
        // Read here, with the rights of whoever asks: the daemon may not see this person's files, and what is wrong in
        // one can be said in full.
        let text = regular_file::read_text(&file, MOST_BYTES)
            .map_err(|e| Failure::input(format!("{}: cannot read the reference: {e}", file.display())))?;
        Reference::parse(&file.display().to_string(), text.as_bytes()).map_err(Failure::input)?;
        let reply = self.ask(&Ask::Reference { file: file.clone(), csv: Some(text) })?;
        self.done_with_remark(&format!("following {}", file.display()), &reply)
    }

    pub(super) fn policies(&self) -> Result<(), Failure> {
        let reply = self.ask(&Ask::Policies {})?;
        if !self.json {
            super::policies::print(reply.policies.as_deref().unwrap_or_default());
            if let Some(problem) = &reply.policies_problem {
                say(format_args!("problem: {problem}"));
            }
        }
        Ok(())
    }

    pub(super) fn swap(&self, name: &str) -> Result<(), Failure> {
        let reply = self.ask(&Ask::Swap { name: name.to_owned() })?;
        self.done(reply.done.as_deref().unwrap_or("done"))
    }

    pub(super) fn rollback(&self) -> Result<(), Failure> {
        let reply = self.ask(&Ask::Rollback {})?;
        self.done(reply.done.as_deref().unwrap_or("done"))
    }

    pub(super) fn explore(&self, switch: Switch, seed: Option<u32>) -> Result<(), Failure> {
        let reply = self.ask(&Ask::Explore { switch, seed })?;
        self.done(reply.done.as_deref().unwrap_or("done"))
    }

    pub(super) fn model(&self, file: &Path) -> Result<(), Failure> {
        let builtin = file.to_str().is_some_and(|name| model::rig::Rig::builtin_text(name).is_some());
        let file = if builtin {
            file.to_owned()
        } else {
            // The daemon has another working directory.
            let file = std::path::absolute(file).map_err(|e| Failure::input(format!("{}: {e}", file.display())))?;
            // What is wrong in a rig file that this person may read is told here, as wrong input; another is the daemon's to judge.
            match proto::emulator::load_for_loop(&file.display().to_string(), None) {
                Ok(_) => {}
                Err(RigFileError::Read { source, .. }) if source.kind() == std::io::ErrorKind::PermissionDenied => {}
                Err(error) => return Err(Failure::input(error)),
            }
            file
        };
        let reply = self.ask(&Ask::Model { file })?;
        self.done(reply.done.as_deref().unwrap_or("done"))
    }

    fn done(&self, text: &str) -> Result<(), Failure> {
        if !self.json {
            say(format_args!("{text}"));
        }
        Ok(())
    }

    /// As `done`, and what the daemon has to remark on it.
    fn done_with_remark(&self, text: &str, reply: &Reply) -> Result<(), Failure> {
        self.done(text)?;
        if let (Some(remark), false) = (&reply.remark, self.json) {
            tell(remark);
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
            Some(error) if reply.bad_input => Err(Failure::input(error)),
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
    say(format_args!("state      {}", reply.state.as_str()));
    let running = &reply.running;
    say(format_args!("policy     {}   model {}   reference {}", running.policy, running.model, running.reference));
    say(format_args!("model      {}", origin(&running.model_identity())));
    if let Some(configured) = &running.configured_model {
        let (name, origin) = (&configured.name, origin(configured));
        say(format_args!("           the configuration names {name}, {origin}, which a restart takes"));
    }
    if let Some(reach) = &running.reach {
        say(format_args!("reach      by the model {}", reach.to_string().replacen(", ", ",\n           ", 1)));
    }
    if let Some(why) = &running.why_fallback {
        say(format_args!("fallback   {why}"));
    }
    if let Some(who) = &running.armed_by {
        say(format_args!("armed by   {who}"));
    }
    match &reply.status {
        Some(status) => print_tick(status, reply),
        None => say("           no tick yet"),
    }
    if let Some(problem) = &reply.recording_problem {
        say(format_args!("recording  {problem}"));
    }
}

/// Origin and identity of a model: names do not tell an edited file from another.
fn origin(model: &ModelIdentity) -> String {
    let from = model.file.as_ref().map_or("built in".to_owned(), |file| format!("from {file}"));
    format!("sha256 {:.8}, {from}", model.sha256)
}

/// The newest tick; without a session it says how old it is.
fn print_tick(s: &Status, reply: &Reply) {
    let armable = if s.can_arm { ", can be armed" } else { "" };
    let old = match reply.age_ms {
        _ if reply.state != State::Connect => String::new(),
        Some(age_ms) => format!(", last data {:.1} s ago", age_ms as f64 / 1000.0),
        None => ", no data yet".to_owned(),
    };
    let session = if s.session == 0 { "none".to_owned() } else { format!("{:08X}", s.session) };
    say(format_args!("session    {session}, tick {}{armable}{old}", s.tick));
    if let Some(condition) = s.fault {
        say(format_args!("fault      {}", condition.name()));
    }
    if !s.waiting.is_empty() {
        say(format_args!("waiting    {}: `controller acknowledge`, then arm", s.waiting.names()));
    }
    if let Some(condition) = s.bars_arming {
        say(format_args!("not armed  {}", why_barred(condition)));
    }
    if let Some(experiment) = &s.experiment {
        let phase = match experiment.phase {
            ExperimentPhase::Settling => {
                waits_for(reply.state, Obstacles { fault: s.fault, waiting: s.waiting, bars_arming: s.bars_arming })
            }
            ExperimentPhase::Playing => "playing".to_owned(),
            ExperimentPhase::Resting => "coming to rest".to_owned(),
        };
        say(format_args!(
            "experiment {phase}, {} of {} rows; `controller disarm` stops it",
            experiment.reached, experiment.rows
        ));
    }
    for (c, name) in ["positive", "negative"].into_iter().enumerate() {
        let shown = |pair: Option<[f64; 2]>| pair.and_then(|p| p.get(c).copied());
        let kpa = |value: Option<f64>| value.map_or("    none".to_owned(), |v| format!("{v:8.2} kPa"));
        let duty = s.duty.get(c).copied().unwrap_or(f64::NAN);
        let (pressure, reference) = (kpa(shown(s.pressures_kpa)), kpa(shown(s.reference_kpa)));
        say(format_args!("{name}   {pressure}   reference {reference}   duty {duty:.3}"));
    }
    if let Some([pos, neg]) = s.reported_duty.filter(|reported| s.state.is_vented() && *reported != s.duty) {
        say(format_args!(
            "reported   duties of {pos:.3}/{neg:.3} by the cRIO, where both vents are commanded open (1)"
        ));
    }
    say(format_args!(
        "deadlines  {} missed, {} frames missed, slowest tick {:.2} ms",
        s.deadline_misses, s.frames_missed, s.slowest_ms
    ));
    if let Some(exploration) = &s.exploration {
        let ([pos, neg], seed) = (exploration.std_duty, exploration.seed);
        say(format_args!("exploring  noise of {pos:.4}/{neg:.4} of duty (standard deviation), seed {seed}"));
    }
    if s.filter_interventions > 0 {
        say(format_args!(
            "filter     {} commands changed to keep the envelope or the slew limit",
            s.filter_interventions
        ));
    }
}

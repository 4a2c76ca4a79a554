//! Answers the operator's requests: at once, or as soon as the tick has carried them out or provably will not.
//!
//! Nothing here waits. [`Desk::begin`] answers or names what is pending; [`Desk::look`] is asked again and again, and
//! [`Desk::gone`] is told when the client has left, which withdraws a request that the tick has not taken yet.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use flight::{Noter, RecorderHealth};
use handover::ExplorationRules;
use proto::recording::{EventLevel, rfc3339};
use proto::reference::{Reference, ReferenceError};

use crate::clock::now_ns;
use crate::config::Safety;
use crate::experiment::Experiment;
use crate::experiment_desk::{self, ExperimentDesk};
use crate::experiment_log::ExperimentLog;
use crate::exploration_desk;
use crate::mailbox::{Fate, OperatorMailbox, Request, Status, Ticket};
use crate::operator_protocol::{Ask, EFFECT_TIME, READ_TIME, Reply, Running, Switch, WORK_TIME};
use crate::peer::Peer;
use crate::policy_service::PolicyHandle;
use crate::reference_limits::{self, Margin};
use crate::reload::Reloaded;
use crate::run_file::attached;
use crate::session_recorder::attachment;
use crate::state::State;

/// What an operator may do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum May {
    /// Everything.
    Fly,
    /// Look on and disarm: an experiment is under way.
    OnlyStop,
}

/// What a desk works with.
pub struct DeskOptions {
    /// The way to the tick.
    pub mailbox: OperatorMailbox,
    /// Limits that references must keep.
    pub safety: Safety,
    /// How the recording does.
    pub health: RecorderHealth,
    /// Where the record of who asked for what goes.
    pub notes: Noter,
    /// What an operator may do.
    pub may: May,
    /// What the daemon runs with.
    pub running: Running,
    /// Policies and models, where they can be changed.
    pub policies: Option<PolicyHandle>,
    /// Where experiments are recorded, where they can be played within the run.
    pub experiments: Option<ExperimentLog>,
    /// How exploration is configured; the seed is each one's own.
    pub exploration: ExplorationRules,
    /// Age from which a status no longer tells what is: there is no session.
    pub stale: Duration,
    /// Configurations that were read again.
    pub reloads: Receiver<Reloaded>,
}

/// The operators' desk.
pub struct Desk {
    options: DeskOptions,
    experiments: Option<ExperimentDesk>,
    newest: Option<(Status, u64)>,
    /// A reference is being read; at most one at a time.
    reading: bool,
    /// A policy is being loaded or a model compared; at most one at a time.
    working: bool,
}

/// Answered where policies and models cannot be changed.
const NO_POLICIES: &str = "policies and models cannot be changed in this run";

/// Answered where experiments cannot be played.
const NO_EXPERIMENTS: &str = "experiments cannot be played in this run";
/// Answered to what would come between.
const UNDER_WAY: &str = "an experiment is under way; wait for its end, or disarm to stop it";

/// What is asked for and not yet answered.
pub struct Pending {
    what: What,
    peer: Peer,
    asked_ns: u64,
    until: Instant,
}

enum What {
    Arm(Ticket),
    Acknowledge(Ticket),
    Disarm,
    Reading {
        from: Receiver<Result<Reference, String>>,
        name: String,
    },
    Aside {
        from: Receiver<Result<String, String>>,
        what: String,
    },
    Explore {
        ticket: Ticket,
        switch: Switch,
    },
    Checking {
        from: Receiver<Result<Box<Experiment>, String>>,
        name: String,
    },
    Experiment {
        ticket: Ticket,
        experiment: Box<Experiment>,
    },
    /// The text is what goes into the recording once the tick has taken it.
    Reference {
        ticket: Ticket,
        name: String,
        csv: String,
    },
}

/// What comes of a request for now.
pub enum Step {
    /// The answer.
    Done(Box<Reply>),
    /// Not yet.
    Pending(Pending),
}

/// Whether the valves are being controlled.
fn controls(status: &Status) -> bool {
    status.state.is_controlling()
}

impl Desk {
    /// A desk for a daemon.
    pub fn new(options: DeskOptions) -> Self {
        let experiments = options.experiments.clone().map(ExperimentDesk::new);
        Desk { options, experiments, newest: None, reading: false, working: false }
    }

    /// Takes in a line that a client sent.
    pub fn begin(&mut self, line: &[u8], peer: Peer) -> Step {
        self.refresh();
        let ask = match serde_json::from_slice::<Ask>(line) {
            Ok(ask) => ask,
            Err(error) => return self.done(Err(format!("not a request: {error}"))),
        };
        let asked_ns = now_ns();
        let until = Instant::now() + ask.answer_time();
        let pending = |what| Step::Pending(Pending { what, peer, asked_ns, until });
        match ask {
            Ask::Status {} => self.done(Ok(())),
            Ask::Policies {} => self.list_policies(),
            _ if self.comes_between(&ask) => self.done(Err(UNDER_WAY.to_owned())),
            Ask::Arm {} => match self.start_arming() {
                Ok(ticket) => pending(What::Arm(ticket)),
                Err(why) => self.over("arm", peer, Err(why)),
            },
            Ask::Acknowledge {} => match self.start_acknowledging() {
                Ok(ticket) => pending(What::Acknowledge(ticket)),
                Err(why) => self.over("acknowledge", peer, Err(why)),
            },
            Ask::Disarm {} => {
                self.options.mailbox.disarm();
                pending(What::Disarm)
            }
            Ask::Swap { name } => {
                self.aside(format!("swap {name}"), peer, move |handle, who| handle.policies.swap(&name, who))
            }
            Ask::Rollback {} => match &self.options.policies {
                Some(handle) => {
                    let outcome = handle.policies.rollback(&peer.to_string());
                    self.over_saying("rollback", peer, outcome)
                }
                None => self.over("rollback", peer, Err(NO_POLICIES.to_owned())),
            },
            Ask::Model { file } => {
                let notes = self.options.notes.clone();
                self.aside(format!("model {}", file.display()), peer, move |handle, _| {
                    let changed = handle.models.change(&file)?;
                    changed.keep(&notes);
                    handle.policies.model_changed(handle.models.rig());
                    Ok(changed.line)
                })
            }
            Ask::Explore { switch, seed } => match self.start_exploring(switch, seed) {
                Ok(ticket) => pending(What::Explore { ticket, switch }),
                Err(why) => self.over("explore", peer, Err(why)),
            },
            Ask::Experiment { file, csv } => {
                let name = file.display().to_string();
                match self.start_experiment(&name, csv) {
                    Ok(from) => {
                        self.working = true;
                        let until = Instant::now() + WORK_TIME;
                        Step::Pending(Pending { what: What::Checking { from, name }, peer, asked_ns, until })
                    }
                    Err(why) => self.over(&format!("experiment {name}"), peer, Err(why)),
                }
            }
            Ask::Reference { .. } if self.reading => {
                self.over("reference", peer, Err("another reference is being read; try again".to_owned()))
            }
            Ask::Reference { file, csv } => match read_aside(file.clone(), csv) {
                Ok(from) => {
                    self.reading = true;
                    // Of its time the tick's part comes after reading.
                    let until = Instant::now() + READ_TIME;
                    let what = What::Reading { from, name: file.display().to_string() };
                    Step::Pending(Pending { what, peer, asked_ns, until })
                }
                Err(why) => self.over("reference", peer, Err(why)),
            },
        }
    }

    /// Looks whether something pending is over.
    pub fn look(&mut self, pending: Pending) -> Step {
        self.refresh();
        let Pending { what, peer, asked_ns, until } = pending;
        let late = Instant::now() >= until;
        match what {
            What::Arm(ticket) => match self.arming(ticket, asked_ns, late) {
                Some(outcome) => self.over("arm", peer, outcome),
                None => Step::Pending(Pending { what, peer, asked_ns, until }),
            },
            What::Acknowledge(ticket) => match self.acknowledging(ticket, late) {
                Some(outcome) => self.over("acknowledge", peer, outcome),
                None => Step::Pending(Pending { what, peer, asked_ns, until }),
            },
            What::Disarm => match self.disarming(asked_ns, late) {
                Some(outcome) => self.over("disarm", peer, outcome),
                None => Step::Pending(Pending { what, peer, asked_ns, until }),
            },
            What::Reading { from, name } => match from.try_recv() {
                Ok(read) => self.reference_read(read, name, peer),
                Err(TryRecvError::Empty) if !late => {
                    Step::Pending(Pending { what: What::Reading { from, name }, peer, asked_ns, until })
                }
                Err(_) => {
                    // The thread that reads may hang in a file system; its answer goes nowhere.
                    self.reading = false;
                    let why = format!("{name}: it could not be read within {} ms", READ_TIME.as_millis());
                    self.over("reference", peer, Err(why))
                }
            },
            What::Aside { from, what } => match from.try_recv() {
                Ok(outcome) => {
                    self.working = false;
                    self.over_saying(&what, peer, outcome)
                }
                Err(TryRecvError::Empty) if !late => {
                    Step::Pending(Pending { what: What::Aside { from, what }, peer, asked_ns, until })
                }
                Err(_) => {
                    self.working = false;
                    let why = format!("it was not done within {} s", WORK_TIME.as_secs());
                    self.over(&what, peer, Err(why))
                }
            },
            What::Explore { ticket, switch } => match self.exploring(ticket, switch, asked_ns, late) {
                Some(outcome) => self.over_saying(exploring_name(switch), peer, outcome),
                None => Step::Pending(Pending { what, peer, asked_ns, until }),
            },
            What::Checking { from, name } => match from.try_recv() {
                Ok(checked) => self.experiment_checked(checked, &name, peer),
                Err(TryRecvError::Empty) if !late => {
                    Step::Pending(Pending { what: What::Checking { from, name }, peer, asked_ns, until })
                }
                Err(_) => {
                    self.working = false;
                    let why = format!("it was not checked within {} s", WORK_TIME.as_secs());
                    self.over(&format!("experiment {name}"), peer, Err(why))
                }
            },
            What::Experiment { ticket, experiment } => match self.options.mailbox.fate(ticket) {
                Fate::Waiting if !late => {
                    Step::Pending(Pending { what: What::Experiment { ticket, experiment }, peer, asked_ns, until })
                }
                _ => self.experiment_settled(ticket, &experiment, peer),
            },
            What::Reference { ticket, name, csv } => match self.options.mailbox.fate(ticket) {
                Fate::Taken => {
                    self.reference_taken(&name, csv);
                    self.over(&format!("reference {name}"), peer, Ok(()))
                }
                Fate::Waiting if !late => {
                    Step::Pending(Pending { what: What::Reference { ticket, name, csv }, peer, asked_ns, until })
                }
                Fate::Waiting if !self.options.mailbox.withdraw(ticket) => {
                    self.reference_taken(&name, csv);
                    self.over(&format!("reference {name}"), peer, Ok(()))
                }
                Fate::Waiting | Fate::Withdrawn => {
                    let why = format!("no tick took it; {}", self.no_session());
                    self.over(&format!("reference {name}"), peer, Err(why))
                }
            },
        }
    }

    /// The client has left: what the tick has not taken yet is withdrawn. A disarming stands.
    pub fn gone(&mut self, pending: Pending) {
        let Pending { what, peer, .. } = pending;
        let withdrawn = "the client went away; withdrawn".to_owned();
        match what {
            What::Arm(ticket) if self.options.mailbox.withdraw(ticket) => self.record("arm", peer, &Err(withdrawn)),
            What::Arm(_) => {
                self.record("arm", peer, &Ok(()));
                self.options.running.armed_by = Some(stamp(peer));
            }
            What::Acknowledge(ticket) => {
                let outcome = if self.options.mailbox.withdraw(ticket) { Err(withdrawn) } else { Ok(()) };
                self.record("acknowledge", peer, &outcome);
            }
            What::Disarm => self.record("disarm", peer, &Ok(())),
            What::Reading { .. } => {
                self.reading = false;
                self.record("reference", peer, &Err(withdrawn));
            }
            What::Aside { what, .. } => {
                self.working = false;
                let unknown = "the client went away before it was told what came of it".to_owned();
                self.record(&what, peer, &Err(unknown));
            }
            What::Explore { ticket, switch } => {
                let outcome = if self.options.mailbox.withdraw(ticket) { Err(withdrawn) } else { Ok(()) };
                self.record(exploring_name(switch), peer, &outcome);
            }
            What::Checking { name, .. } => {
                self.working = false;
                self.record(&format!("experiment {name}"), peer, &Err(withdrawn));
            }
            What::Experiment { ticket, experiment } => {
                // What a tick has taken goes on without whoever asked for it.
                let _ = self.experiment_settled(ticket, &experiment, peer);
            }
            What::Reference { ticket, name, csv } => {
                let outcome = if self.options.mailbox.withdraw(ticket) {
                    Err(withdrawn)
                } else {
                    self.reference_taken(&name, csv);
                    Ok(())
                };
                self.record(&format!("reference {name}"), peer, &outcome);
            }
        }
    }

    /// Takes over the references of configurations that were read again; never while the rig is controlled.
    pub fn take_reloads(&mut self) {
        while let Ok(Reloaded { config, reference }) = self.options.reloads.try_recv() {
            self.refresh();
            let (Some(reference), Some(file)) = (reference, config.reference.file) else { continue };
            let name = file.display().to_string();
            let runs = self.live_status().is_some_and(|s| controls(&s));
            let csv = reference.to_csv();
            let taken = !runs
                && self.live_status().is_some()
                && self.options.mailbox.ask(Request::Reference(Box::new(reference)), u64::MAX).is_some();
            let text = if taken {
                self.reference_taken(&name, csv);
                format!("reference {name} taken over")
            } else {
                format!(
                    "reference {name} not taken over: that needs a session and a rig that is not controlled; `controller reference {name}` does it at any time"
                )
            };
            self.options.notes.note(now_ns(), EventLevel::Info, "reload", text);
        }
    }

    /// Looks whether an experiment is over, and concludes it.
    pub fn look_after_experiments(&mut self) {
        if let Some(experiments) = &mut self.experiments {
            experiments.look(&self.options.mailbox, &self.options.notes);
        }
    }

    /// Whether an experiment is under way and this would come between: everything but looking on and stopping, and where
    /// something waits for a person after it was stopped, acknowledging.
    fn comes_between(&self, ask: &Ask) -> bool {
        let within = self.experiments.as_ref().is_some_and(ExperimentDesk::is_playing);
        match ask {
            Ask::Status {} | Ask::Policies {} | Ask::Disarm {} | Ask::Explore { switch: Switch::Off, .. } => false,
            Ask::Acknowledge {} => self.options.may == May::OnlyStop,
            _ => within || self.options.may == May::OnlyStop,
        }
    }

    fn start_exploring(&self, switch: Switch, seed: Option<u32>) -> Result<Ticket, String> {
        if switch == Switch::On {
            let Some(handle) = &self.options.policies else { return Err(NO_POLICIES.to_owned()) };
            exploration_desk::why_not(self.live_status().as_ref(), handle).map_or(Ok(()), Err)?;
            if let Some(problem) = self.options.health.why_not_arm() {
                return Err(format!("it would not be recorded: {problem}"));
            }
        }
        let rules = exploration_desk::rules(switch, seed, self.options.exploration);
        let until_ns = now_ns().saturating_add(EFFECT_TIME.as_nanos() as u64);
        let asked = self.options.mailbox.ask(Request::Explore(rules), until_ns);
        asked.ok_or_else(|| "too many requests wait; try again".to_owned())
    }

    /// Whether switching exploration is over, and how; `None` while it may still go either way.
    fn exploring(&self, ticket: Ticket, switch: Switch, asked_ns: u64, late: bool) -> Option<Result<String, String>> {
        let fate = self.options.mailbox.fate(ticket);
        let shown = self.newest.filter(|(_, at_ns)| *at_ns > asked_ns);
        let outcome = shown.and_then(|(status, _)| exploration_desk::outcome(switch, &status));
        match (fate, outcome) {
            (Fate::Taken, Some(outcome)) => Some(outcome),
            (Fate::Waiting | Fate::Taken, _) if !late => None,
            (Fate::Waiting, _) if self.options.mailbox.withdraw(ticket) => {
                Some(Err(format!("no tick took it in time, so it was withdrawn; {}", self.no_session())))
            }
            (Fate::Withdrawn, _) => {
                Some(Err("it was not carried out: a disarming came after it, or no tick in time".to_owned()))
            }
            _ => {
                Some(Err("no policy has all of the command at this moment; `controller policies` tells why".to_owned()))
            }
        }
    }

    fn start_experiment(&self, name: &str, csv: String) -> Result<Receiver<Result<Box<Experiment>, String>>, String> {
        let (Some(experiments), Some(handle)) = (&self.experiments, &self.options.policies) else {
            return Err(NO_EXPERIMENTS.to_owned());
        };
        if !experiments.is_free() {
            return Err("the recording of the last experiment is being finished; try again".to_owned());
        }
        if self.working {
            return Err("a policy, a model or another experiment is being checked; try again".to_owned());
        }
        self.why_no_experiment().map_or(Ok(()), Err)?;
        let models = handle.models.clone();
        experiment_desk::check_aside(name.to_owned(), csv, move || models.rig(), self.options.safety)
    }

    /// Why none can begin now: it begins from standing by or from control, and it is recorded.
    fn why_no_experiment(&self) -> Option<String> {
        let Some(status) = self.live_status() else { return Some(self.no_session()) };
        let ready = status.state == State::Run || status.can_arm;
        if !ready {
            let name = status.state.as_str();
            return Some(format!(
                "it is {name}; an experiment begins while it stands by and can be armed, or controls (`controller status`)"
            ));
        }
        self.options.health.why_not_arm().map(|problem| format!("it would not be recorded: {problem}"))
    }

    fn experiment_checked(&mut self, checked: Result<Box<Experiment>, String>, name: &str, peer: Peer) -> Step {
        self.working = false;
        let experiment = match checked {
            Ok(experiment) => experiment,
            Err(why) => {
                self.record(&format!("experiment {name}"), peer, &Err(why.clone()));
                let mut reply = self.reply(Err(why));
                reply.bad_input = true;
                return Step::Done(Box::new(reply));
            }
        };
        let asked_ns = now_ns();
        let until_ns = asked_ns.saturating_add(EFFECT_TIME.as_nanos() as u64);
        let refused = self.why_no_experiment();
        let ticket = match (&self.experiments, refused) {
            (_, Some(why)) => Err(why),
            (None, None) => Err(NO_EXPERIMENTS.to_owned()),
            (Some(experiments), None) => {
                let asked = self.options.mailbox.ask(Request::Experiment(experiments.expect(&experiment)), until_ns);
                asked.ok_or_else(|| "too many requests wait; try again".to_owned())
            }
        };
        match ticket {
            Ok(ticket) => Step::Pending(Pending {
                what: What::Experiment { ticket, experiment },
                peer,
                asked_ns,
                until: Instant::now() + EFFECT_TIME,
            }),
            Err(why) => {
                self.experiments.iter().for_each(ExperimentDesk::not_begun);
                self.over(&format!("experiment {name}"), peer, Err(why))
            }
        }
    }

    /// The tick has taken the experiment, or never will.
    fn experiment_settled(&mut self, ticket: Ticket, experiment: &Experiment, peer: Peer) -> Step {
        let what = format!("experiment {}", experiment.sequence.source());
        if self.options.mailbox.withdraw(ticket) {
            self.experiments.iter().for_each(ExperimentDesk::not_begun);
            return self.over(&what, peer, Err(format!("no tick took it; {}", self.no_session())));
        }
        if let Some(experiments) = &mut self.experiments {
            experiments.begun(experiment, peer);
        }
        self.options.notes.attach(attachment(attached::EXPERIMENT, "text/csv", experiment.sequence.bytes()));
        self.over_saying(&what, peer, Ok("the experiment has begun".to_owned()))
    }

    /// An answer to what is no request.
    pub fn refuse(&mut self, why: &str) -> Reply {
        self.refresh();
        self.reply(Err(why.to_owned()))
    }

    fn list_policies(&mut self) -> Step {
        let Some(handle) = &self.options.policies else { return self.done(Err(NO_POLICIES.to_owned())) };
        let (entries, _) = handle.policies.list();
        let problem = handle.policies.problem();
        let mut reply = self.reply(Ok(()));
        reply.policies = Some(entries);
        reply.policies_problem = problem;
        Step::Done(Box::new(reply))
    }

    /// Starts work on policies or models on a thread of its own: it takes up to some seconds, and disarming waits for nobody.
    fn aside(
        &mut self,
        what: String,
        peer: Peer,
        work: impl FnOnce(PolicyHandle, &str) -> Result<String, String> + Send + 'static,
    ) -> Step {
        let Some(handle) = self.options.policies.clone() else {
            return self.over(&what, peer, Err(NO_POLICIES.to_owned()));
        };
        if self.working {
            return self.over(&what, peer, Err("another policy or model is being loaded; try again".to_owned()));
        }
        let (answer, from) = channel();
        let started = std::thread::Builder::new().name("change".to_owned()).spawn(move || {
            // Who asked may have gone.
            let _ = answer.send(work(handle, &peer.to_string()));
        });
        if let Err(error) = started {
            return self.over(&what, peer, Err(format!("no thread can be started for it: {error}")));
        }
        self.working = true;
        let until = Instant::now() + WORK_TIME;
        Step::Pending(Pending { what: What::Aside { from, what }, peer, asked_ns: now_ns(), until })
    }

    /// As [`Desk::over`], with a line that says what was done.
    fn over_saying(&mut self, what: &str, peer: Peer, outcome: Result<String, String>) -> Step {
        let (done, outcome) = match outcome {
            Ok(text) => (Some(text), Ok(())),
            Err(why) => (None, Err(why)),
        };
        self.record(what, peer, &outcome);
        let mut reply = self.reply(outcome);
        reply.done = done;
        Step::Done(Box::new(reply))
    }

    fn start_acknowledging(&mut self) -> Result<Ticket, String> {
        // Also without a session: a trip of the cRIO that waits for a person bars the next one.
        if self.newest.is_none_or(|(status, _)| status.latched.is_none()) {
            return Err("nothing waits to be acknowledged".to_owned());
        }
        let until_ns = now_ns().saturating_add(EFFECT_TIME.as_nanos() as u64);
        let asked = self.options.mailbox.ask(Request::Acknowledge, until_ns);
        asked.ok_or_else(|| "too many requests wait; try again".to_owned())
    }

    /// Whether acknowledging is over, and how; `None` while it may still go either way.
    fn acknowledging(&self, ticket: Ticket, late: bool) -> Option<Result<(), String>> {
        let waits = self.newest.and_then(|(status, _)| status.latched);
        match self.options.mailbox.fate(ticket) {
            Fate::Taken => match waits {
                None => Some(Ok(())),
                Some(condition) if late => {
                    Some(Err(format!("`{}` still holds, and goes on waiting", condition.name())))
                }
                Some(_) => None,
            },
            Fate::Waiting if !late => None,
            Fate::Waiting if !self.options.mailbox.withdraw(ticket) => Some(Ok(())),
            Fate::Waiting | Fate::Withdrawn => Some(Err("no tick took it in time; try again".to_owned())),
        }
    }

    fn start_arming(&mut self) -> Result<Ticket, String> {
        let Some(status) = self.live_status() else {
            return Err(format!("nothing to arm: {}", self.no_session()));
        };
        if controls(&status) {
            return Err("it is armed already".to_owned());
        }
        if let Some(condition) = status.latched {
            let what = condition.name();
            return Err(format!("`{what}` waits for `controller acknowledge`; look at it first, then arm"));
        }
        if let Some(problem) = self.options.health.why_not_arm() {
            return Err(format!("it would not be recorded: {problem}"));
        }
        if !status.can_arm {
            let name = status.state.as_str();
            return Err(format!("it is {name} and cannot be armed yet; `controller status` tells why"));
        }
        let until_ns = now_ns().saturating_add(EFFECT_TIME.as_nanos() as u64);
        self.options.mailbox.ask(Request::Arm, until_ns).ok_or_else(|| "too many requests wait; try again".to_owned())
    }

    /// Whether arming is over, and how; `None` while it may still go either way.
    fn arming(&mut self, ticket: Ticket, asked_ns: u64, late: bool) -> Option<Result<(), String>> {
        let fate = self.options.mailbox.fate(ticket);
        let runs = self.newest.is_some_and(|(s, at_ns)| controls(&s) && at_ns > asked_ns);
        match fate {
            Fate::Taken if runs => Some(Ok(())),
            Fate::Withdrawn => {
                Some(Err("it was not carried out: a disarming came after it, or no tick in time".to_owned()))
            }
            Fate::Waiting | Fate::Taken if !late => None,
            Fate::Waiting if self.options.mailbox.withdraw(ticket) => {
                Some(Err(format!("no tick took it in time, so it was withdrawn; {}", self.no_session())))
            }
            Fate::Waiting | Fate::Taken => {
                // The tick has taken it and the rig does not run: it must not begin to later on.
                self.options.mailbox.disarm();
                Some(Err("it did not start in time, so it was disarmed; `controller status` tells why".to_owned()))
            }
        }
    }

    fn disarming(&self, asked_ns: u64, late: bool) -> Option<Result<(), String>> {
        let seen = !self.options.mailbox.disarm_waits();
        let vents = self.newest.is_some_and(|(s, at_ns)| !controls(&s) && at_ns > asked_ns);
        if seen && vents {
            return Some(Ok(()));
        }
        // Without a session nothing is sent, the cRIO has vented by its time to live, and the disarming stands.
        if self.live_status().is_none() {
            return Some(Ok(()));
        }
        late.then(|| Err("it still runs; the disarming stands for the next tick".to_owned()))
    }

    fn reference_read(&mut self, read: Result<Reference, String>, name: String, peer: Peer) -> Step {
        self.reading = false;
        let reference = match read.and_then(|r| match reference_limits::check(&r, &self.options.safety) {
            Margin::Beyond(why) => Err(format!("{name}: {why}")),
            Margin::Close(_) | Margin::Wide => Ok(r),
        }) {
            Ok(reference) => reference,
            Err(why) => return self.over("reference", peer, Err(why)),
        };
        let asked_ns = now_ns();
        let until_ns = asked_ns.saturating_add(EFFECT_TIME.as_nanos() as u64);
        let csv = reference.to_csv();
        match self.options.mailbox.ask(Request::Reference(Box::new(reference)), until_ns) {
            Some(ticket) => Step::Pending(Pending {
                what: What::Reference { ticket, name, csv },
                peer,
                asked_ns,
                until: Instant::now() + EFFECT_TIME,
            }),
            None => self.over("reference", peer, Err("too many requests wait; try again".to_owned())),
        }
    }

    /// The tick follows another reference: those who ask are told, and the recording holds it.
    fn reference_taken(&mut self, name: &str, csv: String) {
        name.clone_into(&mut self.options.running.reference);
        self.options.notes.attach(attachment(attached::REFERENCE, "text/csv", csv));
    }

    /// Records and answers a request that is over.
    fn over(&mut self, what: &str, peer: Peer, outcome: Result<(), String>) -> Step {
        self.record(what, peer, &outcome);
        match (what, &outcome) {
            ("arm", Ok(())) => self.options.running.armed_by = Some(stamp(peer)),
            ("disarm", Ok(())) => self.options.running.armed_by = None,
            _ => {}
        }
        self.done(outcome)
    }

    fn record(&self, what: &str, peer: Peer, outcome: &Result<(), String>) {
        let (level, how) = match outcome {
            Ok(()) => (EventLevel::Info, "done".to_owned()),
            Err(why) => (EventLevel::Warning, format!("refused: {why}")),
        };
        self.options.notes.note(now_ns(), level, "operator", format!("{what} by {peer}: {how}"));
    }

    fn done(&mut self, outcome: Result<(), String>) -> Step {
        Step::Done(Box::new(self.reply(outcome)))
    }

    fn refresh(&mut self) {
        if let Some(shown) = self.options.mailbox.status() {
            self.newest = Some(shown);
        }
    }

    fn age(&self) -> Option<Duration> {
        self.newest.map(|(_, at_ns)| Duration::from_nanos(now_ns().saturating_sub(at_ns)))
    }

    /// The newest status, if it still tells what is.
    fn live_status(&self) -> Option<Status> {
        let fresh = self.age().is_some_and(|age| age <= self.options.stale);
        self.newest.filter(|_| fresh).map(|(status, _)| status)
    }

    fn no_session(&self) -> String {
        match self.age() {
            Some(age) if age > self.options.stale => {
                format!("no session with the cRIO, last data {:.1} s ago", age.as_secs_f64())
            }
            Some(_) => "the cRIO answers".to_owned(),
            None => "no session with the cRIO yet".to_owned(),
        }
    }

    fn reply(&mut self, outcome: Result<(), String>) -> Reply {
        let live = self.live_status();
        let runs = live.is_some_and(|s| controls(&s));
        let mut running = self.options.running.clone();
        running.armed_by = running.armed_by.filter(|_| runs);
        if let Some(handle) = &self.options.policies {
            (running.policy, running.policy_sha256) = handle.policies.active();
            running.model = handle.models.name();
            running.why_fallback = handle.policies.why_fallback();
        }
        Reply {
            ok: outcome.is_ok(),
            error: outcome.err(),
            state: live.map_or(State::Connect, |s| s.state),
            // Without a session the last readings are history: nothing is followed, nothing can be armed.
            status: live.or(self.newest.map(|(s, _)| Status { can_arm: false, reference_kpa: None, ..s })),
            age_ms: self.age().map(|age| u64::try_from(age.as_millis()).unwrap_or(u64::MAX)),
            running,
            done: None,
            policies: None,
            policies_problem: None,
            experiment: self.experiments.as_ref().and_then(|e| e.view(live.and_then(|s| s.experiment))),
            bad_input: false,
            recording_problem: self.options.health.error().or_else(|| self.options.health.why_not_arm()),
        }
    }
}

fn exploring_name(switch: Switch) -> &'static str {
    match switch {
        Switch::On => "explore on",
        Switch::Off => "explore off",
    }
}

/// Who, and when by the wall clock.
fn stamp(peer: Peer) -> String {
    let seconds = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
    format!("{peer} at {}", rfc3339(UNIX_EPOCH + Duration::from_secs(seconds)))
}

/// Reads and checks a reference on a thread of its own: a file system that hangs holds nobody else.
fn read_aside(file: PathBuf, csv: Option<String>) -> Result<Receiver<Result<Reference, String>>, String> {
    let (answer, from) = channel();
    let work = move || {
        let name = file.display().to_string();
        let read = match csv {
            // The text is the client's own, so it may be quoted back.
            Some(text) => Reference::parse(&name, text.as_bytes()).map_err(|e| e.to_string()),
            None => Reference::read(&file).map_err(|error| without_cells(&file, &error)),
        };
        // Who asked may have gone.
        let _ = answer.send(read);
    };
    std::thread::Builder::new()
        .name("reference".to_owned())
        .spawn(work)
        .map_err(|e| format!("no thread can be started to read it: {e}"))?;
    Ok(from)
}

/// What is wrong with a file that the daemon read with rights of its own: where, never what stands there.
fn without_cells(file: &Path, error: &ReferenceError) -> String {
    if let ReferenceError::Read { .. } = error {
        return error.to_string();
    }
    let name = file.display().to_string();
    let text = error.to_string();
    let place = text
        .strip_prefix(&format!("{name}: "))
        .and_then(|rest| rest.split_once(": "))
        .map(|(place, _)| place)
        .filter(|place| place.starts_with("line "));
    // `line 3, column 2 (name)`: the name comes out of the file, too.
    let place = place.and_then(|place| place.split(" (").next()).map(|place| format!(", {place}")).unwrap_or_default();
    format!("{name}{place}: no reference that can be followed; needed is CSV with time_s,ref_pos_kpa,ref_neg_kpa")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_of_somebody_else_is_not_read_out() {
        let folder = std::env::temp_dir().join(format!("desk-cells-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        for (text, place) in [
            ("root:$6$secret:19000:0:99999:7:::\n", ""),
            ("secret,other\n1,2\n", ""),
            ("time_s,ref_pos_kpa,ref_neg_kpa\n0,secret,-70\n", "line 2, column 2"),
            ("secret;x;y\n1;2;3\n", ""),
            ("time_s,secret,secret\n0,1,2\n", ""),
        ] {
            let file = folder.join("shadow");
            std::fs::write(&file, text).unwrap();
            let said = without_cells(&file, &Reference::read(&file).unwrap_err());
            assert!(!said.contains("secret") && said.contains(place) && !said.contains('\n'), "{said}");
        }
        std::fs::remove_dir_all(folder).unwrap();
    }
}

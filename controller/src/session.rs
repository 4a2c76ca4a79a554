//! The tick's thread: sessions one after the other (or one only, as the duty source needs). What happens within one stands in
//! `session_loop`.

pub mod attribution;
pub mod link;
pub mod live_stream;
pub mod pacing;
pub(crate) mod recording_folder;
pub mod run_length;
mod run_watch;
pub(crate) mod session_loop;
pub mod session_recorder;

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use flight::RecordSink;
use monitor::Pacing as GatePacing;
use proto::recording::TickInput;
use supervisor::State;

use crate::config::{Config, Pacing};
use crate::cycle::Cycle;
use crate::cycle::duty_source::DutySource;
use crate::machine::clock::now_ns;
use crate::machine::guard::Pulse;
use crate::machine::realtime::{MemoryLock, Rights, make_realtime};
use crate::operator::mailbox::{Request, Spent, Status, TickMailbox};
use crate::operator::notice::Notice;
use crate::session::attribution::StolenTime;
use crate::session::link::{Link, LinkError, LookUp};
use crate::session::run_length::{Armed, RunEnd, RunLength};
use crate::session::session_loop::{Counts, Ending, one_session};

/// Pauses between attempts to connect, the last for ever after.
const PAUSES_MS: [u64; 5] = [100, 200, 500, 1000, 2000];
/// Time between two reminders that there is still no link: a minute.
const REMIND_NS: u64 = 60_000_000_000;
/// Time between two looks of a pause for requests.
const LOOK_MS: u64 = 20;

/// State that the tick's thread works with.
pub struct Session<H> {
    /// Configuration.
    pub config: Config,
    /// The cycle.
    pub cycle: Cycle<H>,
    /// Place where records and notices go.
    pub sink: RecordSink,
    /// Status out, requests in.
    pub mailbox: TickMailbox,
    /// Set to end it.
    pub stop: Arc<AtomicBool>,
    /// Length of the run.
    pub length: RunLength,
    /// Inputs that reached the next tick beside frames, for its record.
    pub inputs: u32,
    /// Told, outside of sessions only, what a person should know.
    pub say: Box<dyn FnMut(String) + Send>,
    /// Pulse that the guard watches.
    pub pulse: Arc<Pulse>,
    /// Stolen time of this machine.
    pub stolen: StolenTime,
    /// Lock of all memory.
    pub memory: MemoryLock,
    /// Newest status, shown on while there is no session.
    pub status: Status,
}

/// Runs until told to stop, or the run is over, and hands the cycle back with the end that the run came to.
///
/// # Errors
/// With a duty source of one session: there is no link.
///
/// # Real-time
/// This is the real-time thread. Between sessions it waits, allocates and speaks; within one it does not.
pub fn run_session<H: DutySource>(mut session: Session<H>) -> Result<(Cycle<H>, RunEnd), LinkError> {
    session.pulse.begin();
    let (pacing, refused) = match session.config.link.pacing {
        Pacing::Realtime => (GatePacing::RealTime, make_realtime(&session.config.realtime)),
        // The cRIO waits for every answer, so nothing is late; and a thread that never waits, with the priority of another daemon's
        // tick, would keep that from its CPU for as long as it liked.
        Pacing::Lockstep => (GatePacing::Lockstep, Vec::new()),
    };
    let rights = Rights::of(refused, session.memory.clone(), &session.config);
    for refused in rights.lines() {
        (session.say)(refused.clone());
    }
    if let Some(condition) = rights.bar_arming()
        && H::ONE_SESSION
    {
        // A sequence arms itself; it would wait for ever.
        session.cycle.refuse(condition);
    }
    let mut counts = Counts::new(rights.bar_arming());
    let mut attempt = 0;
    let mut told = (String::new(), 0);
    session.length.started(now_ns());
    while !is_over(&session) {
        if !session.cycle.may_open_session() {
            tell_once(&mut session, &mut told, BARRED.to_owned());
            wait(&mut session, PAUSES_MS[1]);
            continue;
        }
        let Some(candidates) = look_up(&mut session) else { continue };
        match candidates.and_then(|found| Link::open(&session.config.link.address, &found, pacing)) {
            Ok(mut link) => {
                (attempt, told) = (0, (String::new(), 0));
                let ending = one_session(&mut session, &mut link, &mut counts);
                session.pulse.leave_session();
                match ending {
                    Ending::Finished => break,
                    Ending::Lost | Ending::Tripped if H::ONE_SESSION => break,
                    Ending::Lost => wait(&mut session, PAUSES_MS[0]),
                    Ending::Tripped => wait(&mut session, PAUSES_MS[2]),
                }
            }
            Err(error) if H::ONE_SESSION => return Err(error),
            Err(error) => {
                tell_once(&mut session, &mut told, format!("{error} (trying again)"));
                wait(&mut session, PAUSES_MS.get(attempt).or(PAUSES_MS.last()).copied().unwrap_or(1000));
                attempt += 1;
            }
        }
    }
    // Also where no session was open to be ended; where one was, this changes nothing.
    session.cycle.stop(&mut |_| ());
    let end = session.length.end(now_ns());
    Ok((session.cycle, end))
}

/// Addresses of the cRIO. Requests are taken while its name is looked up; `None` where the run is over before that is.
fn look_up<H: DutySource>(session: &mut Session<H>) -> Option<Result<Vec<SocketAddr>, LinkError>> {
    if let Ok(address) = session.config.link.address.parse() {
        return Some(Ok(vec![address]));
    }
    let look_up = match LookUp::begin(&session.config.link.address) {
        Ok(look_up) => look_up,
        Err(error) => return Some(Err(error)),
    };
    while !look_up.is_over() {
        if is_over(session) {
            return None;
        }
        wait(session, LOOK_MS);
    }
    Some(look_up.addresses())
}

/// Said while a trip of the cRIO waits for a person.
const BARRED: &str =
    "the cRIO tripped, and a new session would undo that: `controller acknowledge` once it is looked at";

fn is_over<H>(session: &Session<H>) -> bool {
    session.stop.load(Ordering::Relaxed) || session.length.is_over(now_ns())
}

/// Tells a trouble once and then now and again, not with every attempt.
fn tell_once<H>(session: &mut Session<H>, told: &mut (String, u64), text: String) {
    if text != told.0 || now_ns().saturating_sub(told.1) >= REMIND_NS {
        (session.say)(text.clone());
        *told = (text, now_ns());
    }
}

/// Waits without a session; requests of the operator are taken meanwhile.
fn wait<H: DutySource>(session: &mut Session<H>, ms: u64) {
    let until = now_ns() + ms * 1_000_000;
    loop {
        // One at a time: a recording says what was asked for between two sessions and in which order, not what came at once.
        while let Some(request) = session.mailbox.request() {
            serve_request(session, request);
            still_waiting(session);
        }
        hand_back(session);
        still_waiting(session);
        show_waiting(session);
        session.pulse.beat();
        if now_ns() >= until || is_over(session) {
            return;
        }
        std::thread::sleep(Duration::from_millis(LOOK_MS));
    }
}

fn still_waiting<H: DutySource>(session: &mut Session<H>) {
    let Session { cycle, sink, .. } = session;
    cycle.waiting(&mut |notice| tell(sink, notice));
}

/// The newest numbers with the state that they no longer have.
pub(crate) fn show_waiting<H: DutySource>(session: &mut Session<H>) {
    let memory = session.cycle.memory();
    session.status = Status {
        state: memory.state,
        fault: memory.cause,
        latched: memory.latched.worst(supervisor::Severity::Vent),
        waiting: (&memory.latched).into(),
        session: 0,
        can_arm: false,
        bars_arming: None,
        reference_kpa: None,
        // Without a session the cRIO vents by itself.
        duty: [1.0; 2],
        reported_duty: None,
        experiment: None,
        exploration: None,
        ..session.status
    };
    session.mailbox.show_as_of(session.status, session.status.received_ns);
}

/// Takes what the operator asks for, and notes it for the tick's record ([`TickInput`]).
///
/// # Real-time
/// Runs in the tick.
pub(crate) fn serve_requests<H: DutySource>(session: &mut Session<H>) {
    while let Some(request) = session.mailbox.request() {
        serve_request(session, request);
    }
    hand_back(session);
}

fn serve_request<H: DutySource>(session: &mut Session<H>, request: Request) {
    match request {
        Request::Arm => {
            session.cycle.arm();
            TickInput::Arm.append(&mut session.inputs);
        }
        Request::Disarm => {
            session.cycle.disarm();
            TickInput::Disarm.append(&mut session.inputs);
        }
        Request::Acknowledge => {
            session.cycle.acknowledge();
            TickInput::Acknowledge.append(&mut session.inputs);
        }
        Request::Reference(reference) => {
            let old = session.cycle.exchange_reference(reference);
            session.mailbox.retire(Spent::Reference(old));
            TickInput::Reference.append(&mut session.inputs);
        }
        Request::Explore(rules) => {
            session.cycle.explore(rules);
            TickInput::Explore.append(&mut session.inputs);
        }
        Request::Experiment(playback) => {
            let Session { cycle, sink, .. } = session;
            match cycle.begin_experiment(playback, &mut |notice| tell(sink, notice)) {
                Ok(()) => TickInput::Experiment.append(&mut session.inputs),
                Err(playback) => session.mailbox.retire(Spent::Experiment(playback)),
            }
        }
    }
}

/// Gives back an experiment that is over.
fn hand_back<H: DutySource>(session: &mut Session<H>) {
    if let Some(playback) = session.cycle.take_finished_experiment() {
        session.mailbox.hand_back(playback);
    }
}

pub(crate) fn tell(sink: &mut RecordSink, notice: Notice) {
    sink.event(notice.event(now_ns()));
}

/// Tells whether a state counts as under control, for how long a run lasts.
pub(crate) fn is_armed(state: State) -> Armed {
    if state.is_controlling() { Armed::Yes } else { Armed::No }
}

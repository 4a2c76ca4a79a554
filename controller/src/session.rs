//! The tick's thread: sessions one after the other (or one only, as the duty source needs), and in each the loop that answers
//! every frame.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use flight::RecordSink;
use proto::recording::{Arrival, TickInput, TickRecord};
use proto::wire::{ByeReason, Command, DEFAULT_TTL_TICKS, RawFrame, Sense};

use crate::clock::now_ns;
use crate::config::{Config, Pacing};
use crate::cycle::Cycle;
use crate::duty_source::{ActuatorCommand, DutySource};
use crate::link::{Incoming, Link, LinkError};
use crate::mailbox::{Request, Status, TickMailbox};
use crate::notice::Notice;
use crate::pacing::{COMMAND_DEADLINE_NS, Grid};
use crate::realtime::make_realtime;
use crate::run_length::{Armed, RunLength};
use crate::state::State;

/// Ticks without a frame after which the link counts as lost: 1 s.
const LINK_LOST_TICKS: u32 = 50;
/// In lockstep a cRIO that is silent for this long is gone.
const LOCKSTEP_PATIENCE_NS: u64 = 5_000_000_000;
/// How often a wait looks whether it should end.
const STOP_CHECK_NS: u64 = 100_000_000;
/// Pauses between attempts to connect, the last for ever after.
const PAUSES_MS: [u64; 5] = [100, 200, 500, 1000, 2000];
/// How often a person is reminded that there is still no link: once a minute.
const REMIND_NS: u64 = 60_000_000_000;

/// What the tick's thread works with.
pub struct Session<H> {
    /// Configuration.
    pub config: Config,
    /// The cycle.
    pub cycle: Cycle<H>,
    /// Where records and notices go.
    pub sink: RecordSink,
    /// Status out, requests in.
    pub mailbox: TickMailbox,
    /// Set to end it.
    pub stop: Arc<AtomicBool>,
    /// How long it lasts.
    pub length: RunLength,
    /// What reached the next tick beside frames, for its record.
    pub inputs: u32,
    /// Told, outside of sessions only, what a person should know.
    pub say: Box<dyn FnMut(String) + Send>,
}

/// Why a session ended.
enum Ending {
    /// Asked to, or the flight is over.
    Finished,
    /// The link is lost.
    Lost,
    /// The cRIO tripped and waits for a new HELLO.
    Tripped,
}

/// Counts over all sessions.
#[derive(Default)]
struct Counts {
    deadline_misses: u64,
    frames_missed: u64,
    slowest_ns: u64,
}

/// Flies until told to stop, or the flight is over, and hands the cycle back.
///
/// # Errors
/// With a duty source of one session: there is no link.
///
/// # Real-time
/// This is the real-time thread. Between sessions it waits, allocates and speaks; within one it does not.
pub fn run_session<H: DutySource>(mut session: Session<H>) -> Result<Cycle<H>, LinkError> {
    for refused in make_realtime(&session.config.realtime) {
        (session.say)(refused);
    }
    let mut counts = Counts::default();
    let mut attempt = 0;
    let mut told = String::new();
    let mut told_ns = 0;
    session.length.started(now_ns());
    while !session.stop.load(Ordering::Relaxed) && !session.length.is_over(now_ns()) {
        match Link::open(&session.config.link.address) {
            Ok(mut link) => {
                (attempt, told) = (0, String::new());
                match one_session(&mut session, &mut link, &mut counts) {
                    Ending::Finished => break,
                    Ending::Lost | Ending::Tripped if H::ONE_SESSION => break,
                    Ending::Lost => pause(&session.stop, 100),
                    Ending::Tripped => pause(&session.stop, 500),
                }
            }
            Err(error) if H::ONE_SESSION => return Err(error),
            Err(error) => {
                // The same trouble is said once and then now and again, not with every attempt.
                let text = error.to_string();
                if text != told || now_ns().saturating_sub(told_ns) >= REMIND_NS {
                    (session.say)(format!("{text} (trying again)"));
                    (told, told_ns) = (text, now_ns());
                }
                pause(&session.stop, PAUSES_MS.get(attempt).or(PAUSES_MS.last()).copied().unwrap_or(1000));
                attempt += 1;
            }
        }
    }
    Ok(session.cycle)
}

fn pause(stop: &AtomicBool, ms: u64) {
    let until = now_ns() + ms * 1_000_000;
    while now_ns() < until && !stop.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// One session, from the HELLO to its end.
fn one_session<H: DutySource>(session: &mut Session<H>, link: &mut Link, counts: &mut Counts) -> Ending {
    let realtime = session.config.link.pacing == Pacing::Realtime;
    session.cycle.session_opened();
    TickInput::SessionOpened.append(&mut session.inputs);
    tell(&mut session.sink, Notice::SessionOpened { session: link.session() });
    let mut grid: Option<Grid> = None;
    let mut damaged = 0;
    let mut last_heard_ns = now_ns();
    let mut sequence_tick = 0;
    loop {
        serve_requests(session);
        let run_is_over = session.length.is_over(now_ns());
        if run_is_over {
            tell(&mut session.sink, Notice::FlightOver { tick: sequence_tick });
        }
        if run_is_over || session.stop.load(Ordering::Relaxed) {
            part(link, sequence_tick);
            return Ending::Finished;
        }
        let until = match (&grid, realtime) {
            (Some(grid), true) => grid.give_up_ns(),
            _ => now_ns() + STOP_CHECK_NS,
        };
        let mut record =
            TickRecord { session: link.session(), records_dropped: session.sink.dropped(), ..TickRecord::default() };
        // Kept until a tick has taken them: what the cycle itself takes in is appended there.
        record.inputs = session.inputs;
        let incoming = link.receive(Some(until));
        if link.damaged() != damaged {
            damaged = link.damaged();
            record.arrival = Arrival::Damaged;
            tell(&mut session.sink, Notice::FrameDamaged { count: damaged });
        }
        let (answer, due_ns) = match incoming {
            Incoming::Sense { sense, raw, at_ns } => {
                last_heard_ns = at_ns;
                let grid = grid.get_or_insert(Grid::new(at_ns));
                // After frames went missing the numbering tells how many ticks have passed.
                let due_ns = if realtime { grid.due_ns().min(at_ns) } else { at_ns };
                record.arrival_lateness_ns = grid.arrived(at_ns);
                let late = realtime && record.arrival_lateness_ns > crate::pacing::FRAME_GRACE_NS as i64;
                record.arrival = if late { Arrival::Late } else { Arrival::InTime };
                (answer_frame(session, &sense, &raw, at_ns, &mut record), due_ns)
            }
            Incoming::Timeout if grid.is_none() || !realtime => {
                if now_ns() - last_heard_ns > LOCKSTEP_PATIENCE_NS {
                    return lost(session);
                }
                continue;
            }
            Incoming::Timeout => {
                let now = now_ns();
                let Some(grid) = grid.as_mut() else { continue };
                let due_ns = grid.due_ns();
                grid.missed(now);
                counts.frames_missed += 1;
                record.receive_ns = now;
                let late_ms = now.saturating_sub(last_heard_ns) as f64 * 1e-6;
                let Session { cycle, sink, .. } = session;
                (cycle.frame_missing(late_ms, &mut record, &mut |notice| tell(sink, notice)), due_ns)
            }
            Incoming::Lost => return lost(session),
        };
        sequence_tick = record.tick;
        let sending_ns = now_ns();
        let command = command(link, &record, &answer);
        let sent = link.send(&command);
        let sent_ns = now_ns();
        record.command = command;
        record.command_present = sent.is_ok();
        record.send_ns = short(sent_ns - sending_ns);
        record.compute_ns = short(sent_ns.saturating_sub(record.receive_ns));
        let took_ns = sent_ns.saturating_sub(due_ns);
        record.deadline_missed = realtime && took_ns > COMMAND_DEADLINE_NS;
        if record.deadline_missed {
            counts.deadline_misses += 1;
            tell(&mut session.sink, Notice::DeadlineMissed { tick: record.tick, took_ms: took_ns as f64 * 1e-6 });
        }
        counts.slowest_ns = counts.slowest_ns.max(u64::from(record.compute_ns));
        session.cycle.settle();
        session.inputs = 0;
        let armed = if record.state == State::Run.code() { Armed::Yes } else { Armed::No };
        session.length.tick(armed, sent_ns);
        show(session, link, &record, counts);
        keep(session, &record, realtime);
        if sent.is_err() || session.cycle.missing() > LINK_LOST_TICKS {
            return lost(session);
        }
        if session.cycle.is_over() {
            part(link, sequence_tick);
            return Ending::Finished;
        }
        if session.cycle.crio_tripped() {
            link.bye(ByeReason::Fault);
            return Ending::Tripped;
        }
    }
}

/// The whole tick from a frame to its answer.
fn answer_frame<H: DutySource>(
    session: &mut Session<H>,
    sense: &Sense,
    raw: &RawFrame,
    at_ns: u64,
    record: &mut TickRecord,
) -> ActuatorCommand {
    let Session { cycle, sink, .. } = session;
    let mut tell = |notice| tell(sink, notice);
    record.receive_ns = at_ns;
    for (to, from) in record.sense.iter_mut().zip(raw.as_bytes()) {
        *to = *from;
    }
    record.sense_present = true;
    cycle.observe(sense, record, &mut tell);
    let observed_ns = now_ns();
    cycle.predict(record);
    let predicted_ns = now_ns();
    let answer = cycle.decide(record, &mut tell);
    record.receive_check_ns = short(observed_ns.saturating_sub(at_ns));
    record.predict_ns = short(predicted_ns.saturating_sub(observed_ns));
    record.law_ns = short(now_ns().saturating_sub(predicted_ns));
    answer
}

fn command(link: &mut Link, record: &TickRecord, answer: &ActuatorCommand) -> [u8; proto::wire::COMMAND_LENGTH] {
    Command {
        sequence: link.next_sequence(),
        clock_ns: now_ns(),
        session: link.session(),
        tick: record.tick,
        duty: answer.duty.map(|u| u as f32),
        mode: answer.mode,
        ttl_ticks: DEFAULT_TTL_TICKS,
        digital_outputs: if answer.pump_on { Command::PUMP_ON } else { 0 },
    }
    .encode()
}

/// Vents, says BYE.
fn part(link: &mut Link, tick: u32) {
    let vent = TickRecord { tick, ..TickRecord::default() };
    let frame = command(link, &vent, &ActuatorCommand::VENT);
    let _ = link.send(&frame);
    link.bye(ByeReason::Normal);
}

fn lost<H: DutySource>(session: &mut Session<H>) -> Ending {
    let Session { cycle, sink, .. } = session;
    cycle.link_lost(&mut |notice| tell(sink, notice));
    TickInput::LinkLost.append(&mut session.inputs);
    Ending::Lost
}

fn serve_requests<H: DutySource>(session: &mut Session<H>) {
    while let Some(request) = session.mailbox.request() {
        match request {
            Request::Arm => {
                TickInput::Arm.append(&mut session.inputs);
                session.cycle.arm();
            }
            Request::Disarm => {
                TickInput::Disarm.append(&mut session.inputs);
                session.cycle.disarm();
            }
            Request::Reference(reference) => {
                TickInput::Reference.append(&mut session.inputs);
                let old = session.cycle.exchange_reference(reference);
                session.mailbox.retire(old);
            }
        }
    }
}

fn show<H: DutySource>(session: &mut Session<H>, link: &Link, record: &TickRecord, counts: &Counts) {
    let shown = |pair: [f64; 2]| pair.iter().all(|x| x.is_finite()).then_some(pair);
    let follows = record.state == State::Run.code();
    let can_arm = session.cycle.can_arm();
    session.mailbox.show(Status {
        state: record.state,
        fault: record.fault,
        session: link.session(),
        tick: record.tick,
        can_arm,
        pressures_kpa: shown([record.p_pos_kpa, record.p_neg_kpa]),
        reference_kpa: shown([record.ref_pos_kpa, record.ref_neg_kpa]).filter(|_| follows),
        duty: [record.u_pos, record.u_neg],
        deadline_misses: counts.deadline_misses,
        frames_missed: counts.frames_missed,
        slowest_ms: counts.slowest_ns as f64 * 1e-6,
        filter_interventions: session.cycle.filter_interventions(),
    });
}

fn keep<H: DutySource>(session: &mut Session<H>, record: &TickRecord, realtime: bool) {
    // In lockstep nothing is late, so a full queue is waited for; in real time it is counted.
    while !realtime && session.sink.room() == 0 && !session.stop.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(1));
    }
    session.sink.push(record);
}

fn tell(sink: &mut RecordSink, notice: Notice) {
    sink.event(notice.event(now_ns()));
}

fn short(ns: u64) -> u32 {
    u32::try_from(ns).unwrap_or(u32::MAX)
}

//! One session: the loop that answers every frame, from the HELLO to the BYE.

use std::sync::atomic::Ordering;
use std::time::Duration;

use monitor::LossWindow;
use monitor::loss_window::{
    DAMAGED_TO_CLOSE, DEADLINES_IN_A_ROW, DEADLINES_TO_VENT, MISSING_TO_VENT, MISSING_TO_WARN, Outcome,
};
use proto::recording::{Arrival, TickInput, TickRecord};
use proto::wire::{ByeReason, Command, DEFAULT_TTL_TICKS, RawFrame, Sense, TICK_NS};
use supervisor::{Condition, Severity};

use crate::config::Pacing;
use crate::cycle::duty_source::{ActuatorCommand, DutySource};
use crate::machine::clock::now_ns;
use crate::operator::mailbox::Status;
use crate::operator::notice::Notice;
use crate::session::attribution::{TickTimes, thread_cpu_ns};
use crate::session::link::{Broken, Incoming, Link};
use crate::session::pacing::{COMMAND_DEADLINE_NS, FRAME_GRACE_NS, Grid};
use crate::session::{Session, is_armed, serve_requests, show_waiting, tell};

/// Ticks without a frame after which the link counts as lost: 1 s.
const LINK_LOST_TICKS: u32 = 50;
/// In lockstep a cRIO that is silent for this long is gone.
const LOCKSTEP_PATIENCE_NS: u64 = 5_000_000_000;
/// Time between two looks of a wait whether it should end.
const STOP_CHECK_NS: u64 = 100_000_000;

/// Reason why a session ended.
pub(crate) enum Ending {
    /// Asked to, or the run is over.
    Finished,
    /// The link is lost.
    Lost,
    /// The cRIO tripped and waits for a new HELLO.
    Tripped,
}

/// Counts over all sessions, and what bars arming in all of them.
pub(crate) struct Counts {
    deadline_misses: u64,
    frames_missed: u64,
    slowest_ns: u64,
    bars_arming: Option<Condition>,
}

impl Counts {
    /// Nothing counted; `bars_arming` holds in every tick.
    pub(crate) fn new(bars_arming: Option<Condition>) -> Self {
        Counts { deadline_misses: 0, frames_missed: 0, slowest_ns: 0, bars_arming }
    }
}

/// Memory from tick to tick of one session.
struct Watch {
    grid: Option<Grid>,
    last_heard_ns: u64,
    damaged: u64,
    missing: LossWindow,
    deadlines: LossWindow,
    damage: LossWindow,
    scarce_told: bool,
    unrecorded_told: bool,
    /// Time from the frame to the newest command, ms.
    took_ms: f64,
}

/// A tick's answer and when its frame was due.
struct Answered {
    command: ActuatorCommand,
    due_ns: u64,
    outcome: Outcome,
    cpu_ns: u64,
}

/// One session, from the HELLO to its end.
pub(crate) fn one_session<H: DutySource>(session: &mut Session<H>, link: &mut Link, counts: &mut Counts) -> Ending {
    session.cycle.session_opened();
    session.pulse.enter_session();
    tell(&mut session.sink, Notice::SessionOpened { session: link.session() });
    let mut watch = Watch {
        grid: None,
        last_heard_ns: now_ns(),
        damaged: 0,
        missing: LossWindow::new(),
        deadlines: LossWindow::new(),
        damage: LossWindow::new(),
        scarce_told: false,
        unrecorded_told: false,
        took_ms: 0.0,
    };
    TickInput::SessionOpened.append(&mut session.inputs);
    let mut sequence_tick = 0;
    loop {
        serve_requests(session);
        let run_is_over = session.length.is_over(now_ns());
        if run_is_over {
            tell(&mut session.sink, Notice::FlightOver { tick: sequence_tick });
        }
        if run_is_over || session.stop.load(Ordering::Relaxed) {
            return finished(session, link, sequence_tick);
        }
        let mut record =
            TickRecord { session: link.session(), records_dropped: session.sink.dropped(), ..TickRecord::default() };
        let answered = match answer(session, link, counts, &mut watch, &mut record) {
            Ok(Some(answered)) => answered,
            Ok(None) => {
                // A cRIO that has nothing to say yet is no tick that hangs.
                session.pulse.beat();
                continue;
            }
            Err(broken) => return lost(session, link, sequence_tick, broken),
        };
        sequence_tick = record.tick;
        let sent = send(session, link, counts, &mut watch, &mut record, &answered);
        session.pulse.beat();
        show(session, link, &record, counts, watch.last_heard_ns);
        keep(session, &record);
        if !sent {
            // Where the cRIO has said why it reads no more, that is the reason.
            let broken = link.broken().unwrap_or(Broken { condition: Condition::NotRead, value: 0.0 });
            return lost(session, link, sequence_tick, broken);
        }
        if session.cycle.missing() > LINK_LOST_TICKS {
            return lost(session, link, sequence_tick, Broken::silent(u64::from(LINK_LOST_TICKS) * TICK_NS));
        }
        if watch.damage.count() >= DAMAGED_TO_CLOSE {
            let value = f64::from(watch.damage.count());
            return lost(session, link, sequence_tick, Broken { condition: Condition::FramesDamaged, value });
        }
        if session.cycle.is_over() {
            return finished(session, link, sequence_tick);
        }
        if session.cycle.renew_session() {
            link.bye(ByeReason::Fault);
            return Ending::Tripped;
        }
        // Whoever watches only, with one session, has nobody who could acknowledge.
        if H::ONE_SESSION && record.crio_state == proto::wire::CrioState::Tripped.code() {
            link.bye(ByeReason::Fault);
            return Ending::Tripped;
        }
    }
}

/// Waits for a frame, or its deadline, and answers it; `None`: nothing to answer yet.
fn answer<H: DutySource>(
    session: &mut Session<H>,
    link: &mut Link,
    counts: &mut Counts,
    watch: &mut Watch,
    record: &mut TickRecord,
) -> Result<Option<Answered>, Broken> {
    let realtime = session.config.link.pacing == Pacing::Realtime;
    let until = match (&watch.grid, realtime) {
        (Some(grid), true) => grid.give_up_ns(),
        _ => now_ns() + STOP_CHECK_NS,
    };
    let incoming = link.receive(Some(until), &mut |sense| session.cycle.overtaken(sense));
    note_damage(session, link, watch, record);
    match incoming {
        Incoming::Sense { sense, raw, at_ns } => {
            let cpu_ns = thread_cpu_ns();
            watch.last_heard_ns = at_ns;
            link.take_rejection();
            let grid = watch.grid.get_or_insert(Grid::new(at_ns));
            // After frames went missing the numbering tells how many ticks have passed.
            let due_ns = if realtime { grid.due_ns().min(at_ns) } else { at_ns };
            record.arrival_lateness_ns = grid.arrived(at_ns);
            let late = realtime && record.arrival_lateness_ns > FRAME_GRACE_NS as i64;
            record.arrival = if late { Arrival::Late } else { Arrival::InTime };
            record.inputs = std::mem::take(&mut session.inputs);
            report(session, link, counts, watch);
            let command = answer_frame(session, &sense, &raw, at_ns, record);
            Ok(Some(Answered { command, due_ns, outcome: Outcome::Good, cpu_ns }))
        }
        Incoming::Timeout => {
            let now = now_ns();
            let Some(grid) = watch.grid.as_mut().filter(|_| realtime) else {
                if now - watch.last_heard_ns > LOCKSTEP_PATIENCE_NS {
                    return Err(Broken::silent(LOCKSTEP_PATIENCE_NS));
                }
                return Ok(None);
            };
            let due_ns = grid.due_ns();
            grid.missed(now);
            counts.frames_missed += 1;
            record.receive_ns = now;
            let late_ms = now.saturating_sub(watch.last_heard_ns) as f64 * 1e-6;
            if let Some(rejection) = link.take_rejection() {
                let first = session.cycle.missing() == 0;
                let condition = if first { Condition::FrameImplausible } else { Condition::ClockImplausible };
                session.cycle.report(condition, rejection.value());
            }
            record.inputs = std::mem::take(&mut session.inputs);
            report(session, link, counts, watch);
            let cpu_ns = thread_cpu_ns();
            let Session { cycle, sink, .. } = session;
            let command = cycle.frame_missing(late_ms, record, &mut |notice| tell(sink, notice));
            Ok(Some(Answered { command, due_ns, outcome: Outcome::Bad, cpu_ns }))
        }
        Incoming::Lost(broken) => Err(broken),
    }
}

fn note_damage<H: DutySource>(session: &mut Session<H>, link: &mut Link, watch: &mut Watch, record: &mut TickRecord) {
    let count = link.damaged();
    if count == watch.damaged {
        watch.damage.push(Outcome::Good);
        return;
    }
    for _ in watch.damaged..count.min(watch.damaged + u64::from(DAMAGED_TO_CLOSE)) {
        watch.damage.push(Outcome::Bad);
    }
    watch.damaged = count;
    record.arrival = Arrival::Damaged;
    tell(
        &mut session.sink,
        match link.take_misplaced() {
            Some(what) => Notice::FrameMisplaced { count, what },
            None => Notice::FrameDamaged { count },
        },
    );
}

/// Reports what this loop has found since the last tick, which counts in this one.
fn report<H: DutySource>(session: &mut Session<H>, link: &Link, counts: &Counts, watch: &mut Watch) {
    if let Some(condition) = counts.bars_arming {
        session.cycle.report(condition, 0.0);
    }
    if let Some((condition, hz)) = link.wrong_rate() {
        session.cycle.report(condition, hz);
    }
    let unrecorded = !session.sink.would_record();
    if unrecorded {
        session.cycle.report(Condition::NotRecorded, 0.0);
        // A person who asks is answered; what arms itself is told about here.
        if session.config.control.auto_arm && !watch.unrecorded_told && !session.cycle.state().is_controlling() {
            tell(&mut session.sink, Notice::NotRecorded { tick: session.cycle.tick() });
            watch.unrecorded_told = true;
        }
    }
    watch.unrecorded_told &= unrecorded;
    let missing = watch.missing.count();
    if missing > MISSING_TO_VENT {
        session.cycle.report(Condition::FramesLost, f64::from(missing));
    }
    if missing > MISSING_TO_WARN {
        session.cycle.report(Condition::FramesScarce, f64::from(missing));
        if !watch.scarce_told {
            let tick = session.cycle.tick();
            tell(&mut session.sink, Notice::FramesScarce { tick, missing });
        }
    }
    // Told again only once it had been better by half.
    watch.scarce_told = missing > if watch.scarce_told { MISSING_TO_WARN / 2 } else { MISSING_TO_WARN };
    let deadlines = watch.deadlines.count();
    if deadlines >= DEADLINES_TO_VENT || watch.deadlines.in_a_row() >= DEADLINES_IN_A_ROW {
        session.cycle.report(Condition::DeadlinesMissed, f64::from(deadlines));
    } else if watch.deadlines.in_a_row() > 0 {
        session.cycle.report(Condition::DeadlineMissed, watch.took_ms);
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

/// Sends the answer, judges its deadline and moves the models on; answers whether it went out.
fn send<H: DutySource>(
    session: &mut Session<H>,
    link: &mut Link,
    counts: &mut Counts,
    watch: &mut Watch,
    record: &mut TickRecord,
    answered: &Answered,
) -> bool {
    let realtime = session.config.link.pacing == Pacing::Realtime;
    let sending_ns = now_ns();
    let (command, sequence) = command(link, record.tick, &answered.command);
    let sent = link.send(&command);
    let sent_ns = now_ns();
    record.command = command;
    record.command_present = sent.is_ok();
    record.send_ns = short(sent_ns - sending_ns);
    record.compute_ns = short(sent_ns.saturating_sub(record.receive_ns));
    let took_ns = sent_ns.saturating_sub(answered.due_ns);
    watch.took_ms = took_ns as f64 * 1e-6;
    record.deadline_missed = realtime && took_ns > COMMAND_DEADLINE_NS;
    if record.deadline_missed {
        counts.deadline_misses += 1;
        let times = TickTimes {
            wall_ns: u64::from(record.compute_ns),
            cpu_ns: thread_cpu_ns().saturating_sub(answered.cpu_ns),
            run_delay_ns: session.pulse.run_delay_ns(),
            overslept_ns: link.overslept_ns(),
            stolen_ns: session.stolen.total_ns().unwrap_or(0).saturating_sub(session.pulse.stolen_ns()),
        };
        let notice = Notice::DeadlineMissed { tick: record.tick, took_ms: watch.took_ms, cause: times.cause() };
        tell(&mut session.sink, notice);
    }
    watch.deadlines.push(if record.deadline_missed { Outcome::Bad } else { Outcome::Good });
    watch.missing.push(answered.outcome);
    counts.slowest_ns = counts.slowest_ns.max(u64::from(record.compute_ns));
    session.cycle.sent(sequence);
    session.cycle.settle();
    session.length.tick(is_armed(session.cycle.state()), sent_ns);
    sent.is_ok()
}

fn command(link: &mut Link, tick: u32, answer: &ActuatorCommand) -> ([u8; proto::wire::COMMAND_LENGTH], u32) {
    let sequence = link.next_sequence();
    let command = Command {
        sequence,
        clock_ns: now_ns(),
        session: link.session(),
        tick,
        duty: answer.duty.map(|u| u as f32),
        mode: answer.mode,
        ttl_ticks: DEFAULT_TTL_TICKS,
        digital_outputs: if answer.pump_on { Command::PUMP_ON } else { 0 },
    };
    (command.encode(), sequence)
}

/// Ends the session with the run, by the state function as every transition.
fn finished<H: DutySource>(session: &mut Session<H>, link: &mut Link, tick: u32) -> Ending {
    // A run that came to its end has said so.
    let is_told_to = session.stop.load(Ordering::Relaxed);
    let Session { cycle, sink, .. } = session;
    cycle.stop(&mut |notice| {
        if is_told_to {
            tell(sink, notice);
        }
    });
    show_waiting(session);
    part(link, tick, ByeReason::Normal);
    Ending::Finished
}

/// Vents, says BYE.
fn part(link: &mut Link, tick: u32, reason: ByeReason) {
    let (frame, _) = command(link, tick, &ActuatorCommand::VENT);
    let _ = link.send(&frame);
    link.bye(reason);
}

fn lost<H: DutySource>(session: &mut Session<H>, link: &mut Link, tick: u32, broken: Broken) -> Ending {
    let Session { cycle, sink, .. } = session;
    cycle.link_lost(broken.condition, broken.value, &mut |notice| tell(sink, notice));
    TickInput::LinkLost.append(&mut session.inputs);
    // Where somebody still listens, the vent command and the reason reach him before the link closes.
    part(link, tick, broken.bye_reason());
    Ending::Lost
}

fn show<H: DutySource>(
    session: &mut Session<H>,
    link: &Link,
    record: &TickRecord,
    counts: &Counts,
    last_heard_ns: u64,
) {
    let shown = |pair: [f64; 2]| pair.iter().all(|x| x.is_finite()).then_some(pair);
    let follows = session.cycle.state().is_controlling();
    let memory = session.cycle.memory();
    session.status = Status {
        state: memory.state,
        fault: memory.cause.filter(|_| memory.state.is_vented()),
        latched: memory.latched.worst(Severity::Vent),
        waiting: (&memory.latched).into(),
        session: link.session(),
        tick: record.tick,
        received_ns: last_heard_ns,
        can_arm: session.cycle.can_arm(),
        bars_arming: session.cycle.bars_arming(),
        pressures_kpa: shown([record.p_pos_kpa, record.p_neg_kpa]),
        reference_kpa: shown([record.ref_pos_kpa, record.ref_neg_kpa]).filter(|_| follows),
        duty: [record.u_pos, record.u_neg],
        reported_duty: shown([f64::from(record.echo_pos), f64::from(record.echo_neg)]),
        deadline_misses: counts.deadline_misses,
        frames_missed: counts.frames_missed,
        slowest_ms: counts.slowest_ns as f64 * 1e-6,
        filter_interventions: session.cycle.filter_interventions(),
        experiment: session.cycle.duty_source().experiment(),
        exploration: session.cycle.duty_source().exploration(),
    };
    session.mailbox.show(session.status);
}

fn keep<H: DutySource>(session: &mut Session<H>, record: &TickRecord) {
    // In lockstep nothing is late, so a full queue is waited for; in real time it is counted.
    let realtime = session.config.link.pacing == Pacing::Realtime;
    while !realtime && session.sink.room() == 0 && !session.stop.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(1));
    }
    session.sink.push(record);
}

fn short(ns: u64) -> u32 {
    u32::try_from(ns).unwrap_or(u32::MAX)
}

use proto::reference::Reference;

use super::*;
use crate::experiment::command_sequence::Row;
use crate::experiment::pump_relay::PumpRelay;

const FAR: u64 = u64::MAX;

#[test]
fn a_request_is_taken_once_or_never() {
    let (tick, desk) = mailbox();
    let taken = desk.ask(Request::Arm, FAR, desk.stops()).unwrap();
    assert_eq!(desk.fate(taken), Fate::Waiting);
    assert!(matches!(tick.request(), Some(Request::Arm)));
    assert_eq!(desk.fate(taken), Fate::Taken);
    assert!(!desk.withdraw(taken), "it cannot be had back");
    let withdrawn = desk.ask(Request::Arm, FAR, desk.stops()).unwrap();
    assert!(desk.withdraw(withdrawn) && desk.withdraw(withdrawn));
    assert!(tick.request().is_none());
    assert_eq!(desk.fate(withdrawn), Fate::Withdrawn);
}

#[test]
fn what_comes_too_late_is_dropped_and_its_memory_handed_back() {
    let (tick, desk) = mailbox();
    let ticket = desk.ask(Request::Reference(Box::new(Reference::constant(80.0, -70.0))), 1, desk.stops()).unwrap();
    assert!(tick.request().is_none());
    assert_eq!((desk.fate(ticket), tick.shared.retired.len()), (Fate::Withdrawn, 1));
}

/// An acknowledgement is asked for while the rig is vented: that is no reason for which it is not carried out.
#[test]
fn what_came_too_late_on_a_vented_rig_did_not_fall_with_the_venting() {
    let (tick, desk) = mailbox();
    for (request, fate) in [(Request::Acknowledge, Fate::Withdrawn), (experiment(), Fate::Fell)] {
        let ticket = desk.ask(request, 1, desk.stops()).unwrap();
        tick.show(status(State::Vent));
        assert!(tick.request().is_none());
        assert_eq!(desk.fate(ticket), fate);
    }
}

#[test]
fn a_status_tells_which_requests_came_before_it() {
    let (tick, desk) = mailbox();
    let first = desk.ask(Request::Acknowledge, FAR, desk.stops()).unwrap();
    tick.show(status(State::Standby));
    assert!(desk.status().is_some_and(|shown| shown.through < first), "shown before it was taken");
    assert!(tick.request().is_some() && desk.status().is_none(), "taken, and not shown yet");
    let second = desk.ask(Request::Arm, FAR, desk.stops()).unwrap();
    // Without a session the time is that of the last data.
    tick.show_as_of(status(State::Standby), 1);
    assert!(desk.status().is_some_and(|shown| (first..second).contains(&shown.through) && shown.at_ns == 1));
}

#[test]
fn disarming_needs_no_room_and_overrules_what_was_asked_before_it() {
    let (tick, desk) = mailbox();
    let before: Vec<Ticket> = (0..MOST_WAITING).map(|_| desk.ask(Request::Arm, FAR, desk.stops()).unwrap()).collect();
    assert!(desk.ask(Request::Arm, FAR, desk.stops()) == Err(NotAsked::TooMany), "full");
    desk.disarm();
    assert!(desk.disarm_waits());
    assert!(matches!(tick.request(), Some(Request::Disarm)));
    assert!(!desk.disarm_waits());
    assert!(tick.request().is_none(), "an arming asked for before the disarming must not follow it");
    assert!(before.iter().all(|ticket| desk.fate(*ticket) == Fate::Fell));
    desk.ask(Request::Arm, FAR, desk.stops()).unwrap();
    assert!(matches!(tick.request(), Some(Request::Arm)), "asked for after it");
}

fn experiment() -> Request {
    let rows = vec![Row { duty: [0.8, 0.8], pump_on: true }];
    Request::Experiment(Box::new(OpenLoopPlayback::new(rows.into(), PumpRelay::Fitted)))
}

fn status(state: State) -> Status {
    Status { state, session: 1, ..Status::default() }
}

#[test]
fn what_was_asked_for_before_a_disarming_gets_no_ticket_after_it() {
    let (tick, desk) = mailbox();
    let since = desk.stops();
    assert_eq!(desk.stop_since(since), None);
    desk.disarm();
    assert_eq!(desk.stop_since(since), Some(Stop::Disarmed));
    for request in [Request::Arm, experiment(), Request::Reference(Box::new(Reference::constant(80.0, -70.0)))] {
        assert_eq!(desk.ask(request, FAR, since), Err(NotAsked::Stopped(Stop::Disarmed)));
    }
    assert!(matches!(tick.request(), Some(Request::Disarm)) && tick.request().is_none());
    assert!(desk.ask(experiment(), FAR, desk.stops()).is_ok() && tick.request().is_some(), "asked for after it");
}

/// Vented, acknowledged and standing by again before anybody has looked: the state alone tells nothing of it.
#[test]
fn an_experiment_falls_with_a_venting_before_its_ticket_and_after_it() {
    for stopped in [
        Status { fault: Some(Condition::FramesMissing), ..status(State::Vent) },
        Status { fault: Some(Condition::FramesMissing), ..status(State::Fault) },
        Status { latched: Some(Condition::FramesMissing), ..status(State::Standby) },
        Status { session: 0, fault: Some(Condition::FramesMissing), ..status(State::Connect) },
    ] {
        let (tick, desk) = mailbox();
        tick.show(status(State::Run));
        let since = desk.stops();
        let ticket = desk.ask(experiment(), FAR, since).unwrap();
        tick.show(stopped);
        tick.show(status(State::Standby));
        let vented = Stop::Vented(Some(Condition::FramesMissing));
        assert_eq!(desk.ask(experiment(), FAR, since), Err(NotAsked::Stopped(vented)), "{stopped:?}");
        // What moves nothing by itself may go on.
        let reference = Request::Reference(Box::new(Reference::constant(80.0, -70.0)));
        assert!(desk.ask(reference, FAR, since).is_ok());
        assert!(matches!(tick.request(), Some(Request::Reference(_))), "{stopped:?}");
        assert_eq!(desk.fate(ticket), Fate::Fell, "{stopped:?}");
        assert!(desk.withdraw(ticket), "the tick never takes it");
        assert!(desk.ask(experiment(), FAR, desk.stops()).is_ok() && tick.request().is_some());
    }
}

/// Two threads race for each of many tickets: exactly one of them gets it.
#[test]
fn tick_and_withdrawal_never_both_win() {
    let (tick, desk) = mailbox();
    let mut taken = 0_u32;
    std::thread::scope(|scope| {
        let asking = scope.spawn(|| {
            let mut withdrawn = 0_u32;
            for _ in 0..20_000 {
                let ticket = loop {
                    if let Ok(ticket) = desk.ask(Request::Arm, FAR, desk.stops()) {
                        break ticket;
                    }
                    std::thread::yield_now();
                };
                withdrawn += u32::from(desk.withdraw(ticket));
            }
            withdrawn
        });
        while !asking.is_finished() {
            taken += u32::from(tick.request().is_some());
        }
        while tick.request().is_some() {
            taken += 1;
        }
        assert_eq!(taken + asking.join().unwrap(), 20_000);
    });
}

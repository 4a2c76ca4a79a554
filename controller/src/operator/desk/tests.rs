use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::sync::mpsc::channel;

use flight::{Recorder, RecorderOptions};
use proto::recording::RecordingInfo;

use super::reach::Carried;
use super::*;
use crate::operator::latched_conditions::LatchedConditions;
use crate::operator::mailbox::{Status, TickMailbox, mailbox};
use crate::operator::operator_protocol::ECHO_TIME;
use crate::state::{Condition, State};

/// A desk whose tick is the test.
struct Scene {
    tick: TickMailbox,
    desk: Desk,
    peer: Peer,
    folder: PathBuf,
    _recorder: Recorder,
}

impl Scene {
    fn new(name: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("desk-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let info = RecordingInfo::new("desk", 0);
        let (recorder, _sink) =
            Recorder::start(&folder.join("r.mcap"), &info, &[], RecorderOptions::new(|_| String::new())).unwrap();
        let (tick, mailbox) = mailbox();
        let desk = Desk::new(DeskOptions {
            mailbox,
            safety: Safety::default(),
            reference: ReferenceChoice::default(),
            health: recorder.health(),
            notes: recorder.noter(),
            may: May::Fly,
            running: Running::default(),
            followed: Some(Arc::new(Reference::constant(90.0, -70.0))),
            policies: None,
            experiments: None,
            viewers: None,
            exploration: ExplorationRules { seed: 0, std_share: 0.02, most_duty: 0.02 },
            // Longer than the test may stand still on a busy machine.
            stale: Duration::from_secs(60),
            reloads: channel().1,
        });
        let peer = Peer::of(&UnixStream::pair().unwrap().0);
        Scene { tick, desk, peer, folder, _recorder: recorder }
    }

    fn end(self) {
        std::fs::remove_dir_all(self.folder).unwrap();
    }
}

fn pending(step: Step) -> Pending {
    match step {
        Step::Pending(pending) => pending,
        Step::Done(reply) => panic!("answered already: {reply:?}"),
    }
}

fn done(step: Step) -> Reply {
    match step {
        Step::Done(reply) => *reply,
        Step::Pending(_) => panic!("not answered"),
    }
}

const ACKNOWLEDGE: &[u8] = b"{\"ask\":\"acknowledge\"}";

fn vented(waiting: &[Condition]) -> Status {
    Status {
        state: State::Vent,
        session: 1,
        fault: waiting.first().copied(),
        latched: waiting.first().copied(),
        waiting: LatchedConditions::of(waiting.iter().copied()),
        ..Status::default()
    }
}

/// Taken late, and shown later still, also without a session, where a status is as old as the last data.
#[test]
fn an_acknowledgement_waits_for_a_tick_that_shows_what_it_released() {
    let mut scene = Scene::new("acknowledge");
    let (trip, broken) = (Condition::CrioTripped, Condition::SensorNegative);
    scene.tick.show(vented(&[trip, broken]));
    let asked = pending(scene.desk.begin(ACKNOWLEDGE, scene.peer));
    assert!(matches!(scene.tick.request(), Some(Request::Acknowledge)));
    std::thread::sleep(EFFECT_TIME);
    let asked = pending(scene.desk.look(asked));
    let released = Status { session: 0, ..vented(&[broken]) };
    scene.tick.show_as_of(released, 1);
    let told = done(scene.desk.look(asked)).done.unwrap_or_default();
    assert!(told.starts_with("acknowledged: cRIO tripped; still waits: negative sensor broken"), "{told}");
    scene.end();
}

#[test]
fn an_acknowledgement_that_no_tick_shows_says_that_it_was_taken() {
    let mut scene = Scene::new("taken");
    scene.tick.show(vented(&[Condition::CrioTripped]));
    let asked = pending(scene.desk.begin(ACKNOWLEDGE, scene.peer));
    assert!(scene.tick.request().is_some());
    let asked = pending(scene.desk.look(asked));
    std::thread::sleep(ECHO_TIME);
    let reply = done(scene.desk.look(asked));
    assert!(reply.ok && reply.done.as_deref().is_some_and(|told| told.contains("a tick took it")), "{reply:?}");
    scene.end();
}

/// The rig is vented all the while, and that is not why it came to nothing.
#[test]
fn an_acknowledgement_that_came_too_late_says_so() {
    let mut scene = Scene::new("late");
    scene.tick.show(vented(&[Condition::CrioTripped]));
    let asked = pending(scene.desk.begin(ACKNOWLEDGE, scene.peer));
    std::thread::sleep(EFFECT_TIME);
    scene.tick.show(vented(&[Condition::CrioTripped]));
    assert!(scene.tick.request().is_none());
    let why = done(scene.desk.look(asked)).error.unwrap_or_default();
    assert!(why.starts_with("no tick took it in time"), "{why}");
    scene.end();
}

#[test]
fn whoever_armed_is_told_what_has_ended_it_before_the_answer() {
    let mut scene = Scene::new("armed");
    let remark = |scene: &mut Scene, asked| {
        scene.desk.refresh();
        done(scene.desk.over_remarking(Carried::Arming, "arm", Vec::new(), asked)).remark
    };
    let running = Status { state: State::Run, session: 1, ..Status::default() };
    scene.tick.show(running);
    let asked = scene.desk.asked_now(scene.peer, EFFECT_TIME);
    assert_eq!(remark(&mut scene, asked), None);
    scene.tick.show(vented(&[Condition::SensorPositive]));
    let told = remark(&mut scene, asked).unwrap_or_default();
    assert!(told.starts_with("it was armed, and is vented (positive sensor broken) since"), "{told}");
    // Also where that is over by then.
    scene.tick.show(Status { state: State::Standby, ..running });
    let told = remark(&mut scene, asked).unwrap_or_default();
    assert!(told.starts_with("it was armed, and was vented (positive sensor broken) since"), "{told}");
    scene.tick.show(running);
    let asked = scene.desk.asked_now(scene.peer, EFFECT_TIME);
    pending(scene.desk.begin(b"{\"ask\":\"disarm\"}", scene.peer));
    scene.tick.show(Status { state: State::Standby, ..running });
    assert_eq!(remark(&mut scene, asked).as_deref(), Some("it was armed, and was disarmed since"));
    scene.end();
}

//! Orders of operators to a loop that ticks as the test says: what is answered and listed is what the tick did.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use admission::signatures::offered;
use handover::{Arbiter, Candidate, Permit, PolicyTag, channel};
use law::ControlInput;
use model::observation::{AHEAD, GOALS_AHEAD, Pair};
use model::rig::Rig;
use model::shown_reference::ShownReference;
use model::steady::SteadyMap;
use policy::Policy;
use policy_store::{
    ActivePolicy, Adoption, EntryState, Examination, PolicyDesk, PolicyStore, StoreSettings, Voices, WhenBehind,
};
use proto::recording::TickOrder;

/// Places where the rig stands, and is to stand.
const HOLD_KPA: Pair = [85.0, -72.0];
/// Ticks from an order to the end of probation, with some to spare.
const PROBATION: u32 = 700;
/// Ticks after which a candidate that goes straight on has all of the command.
const TAKEN_OVER: u32 = 40;
/// Ticks while an answer is waited for, after which they come slowly: the end of probation is far, however busy the machine is.
const TICKS_OF_AN_ANSWER: u32 = 50;

/// A loop with the shipped policy in control, and its store.
struct Loop {
    arbiter: Arbiter,
    policy: PolicyTag,
    desk: PolicyDesk,
    folder: PathBuf,
    stop: Arc<AtomicBool>,
    /// Orders that were kept for a recording.
    kept: Arc<Mutex<Vec<TickOrder>>>,
}

impl Loop {
    fn new(name: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("rollbacks-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir(&folder).unwrap();
        let bytes: Arc<[u8]> = include_bytes!("../../policies/default.onnx").as_slice().into();
        let policy = Policy::from_bytes("default".to_owned(), &bytes, &offered()).unwrap();
        let tag = PolicyTag::of(&policy);
        let rig = Rig::builtin("dual_pressure").unwrap();
        let map = Arc::new(SteadyMap::new(&rig).unwrap());
        let (end, store) = channel();
        let mut arbiter = Arbiter::new(map, ShownReference::of(&rig), Some(Candidate::new(policy)), end);
        arbiter.restart([0.9; 2]);
        let (stop, kept) = (Arc::new(AtomicBool::new(false)), Arc::<Mutex<Vec<TickOrder>>>::default());
        let settings = StoreSettings {
            directory: folder.join("policies"),
            adoption: Adoption::Manual,
            when_behind: WhenBehind::Fly,
            audit: folder.join("audit.jsonl"),
            signatures: offered().into(),
        };
        let keep = Arc::clone(&kept);
        let voices = Voices {
            say: Box::new(|_| ()),
            show: Box::new(|_| ()),
            keep: Box::new(move |order, _| keep.lock().unwrap().push(order.clone())),
        };
        let active = ActivePolicy { name: "default".to_owned(), bytes };
        let examination = Examination { model: rig, examiner: Box::new(|_| Err("no trial here".to_owned())) };
        let store = PolicyStore::start(settings, Some(active), store, examination, Arc::clone(&stop), voices).unwrap();
        Loop { arbiter, policy: tag, desk: store.desk(), folder, stop, kept }
    }

    fn ticks(&mut self, count: u32) {
        for _ in 0..count {
            let input = ControlInput::of_measured(HOLD_KPA, [HOLD_KPA; GOALS_AHEAD + 1]);
            let decided = self.arbiter.decide(&input, &[HOLD_KPA; AHEAD]);
            self.arbiter.applied(decided.decision.duty());
        }
    }

    /// Asks while the loop ticks.
    fn ask(
        &mut self,
        ask: impl FnOnce(PolicyDesk) -> Result<String, String> + Send + 'static,
    ) -> Result<String, String> {
        let desk = self.desk.clone();
        let asking = std::thread::spawn(move || ask(desk));
        let mut ticks = 0;
        while !asking.is_finished() {
            self.ticks(1);
            ticks += 1;
            std::thread::sleep(Duration::from_millis(if ticks < TICKS_OF_AN_ANSWER { 2 } else { 20 }));
        }
        asking.join().unwrap()
    }

    fn swap(&mut self, name: &'static str) -> Result<String, String> {
        self.ask(move |desk| desk.swap(name, "test", &Permit::unlimited()))
    }

    fn rollback(&mut self) -> Result<String, String> {
        self.ask(|desk| desk.rollback("test", &Permit::unlimited()))
    }

    fn state(&self, name: &str) -> Option<EntryState> {
        let entries = self.desk.list();
        entries.into_iter().find(|entry| entry.name == name).map(|entry| entry.state)
    }

    /// States of the shipped policy and of the fallback.
    fn states(&self) -> [Option<EntryState>; 2] {
        ["default", "fallback"].map(|name| self.state(name))
    }
}

impl Drop for Loop {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

/// Generous: how long anything may take on a machine that does other things as well.
fn until(done: impl Fn() -> bool) {
    let end = Instant::now() + Duration::from_secs(60);
    while !done() {
        assert!(Instant::now() < end, "not in time");
        std::thread::sleep(Duration::from_millis(10));
    }
}

fn back(to: &str) -> Result<String, String> {
    Ok(format!("back to {to}"))
}

/// The fallback controls after a swap; each rollback then is what its answer says, however often it is asked for.
#[test]
fn a_rollback_answers_what_the_tick_did() {
    use EntryState::{Active, Previous, Probation};
    let mut run = Loop::new("answers");
    run.ticks(300);
    assert!(run.rollback().unwrap_err().contains("nothing flew before"));
    assert!(run.swap("fallback").unwrap().contains("within half a second"));
    run.ticks(PROBATION);
    assert_eq!((run.arbiter.active(), run.states()), (PolicyTag::FALLBACK, [Some(Previous), Some(Active)]));
    for _ in 0..3 {
        assert_eq!(run.rollback(), back("default"));
        assert_eq!(run.states(), [Some(Probation), Some(Active)]);
        assert_eq!(run.rollback(), Ok("default is withdrawn".to_owned()));
        assert_eq!((run.arbiter.active(), run.states()), (PolicyTag::FALLBACK, [Some(Previous), Some(Active)]));
    }
    assert_eq!(run.rollback(), back("default"));
    run.ticks(PROBATION);
    assert_eq!((run.arbiter.active(), run.states()), (run.policy, [Some(Active), Some(Previous)]));
    assert_eq!(run.kept.lock().unwrap().len(), 8, "each order is recorded once, and none that was refused");
}

/// Two operators at once: the second takes back what the first asked for, or goes back itself, and either is told.
#[test]
fn a_rollback_behind_another_is_told_what_came_of_it() {
    let mut run = Loop::new("race");
    run.ticks(300);
    run.swap("fallback").unwrap();
    run.ticks(PROBATION);
    let told = run.ask(|desk| {
        let other = desk.clone();
        let first = std::thread::spawn(move || other.rollback("alice", &Permit::unlimited()));
        let second = desk.rollback("bob", &Permit::unlimited());
        Ok(format!("{:?}, {second:?}", first.join().unwrap()))
    });
    let told = told.unwrap();
    assert!(told.contains("back to default") && told.contains("default is withdrawn"), "{told}");
    assert_eq!(run.state("default"), Some(EntryState::Previous));
}

/// Standing by no tick takes an order: it waits, is told so, and what is asked for behind it is judged by it.
#[test]
fn orders_that_wait_for_a_tick_are_told_as_what_they_will_do() {
    let mut run = Loop::new("waiting");
    let desk = run.desk.clone();
    let swap = |name: &str| desk.swap(name, "test", &Permit::unlimited());
    let rollback = || desk.rollback("test", &Permit::unlimited());
    assert!(swap("fallback").unwrap().contains("fallback takes over once the rig is under control"));
    assert!(swap("fallback").unwrap_err().contains("waits until the rig is under control"));
    assert_eq!(rollback(), Ok("fallback is withdrawn once the rig is under control".to_owned()));
    assert!(rollback().unwrap_err().contains("nothing flew before"));
    assert!(swap("default").unwrap_err().contains("controls already"));
    run.ticks(TAKEN_OVER);
    assert_eq!(run.states(), [Some(EntryState::Active), None], "the first order was carried out, and the second");
    assert_eq!(run.desk.active().0, "default");
}

/// The fallback is active as soon as it has the command; for the ten seconds of its probation a policy has it and may be overruled.
#[test]
fn what_has_the_command_is_named_and_may_be_overruled_at_once() {
    use EntryState::{Active, Previous, Probation};
    let mut run = Loop::new("override");
    run.ticks(300);
    assert_eq!(run.swap("fallback"), Ok("fallback takes over within half a second".to_owned()));
    run.ticks(TAKEN_OVER);
    assert_eq!(run.desk.active(), ("fallback".to_owned(), String::new()));
    assert_eq!(run.states(), [Some(Previous), Some(Active)], "never on probation");
    assert!(run.swap("fallback").unwrap_err().contains("controls already"));
    assert_eq!(
        run.swap("default"),
        Ok("default takes over within half a second, and is on probation for 10 s".to_owned())
    );
    run.ticks(TAKEN_OVER);
    assert_eq!((run.desk.active().0.as_str(), run.states()), ("default", [Some(Probation), Some(Active)]));
    assert_eq!(run.swap("fallback"), Ok("default is withdrawn; fallback controls on".to_owned()));
    run.ticks(PROBATION);
    assert_eq!((run.arbiter.active(), run.desk.active().0.as_str()), (PolicyTag::FALLBACK, "fallback"));
}

/// A policy that had a part in a venting is not gone back to; the fallback keeps what it was given.
#[test]
fn what_lost_its_authority_is_not_gone_back_to() {
    let mut run = Loop::new("lost");
    run.ticks(300);
    run.swap("fallback").unwrap();
    run.ticks(PROBATION);
    assert_eq!(run.rollback(), back("default"));
    run.ticks(PROBATION);
    for _ in 0..2 {
        assert_eq!(run.rollback(), back("fallback"));
        run.arbiter.vented();
        assert_eq!(run.states(), [Some(EntryState::Previous), Some(EntryState::Active)], "whoever asked for it has it");
        assert_eq!(run.rollback(), back("default"));
        run.ticks(PROBATION);
    }
    assert_eq!(run.rollback(), back("fallback"));
    run.ticks(TAKEN_OVER);
    assert_eq!(run.rollback(), back("default"));
    run.ticks(TAKEN_OVER);
    run.arbiter.vented();
    assert_eq!(run.states(), [Some(EntryState::Refused), Some(EntryState::Active)]);
    assert!(run.rollback().unwrap_err().contains("nothing flew before"));
    assert!(run.swap("default").unwrap_err().contains("was refused"));
}

/// A pipe that nobody reads in place of the audit file, from the start.
#[test]
fn an_audit_file_that_cannot_be_written_is_told_and_holds_nobody() {
    let mut run = Loop::new("audit");
    let file = run.folder.join("audit.jsonl");
    assert!(std::process::Command::new("mkfifo").arg(&file).status().unwrap().success());
    run.ticks(300);
    run.swap("fallback").unwrap();
    // Within half a second that withdraws the fallback, afterwards it goes back to the policy.
    let answer = run.rollback();
    let withdrawn = Ok("fallback is withdrawn".to_owned());
    assert!(answer == withdrawn || answer == back("default"), "{answer:?}");
    let is_told = || run.desk.problem().is_some_and(|problem| problem.contains("audit.jsonl"));
    until(is_told);
    std::fs::remove_file(&file).unwrap();
    let text = || std::fs::read_to_string(&file).unwrap_or_default();
    until(|| !is_told() && text().contains("\"rollback\""));
    assert!(text().contains("\"swap\""), "{}", text());
}

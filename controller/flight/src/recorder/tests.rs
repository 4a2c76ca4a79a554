//! Tests of the recorder's thread on tapes in memory that are slow, full or fail.

use super::*;
use proto::recording::WriteMcapError;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};

/// Calls that a tape in memory was given, one word each.
type Log = Arc<Mutex<Vec<String>>>;

/// A tape in memory that can be slow or fail.
struct Memory {
    log: Log,
    /// Each tick waits for a permit; a gone sender permits everything.
    permits: Option<Receiver<()>>,
    /// Fails at this tick number and ever after.
    full_at: Option<u32>,
    finish_fails: bool,
}

fn full(path: &str) -> RecordError {
    // ENOSPC
    WriteMcapError::Write { path: path.into(), source: std::io::Error::from_raw_os_error(28) }.into()
}

impl Tape for Memory {
    fn tick(&mut self, tick: &TickRecord) -> Result<(), RecordError> {
        if let Some(permits) = &self.permits {
            let _ = permits.recv();
        }
        if self.full_at.is_some_and(|at| tick.tick >= at) {
            return Err(full("run.mcap"));
        }
        self.log.lock().unwrap().push(tick.tick.to_string());
        Ok(())
    }

    fn event(&mut self, _: u64, _: EventLevel, part: &str, message: &str) -> Result<(), RecordError> {
        self.log.lock().unwrap().push(format!("{part}:{message}"));
        Ok(())
    }

    fn attach(&mut self, _: &Attachment) -> Result<(), RecordError> {
        Ok(())
    }

    fn flush(&mut self) -> Result<(), RecordError> {
        Ok(())
    }

    fn check(&mut self) -> Result<(), RecordError> {
        Ok(())
    }

    fn bytes(&self) -> u64 {
        0
    }

    fn finish(self: Box<Self>) -> Result<PathBuf, RecordError> {
        if self.finish_fails { Err(full("run.mcap")) } else { Ok(PathBuf::from("run.mcap")) }
    }
}

fn memory() -> (Memory, Log) {
    let log = Log::default();
    (Memory { log: log.clone(), permits: None, full_at: None, finish_fails: false }, log)
}

fn slow() -> (Memory, Log, SyncSender<()>) {
    let (permit, permits) = sync_channel(100);
    let (tape, log) = memory();
    (Memory { permits: Some(permits), ..tape }, log, permit)
}

fn start(tape: Memory, capacity: usize) -> (Recorder, RecordSink) {
    let text = |event: &Event| format!("code {} {}", event.code, event.values[0]);
    let options = RecorderOptions { capacity, ..RecorderOptions::new(text) };
    Recorder::with_tape(Box::new(tape), PathBuf::from("run.partial.mcap"), options).unwrap()
}

fn tick(number: u32) -> TickRecord {
    TickRecord { tick: number, ..TickRecord::default() }
}

fn wait_until(what: &str, mut done: impl FnMut() -> bool) {
    let start = Instant::now();
    while !done() {
        // Far longer than the thread's 5 ms, for a machine that is busy.
        assert!(start.elapsed() < Duration::from_secs(20), "{what}");
        thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn everything_pushed_before_the_end_is_written_in_order_with_events_where_they_were_said() {
    let (tape, log) = memory();
    let (recorder, mut sink) = start(tape, 1_000);
    let mut expected = Vec::new();
    for k in 0..500 {
        assert!(sink.push(&tick(k)));
        expected.push(k.to_string());
        if k % 7 == 3 {
            let values = [f64::from(k), 0.0, 0.0, 0.0];
            assert!(sink.event(Event { at_ns: 0, level: EventLevel::Info, part: "p", code: 9, values }));
            expected.push(format!("p:code 9 {k}"));
        }
    }
    let done = recorder.finish().unwrap();
    assert_eq!(*log.lock().unwrap(), expected);
    assert_eq!((done.ticks, done.events, done.ticks_dropped, done.events_dropped), (500, 71, 0, 0));
    assert!(!sink.push(&tick(500)) && sink.dropped() == 1, "after the end nothing is taken");
}

#[test]
fn a_disk_that_stalls_costs_ticks_but_never_time() {
    let (tape, log, permit) = slow();
    let (recorder, mut sink) = start(tape, 8);
    // The thread takes one tick off the queue and hangs in it.
    assert!(sink.push(&tick(0)));
    wait_until("the thread takes the tick", || sink.room() == 8);
    let begun = Instant::now();
    let taken = (1..=20).filter(|k| sink.push(&tick(*k))).count();
    // 20 copies of 500 bytes take microseconds; a second is there only for a machine that stalls.
    assert!(begun.elapsed() < Duration::from_secs(1), "{:?}", begun.elapsed());
    assert_eq!((taken, sink.dropped()), (8, 12));
    assert_eq!(recorder.health().error(), None, "slow is not broken");
    drop(permit);
    let done = recorder.finish().unwrap();
    assert_eq!((done.ticks, done.ticks_dropped), (9, 12));
    assert_eq!(log.lock().unwrap().len(), 9);
}

#[test]
fn a_full_disk_is_told_once_and_the_queue_still_empties() {
    let (tape, _) = memory();
    let (recorder, mut sink) = start(Memory { full_at: Some(3), ..tape }, 16);
    let health = recorder.health();
    for k in 0..200 {
        wait_until("room in the queue", || sink.room() > 0);
        assert!(sink.push(&tick(k)));
    }
    wait_until("all taken", || health.ticks_lost() == 197);
    let told = health.error().unwrap();
    assert!(told.starts_with("run.mcap: cannot write the recording: No space left on device"), "{told}");
    assert_eq!(health.ticks_dropped(), 0);
    let error = recorder.finish().unwrap_err().to_string();
    assert!(error.starts_with(&told) && error.ends_with("(3 ticks written, 197 lost)"), "{error}");
    assert!(!error.contains('\n'));
}

#[test]
fn a_file_that_cannot_be_finished_is_told() {
    let (tape, _) = memory();
    let (recorder, mut sink) = start(Memory { finish_fails: true, ..tape }, 16);
    assert!(sink.push(&tick(0)));
    let health = recorder.health();
    let error = recorder.finish().unwrap_err();
    assert!(matches!(error, RecordError::Incomplete { written: 1, lost: 0, .. }), "{error}");
    assert!(health.error().is_some());
}

#[test]
fn the_observer_sees_everything_although_the_disk_is_full() {
    let seen = Log::default();
    let log = seen.clone();
    let (tape, _) = memory();
    let options = RecorderOptions::new(|event| format!("code {}", event.code)).observer(move |what| {
        log.lock().unwrap().push(match what {
            Recorded::Tick(tick) => tick.tick.to_string(),
            Recorded::Event { message, .. } => message.to_owned(),
        });
    });
    let tape = Memory { full_at: Some(0), ..tape };
    let (recorder, mut sink) = Recorder::with_tape(Box::new(tape), PathBuf::new(), options).unwrap();
    sink.push(&tick(0));
    sink.event(Event { at_ns: 0, level: EventLevel::Info, part: "p", code: 5, values: [0.0; 4] });
    sink.push(&tick(1));
    recorder.note(0, EventLevel::Info, "socket", "armed");
    assert!(recorder.finish().is_err());
    let mut seen = seen.lock().unwrap().clone();
    // The note comes from another queue: it may stand anywhere.
    seen.retain(|entry| entry != "armed");
    assert_eq!(seen, ["0", "code 5", "1"]);
}

#[test]
fn a_panic_in_the_observer_ends_the_thread_and_is_told() {
    let (tape, _) = memory();
    let options = RecorderOptions::new(|_| String::new()).observer(|_| panic!("on purpose"));
    let (recorder, mut sink) = Recorder::with_tape(Box::new(tape), PathBuf::from("run.partial.mcap"), options).unwrap();
    sink.push(&tick(0));
    assert!(matches!(recorder.finish(), Err(RecordError::Died { .. })));
    // Nobody empties the queue now; the tick does not mind.
    assert!((0..10_000).any(|k| !sink.push(&tick(k))));
}

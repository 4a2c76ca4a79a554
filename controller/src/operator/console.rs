//! Lines for a person, for which nothing ever waits.
//!
//! A terminal that went away, a pipe that nobody reads: neither may hold the recorder or the end of a run. So lines go
//! through a bounded queue to a thread of their own, and what finds the queue full is counted and told later. Only
//! results are waited for ([`result`], [`finish`]), and that wait ends with the first signal that asks the process to
//! stop.

use std::io::{self, Write};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use proto::terminal_lines::for_stream;

use crate::machine::signals::ordered_to_stop;

/// Lines that may wait: with 160 characters each, 80 KiB.
const MOST_LINES: usize = 512;
/// Time that the end waits for notices.
const NOTICE_TIME: Duration = Duration::from_secs(2);
/// Time that the end waits for anything once the process was asked to stop.
const STOP_TIME: Duration = Duration::from_millis(500);
/// Between two looks.
const LOOK: Duration = Duration::from_millis(5);

/// Place where a line goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stream {
    Out,
    Err,
}

struct Console {
    lines: SyncSender<(Stream, String)>,
    counts: Arc<Counts>,
}

#[derive(Default)]
struct Counts {
    out_queued: AtomicU64,
    err_queued: AtomicU64,
    out_written: AtomicU64,
    err_written: AtomicU64,
    dropped: AtomicU64,
    /// Reason why a result could not be written; a reader that has seen enough is no such reason.
    failed: OnceLock<String>,
    /// Set where a result found no room until somebody asked the process to stop.
    given_up: AtomicBool,
}

/// Reason why not all results were printed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Unprinted {
    /// Standard output takes nothing.
    #[error("standard output cannot be written: {0}")]
    Failed(String),
    /// They were not read before somebody asked the process to stop.
    #[error("stopped before all results were printed: nobody reads standard output")]
    Stopped,
}

static CONSOLE: OnceLock<Option<Console>> = OnceLock::new();

fn console() -> Option<&'static Console> {
    CONSOLE
        .get_or_init(|| {
            let (lines, queue) = sync_channel(MOST_LINES);
            let counts = Arc::new(Counts::default());
            let shared = Arc::clone(&counts);
            let started = std::thread::Builder::new().name("console".to_owned()).spawn(move || write(&queue, &shared));
            started.ok().map(|_| Console { lines, counts })
        })
        .as_ref()
}

fn write(queue: &Receiver<(Stream, String)>, counts: &Counts) {
    while let Ok((stream, text)) = queue.recv() {
        // What cannot be printed is dropped: a terminal that went away must not end a run.
        let dropped = counts.dropped.swap(0, Ordering::Relaxed);
        if dropped > 0 {
            let _ = writeln!(io::stderr().lock(), "controller: {dropped} lines were dropped: nobody read them in time");
        }
        match stream {
            Stream::Out => {
                let mut out = io::stdout().lock();
                match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
                    Err(error) if !has_gone(&error) => {
                        let _ = counts.failed.set(error.to_string());
                    }
                    _ => {}
                }
                counts.out_written.fetch_add(1, Ordering::Release);
            }
            Stream::Err => {
                let _ = io::stderr().lock().write_all(text.as_bytes());
                counts.err_written.fetch_add(1, Ordering::Release);
            }
        }
    }
}

/// Tells whether the reader has gone: a closed pipe, a terminal that was hung up (EIO).
fn has_gone(error: &io::Error) -> bool {
    const EIO: i32 = 5;
    error.kind() == io::ErrorKind::BrokenPipe || error.raw_os_error() == Some(EIO)
}

impl Console {
    /// Queues a text; gives it back if there is no room.
    fn offer(&self, stream: Stream, text: String) -> Result<(), String> {
        let queued = if stream == Stream::Out { &self.counts.out_queued } else { &self.counts.err_queued };
        queued.fetch_add(1, Ordering::Release);
        self.lines.try_send((stream, text)).map_err(|refused| {
            queued.fetch_sub(1, Ordering::Release);
            let (TrySendError::Full((_, text)) | TrySendError::Disconnected((_, text))) = refused;
            text
        })
    }

    fn waits(&self, stream: Stream) -> bool {
        let counts = &self.counts;
        match stream {
            Stream::Out => counts.out_written.load(Ordering::Acquire) < counts.out_queued.load(Ordering::Acquire),
            Stream::Err => counts.err_written.load(Ordering::Acquire) < counts.err_queued.load(Ordering::Acquire),
        }
    }

    /// Waits for what is queued.
    fn wait(&self) {
        let begun = Instant::now();
        loop {
            let (out, err) = (self.waits(Stream::Out), self.waits(Stream::Err));
            let time = begun.elapsed();
            let give_up = time > STOP_TIME && ordered_to_stop() || time > NOTICE_TIME && !out;
            if !out && !err || give_up {
                return;
            }
            std::thread::sleep(LOOK);
        }
    }
}

/// A notice on standard error; dropped and counted where nobody reads.
pub fn notice(line: impl std::fmt::Display) {
    put(Stream::Err, for_stream(&format!("controller: {line}\n"), &io::stderr()).into_owned());
}

/// Text on standard error as it is, for a line that is written over; dropped where nobody reads.
pub fn overwrite(text: impl std::fmt::Display) {
    put(Stream::Err, proto::live_line::written_over(&text.to_string()));
}

/// A line of progress on standard output; dropped and counted where nobody reads.
pub fn progress(line: impl std::fmt::Display) {
    put(Stream::Out, format!("{line}\n"));
}

fn put(stream: Stream, text: String) {
    if let Some(console) = console()
        && console.offer(stream, text).is_err()
    {
        console.counts.dropped.fetch_add(1, Ordering::Relaxed);
    }
}

/// A line of results on standard output; waits for room until somebody asks the process to stop.
pub fn result(line: impl std::fmt::Display) {
    let Some(console) = console() else { return };
    let mut text = for_stream(&format!("{line}\n"), &io::stdout()).into_owned();
    let begun = Instant::now();
    while let Err(back) = console.offer(Stream::Out, text) {
        if ordered_to_stop() && begun.elapsed() > STOP_TIME {
            console.counts.given_up.store(true, Ordering::Relaxed);
            return;
        }
        text = back;
        std::thread::sleep(LOOK);
    }
}

/// Waits until all is printed: for notices two seconds, for results until somebody asks the process to stop.
///
/// # Errors
/// Standard output could not be written (a full disk), other than because its reader has gone; or nobody read it in time.
pub fn finish() -> Result<(), Unprinted> {
    let Some(Some(console)) = CONSOLE.get() else { return Ok(()) };
    console.wait();
    if let Some(error) = console.counts.failed.get() {
        return Err(Unprinted::Failed(error.clone()));
    }
    let unread = console.waits(Stream::Out) || console.counts.given_up.load(Ordering::Relaxed);
    if unread { Err(Unprinted::Stopped) } else { Ok(()) }
}

/// Lets a burst of notices through, then a few a second; the others are counted.
#[derive(Debug, Clone, PartialEq)]
pub struct Throttle {
    tokens: f64,
    last: Option<Instant>,
    held_back: u64,
}

/// Notices in a row that are let through.
const BURST: f64 = 20.0;
/// Notices a second after that.
const RATE_PER_S: f64 = 2.0;

impl Default for Throttle {
    fn default() -> Self {
        Throttle { tokens: BURST, last: None, held_back: 0 }
    }
}

/// Treatment of a notice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Admission {
    /// It is printed, after so many that were held back.
    Print {
        /// Notices held back since the last one.
        held_back: u64,
    },
    /// It is counted.
    HoldBack,
}

impl Throttle {
    /// Judges a notice.
    pub fn admit(&mut self, now: Instant) -> Admission {
        let passed = self.last.map_or(0.0, |last| now.saturating_duration_since(last).as_secs_f64());
        self.last = Some(now);
        self.tokens = (self.tokens + passed * RATE_PER_S).min(BURST);
        if self.tokens < 1.0 {
            self.held_back += 1;
            return Admission::HoldBack;
        }
        self.tokens -= 1.0;
        Admission::Print { held_back: std::mem::take(&mut self.held_back) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_of_notices_becomes_a_trickle_that_says_how_many() {
        let mut throttle = Throttle::default();
        let start = Instant::now();
        // 50 a second for 60 s.
        let admitted: Vec<u64> = (0..3_000)
            .filter_map(|k| match throttle.admit(start + Duration::from_millis(20 * k)) {
                Admission::Print { held_back } => Some(held_back),
                Admission::HoldBack => None,
            })
            .collect();
        // The burst, and two a second after it.
        assert!((138..=141).contains(&admitted.len()), "{}", admitted.len());
        assert_eq!(admitted.len() as u64 + admitted.iter().sum::<u64>() + throttle.held_back, 3_000);
        let quiet = throttle.admit(start + Duration::from_secs(600));
        assert!(matches!(quiet, Admission::Print { .. }));
    }
}

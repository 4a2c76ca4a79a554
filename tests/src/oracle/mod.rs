//! The daemon in real time beside an oracle: misses of the tick that the machine itself does not excuse.
//!
//! The daemon's whole loop runs against an emulated cRIO over TCP, and on each CPU two threads of higher priority that do no work.
//! One wakes every millisecond and sends what time it is over a TCP connection of its own on this machine; the other waits for
//! that. So a stall of this machine's clock, of a processor or of its network is seen from two milliseconds on, a third of what a
//! frame may be late by.
//!
//! A tick is a miss where its command left too late or its frame was given up. It is excused by the *clock* where a thread woke
//! at least as late during that tick, by the *cRIO* where that emulated hardware itself had its frame ready as late, and by the
//! *link* where such a message came as late. Then no program could have been on time.
//!
//! | module | what |
//! | --- | --- |
//! | `watchers` | the threads that do no work |
//! | `crio` | the emulated cRIO and its own lateness |
//! | `miss` | ticks that were missed, by the daemon's records |

mod crio;
mod miss;
mod watchers;

use controller::operator::socket::Ask;
use controller::state::State;

pub use self::crio::{CrioProcess, be_the_crio};
pub use self::miss::Witness;
pub use self::watchers::Oracles;

use self::crio::late_edges;
use self::miss::By;
use crate::in_process::Daemon;

/// SCHED_FIFO priority of the oracles, above tick and guard.
const PRIORITY: u8 = 90;
/// Lateness that is worth keeping: it could excuse something.
const KEPT_NS: u64 = 1_000_000;
/// Latenesses that there is room for; what comes beyond is no excuse.
const ROOM: usize = 1 << 20;

/// A time at which something should have happened, and how late it did.
type Late = (u64, u64);

fn keep(late: &mut Vec<Late>, due_ns: u64, now_ns: u64) {
    let by_ns = now_ns.saturating_sub(due_ns);
    if by_ns >= KEPT_NS && late.len() < ROOM {
        late.push((due_ns, by_ns));
    }
}

/// An operator who looks at what was wrong and arms again, at each call; the state that was found. A miss may vent the rig, as it
/// should.
pub fn attend(daemon: &Daemon) -> Option<State> {
    let state = daemon.ask(&Ask::Status {})?.state;
    match state {
        State::Vent | State::Fault => drop(daemon.ask(&Ask::Acknowledge {})),
        State::Standby => drop(daemon.ask(&Ask::Arm {})),
        _ => {}
    }
    Some(state)
}

/// Verdict on a run beside the oracle.
#[derive(Debug)]
pub struct Verdict {
    /// Ticks under control.
    pub controlled: u64,
    /// Account of it, in lines.
    pub text: String,
    /// Gaps in the numbers of ticks that something excuses.
    pub excused_gaps: usize,
    /// Misses that nothing excuses, a line each.
    pub unexcused: Vec<String>,
    /// Rights that the system refused the oracle, without which it tells nothing.
    pub refused: Vec<String>,
}

impl Verdict {
    /// Ends oracles and cRIO, and judges what the witness saw.
    pub fn of(witness: &Witness, oracles: Oracles, crio: CrioProcess) -> Self {
        let (seen, ticks) = (oracles.end(), crio.end());
        let edges = late_edges(&ticks);
        let excuses = [("clock", &seen.wakes), ("cRIO", &edges), ("link", &seen.messages)];
        let (mut excused, mut excused_gaps) = ([0; 3], 0);
        let mut unexcused = Vec::new();
        for miss in &witness.misses {
            match excuses.iter().position(|(_, late)| miss.is_excused_by(late)) {
                Some(excuse) => {
                    excused[excuse] += 1;
                    excused_gaps += usize::from(miss.by == By::Skipped);
                }
                None => unexcused.push(miss.text(&ticks)),
            }
        }
        let count = |by: By| witness.misses.iter().filter(|miss| miss.by == by).count();
        let mut text = format!(
            "of the misses {} frames were given up, {} frames came late, {} answers took too long, {} have no record\n",
            count(By::FrameGivenUp),
            count(By::FrameLate),
            count(By::Answer),
            count(By::Skipped)
        );
        for (what, late) in
            [("oracle's wakes", &seen.wakes), ("oracle's messages", &seen.messages), ("cRIO's frames", &edges)]
        {
            let worst_ms = late.iter().map(|(_, by_ns)| *by_ns).max().unwrap_or(0) as f64 * 1e-6;
            text += &format!("the {what} were late by over 1 ms {} times, {worst_ms:.1} ms at most\n", late.len());
        }
        let [by_clock, by_crio, by_link] = excused;
        text += &format!(
            "{} ticks, {} of them under control: {} missed, {by_clock} of them excused by the clock, {by_crio} by the cRIO's own lateness, \
             {by_link} by the link, {} by nothing",
            witness.ticks,
            witness.controlled,
            witness.misses.len(),
            unexcused.len()
        );
        Verdict { controlled: witness.controlled, text, excused_gaps, unexcused, refused: seen.refused }
    }
}

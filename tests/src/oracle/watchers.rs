//! Threads of higher priority than the tick that do no work, and say when they came late.

use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use controller::config::Realtime;
use controller::machine::clock::now_ns;
use controller::machine::realtime::make_realtime;

use super::{Late, PRIORITY, ROOM, keep};

/// Between two wakes of an oracle.
const WAKE_NS: u64 = 1_000_000;

/// Oracles of all CPUs at work.
pub struct Oracles {
    threads: Vec<Oracle>,
    stop: Arc<AtomicBool>,
}

/// The two threads of one CPU.
struct Oracle {
    wakes: JoinHandle<(Vec<Late>, Vec<String>)>,
    messages: JoinHandle<Vec<Late>>,
}

impl Oracles {
    /// Starts two threads on each CPU.
    pub fn start() -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let cpus = std::thread::available_parallelism().map_or(1, usize::from);
        Oracles { threads: (0..cpus).map(|cpu| Oracle::start(cpu, Arc::clone(&stop))).collect(), stop }
    }

    /// Ends them; what they saw.
    pub(super) fn end(self) -> Seen {
        self.stop.store(true, Ordering::Relaxed);
        let mut seen = Seen::default();
        for oracle in self.threads {
            let (wakes, refused) = oracle.wakes.join().expect("no panic");
            seen.wakes.extend(wakes);
            seen.refused.extend(refused);
            seen.messages.extend(oracle.messages.join().expect("no panic"));
        }
        seen
    }
}

impl Oracle {
    fn start(cpu: usize, stop: Arc<AtomicBool>) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("an address");
        let mine = move || make_realtime(&Realtime { cpu: Some(cpu), priority: PRIORITY, ..Realtime::default() });
        let messages = std::thread::spawn(move || {
            mine();
            let (mut stream, _) = listener.accept().expect("the other thread");
            let (mut late, mut sent) = (Vec::with_capacity(ROOM), [0; 8]);
            // It ends when the sender does.
            while stream.read_exact(&mut sent).is_ok() {
                keep(&mut late, u64::from_le_bytes(sent), now_ns());
            }
            late
        });
        let wakes = std::thread::spawn(move || {
            let refused = mine();
            let mut stream = TcpStream::connect(address).expect("the other thread");
            stream.set_nodelay(true).expect("a socket");
            let mut late = Vec::with_capacity(ROOM);
            let mut due_ns = now_ns() + WAKE_NS;
            while !stop.load(Ordering::Relaxed) {
                std::thread::sleep(Duration::from_nanos(due_ns.saturating_sub(now_ns())));
                let now_ns = now_ns();
                keep(&mut late, due_ns, now_ns);
                stream.write_all(&due_ns.to_le_bytes()).expect("the other thread");
                due_ns += WAKE_NS * (1 + now_ns.saturating_sub(due_ns) / WAKE_NS);
            }
            (late, refused)
        });
        Oracle { wakes, messages }
    }
}

/// Wakes and messages that oracles saw come late, and the priority or pinning that they were refused.
#[derive(Default)]
pub(super) struct Seen {
    pub(super) wakes: Vec<Late>,
    pub(super) messages: Vec<Late>,
    pub(super) refused: Vec<String>,
}

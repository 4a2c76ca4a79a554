//! A load of this program's own: arithmetic on every CPU, memory swept, files synced, small messages between threads.

use std::fs::File;
use std::hint::black_box;
use std::io::{Read, Seek, Write};
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

/// Memory that is swept, in bytes: larger than the caches of a desktop.
const MEMORY_BYTES: usize = 64 << 20;
/// Between two touched bytes: a cache line.
const LINE_BYTES: usize = 64;
/// Bytes written before a sync.
const FILE_BYTES: usize = 1 << 20;

/// A load at work.
pub(super) struct Load {
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Load {
    /// Starts two threads of arithmetic for each CPU, and one each for memory, files and messages.
    pub(super) fn start(cpus: usize) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let mut threads = Vec::new();
        let mut add = |work: fn(&AtomicBool)| {
            let flag = Arc::clone(&stop);
            // A thread that cannot be started is load that is missing, no reason to stop.
            threads.extend(std::thread::Builder::new().name("load".to_owned()).spawn(move || work(&flag)));
        };
        (0..2 * cpus).for_each(|_| add(compute));
        [sweep, sync_files, send_messages].into_iter().for_each(&mut add);
        Load { stop, threads }
    }

    /// Ends it.
    pub(super) fn end(self) {
        self.stop.store(true, Ordering::Relaxed);
        for thread in self.threads {
            let _ = thread.join();
        }
    }
}

fn going(stop: &AtomicBool) -> bool {
    !stop.load(Ordering::Relaxed)
}

fn compute(stop: &AtomicBool) {
    let mut x = 1.0_f64;
    while going(stop) {
        for _ in 0..10_000 {
            x = black_box((x * 1.000_1).sin() + 1.0);
        }
    }
}

fn sweep(stop: &AtomicBool) {
    let mut memory = vec![0_u8; MEMORY_BYTES];
    while going(stop) {
        for byte in memory.iter_mut().step_by(LINE_BYTES) {
            *byte = byte.wrapping_add(1);
        }
        black_box(&mut memory);
    }
}

fn sync_files(stop: &AtomicBool) {
    let path = std::env::temp_dir().join(format!("controller-rt-test-{}", std::process::id()));
    let Ok(mut file) = File::create(&path) else { return };
    // Without a name it is gone with the program, however that ends.
    let _ = std::fs::remove_file(&path);
    let piece = vec![7_u8; FILE_BYTES];
    while going(stop) {
        let written = file.rewind().and_then(|()| file.write_all(&piece)).and_then(|()| file.sync_data());
        if written.is_err() {
            return;
        }
    }
}

fn send_messages(stop: &AtomicBool) {
    let Ok((mut one, mut other)) = UnixStream::pair() else { return };
    std::thread::scope(|scope| {
        scope.spawn(move || {
            let mut byte = [0];
            while other.read_exact(&mut byte).is_ok() && other.write_all(&byte).is_ok() {}
        });
        let mut byte = [1];
        while going(stop) && one.write_all(&byte).is_ok() && one.read_exact(&mut byte).is_ok() {}
        // Closed, so that the other end finishes.
        drop(one);
    });
}

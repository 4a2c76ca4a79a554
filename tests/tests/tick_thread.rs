//! The tick's own thread in a running daemon, watched from outside: it allocates nothing and touches no new page while a
//! session lasts, whatever comes over the wire; and its recording replays to the bit, whatever came.
//!
//! A million ticks of random faults: `cargo test --release --workspace --test tick_thread -- --ignored --nocapture`; `TICKS` in
//! the environment sets another number.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use controller::operator::socket::{Ask, ask};
use proto::emulator::{Emulator, EmulatorConfig, Pace, SensorFault, rig_and_crio};
use proto::wire::{Mode, Sense, TripBits};
use tests::coarse_rigs::{coarse, write_coarse};
use tests::counting_allocator::{CountingAllocator, allocations};
use tests::dice::Dice;
use tests::in_process::Daemon;
use tests::laboratory::{check_replay, recordings};
use tests::raw_crio::{Answer, RawCrio};
use tests::task::{memory_is_locked, page_faults};
use tests::{Folder, alone};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

const SOON: Duration = Duration::from_secs(60);

fn configuration(folder: &Folder, address: &str, pacing: &str, policy: &str) -> PathBuf {
    std::fs::create_dir_all(folder.join("policies")).unwrap();
    let model = write_coarse("dual_pressure", folder);
    let text = format!(
        "rig.file = {model:?}\n[link]\naddress = \"{address}\"\npacing = \"{pacing}\"\n[policy]\n{policy}\n[record]\ndirectory = \"runs\"\nmin_free_mib = 16\n\
         max_mib = 64\n[control]\nsocket = \"s\"\nauto_arm = true\n[realtime]\nenforce = false\n"
    );
    folder.write("controller.toml", text)
}

/// Count of what a thread has done so far.
fn counted(task: i32) -> u64 {
    allocations(task).expect("the tick's thread has a name, which was allocated")
}

#[test]
fn in_real_time_the_armed_tick_allocates_nothing_and_touches_no_new_page() {
    let _alone = alone();
    let folder = Folder::new();
    let (plant, crio) = rig_and_crio(&coarse("bench")).unwrap();
    let config = EmulatorConfig { crio, pace: Pace::RealTime, ..EmulatorConfig::default() };
    let emulator = Emulator::bind("127.0.0.1:0", config, Box::new(plant)).and_then(Emulator::start).unwrap();
    let file = configuration(&folder, &emulator.local_addr().to_string(), "realtime", "active = \"default\"");
    let daemon = Daemon::start(&file, |_| ());
    let task = daemon.tick_task();
    let session = || daemon.ask(&Ask::Status {}).and_then(|reply| reply.status).filter(|s| s.state.is_controlling());
    let until = Instant::now() + SOON;
    // A machine that stalls may end a session; what counts is a stretch within one.
    let (mut stretch, mut quiet) = (Duration::ZERO, None);
    while stretch < Duration::from_secs(4) {
        if Instant::now() > until {
            println!(
                "SKIPPED: on this machine no session lasts for six seconds; the soak counts allocations in lockstep"
            );
            daemon.end();
            emulator.stop();
            let _ = emulator.join();
            return;
        }
        std::thread::sleep(Duration::from_millis(200));
        let now = session().map(|s| s.session);
        let since = match (now, quiet) {
            (Some(number), Some((before, since, counts))) if number == before => Some((number, since, counts)),
            // Two seconds under control are its warm-up.
            (Some(number), _) => {
                std::thread::sleep(Duration::from_secs(2));
                Some((number, Instant::now(), (counted(task), page_faults(task))))
            }
            (None, _) => None,
        };
        quiet = since;
        stretch = since.map_or(Duration::ZERO, |(_, since, _)| since.elapsed());
    }
    let (_, _, (allocated, faulted)) = quiet.unwrap();
    let (allocated, faulted) = (counted(task) - allocated, page_faults(task) - faulted);
    println!("{allocated} allocations, {faulted} page faults in {stretch:?}");
    assert_eq!(allocated, 0);
    if memory_is_locked() {
        assert_eq!(faulted, 0);
    } else {
        println!("SKIPPED: memory cannot be locked here, so page faults say nothing");
    }
    daemon.end();
    emulator.stop();
    emulator.join().unwrap();
}

/// The daemon under random faults, and what was seen of it.
struct Soak {
    crio: RawCrio,
    socket: PathBuf,
    dice: Dice,
    task: i32,
    /// Allocations at the session's first answer.
    allocated: Option<u64>,
    last: [f32; 2],
    /// Ticks that a fault still lasts.
    faulty: [u64; 2],
    lying: u64,
    seen: Seen,
}

#[derive(Debug, Default)]
struct Seen {
    ticks: u64,
    controlled: u64,
    held: u64,
    sessions: u64,
    lost: u64,
    damaged: u64,
    twice: u64,
    out_of_order: u64,
    sensor_faults: u64,
    lies: u64,
    trips: u64,
    cuts: u64,
    allocations: u64,
    most_kpa: f64,
    least_kpa: f64,
    fastest_closing: f32,
}

impl Soak {
    fn open(&mut self) {
        let begun = Instant::now();
        let opened = self.crio.open_within(SOON);
        if begun.elapsed() > Duration::from_secs(5) {
            let status = ask(&self.socket, &Ask::Status {});
            println!("a HELLO took {:?} at tick {}: {status:?}", begun.elapsed(), self.seen.ticks);
        }
        assert!(opened, "no HELLO came: {:?}", self.seen);
        self.seen.sessions += 1;
        (self.allocated, self.last) = (None, [1.0; 2]);
    }

    /// One tick, with whatever befalls it.
    fn tick(&mut self) {
        self.seen.ticks += 1;
        self.change_sensors();
        let Some(sense) = self.crio.sense() else { return self.open() };
        let spoilt = self.spoilt(sense);
        let expects_answer = match self.dice.roll(10_000) {
            0..20 => {
                self.seen.lost += 1;
                false
            }
            20..28 => {
                self.seen.damaged += 1;
                let mut bytes = spoilt.encode();
                bytes[24 + self.dice.roll(36) as usize] ^= 1 << self.dice.roll(8);
                self.crio.write(&bytes);
                false
            }
            28..48 => {
                self.seen.twice += 1;
                self.crio.write(&[spoilt.encode(), spoilt.encode()].concat());
                true
            }
            48..58 => {
                // The next frame overtakes this one.
                self.seen.out_of_order += 1;
                self.crio.advance();
                if let Some(next) = self.crio.sense() {
                    self.crio.write(&[next.encode(), spoilt.encode()].concat());
                }
                true
            }
            58..61 => {
                self.seen.cuts += 1;
                self.crio.cut();
                return self.open();
            }
            61..63 => {
                self.seen.trips += 1;
                let bits = [TripBits::OPERATOR_STOP, TripBits::COMMAND_LOST, TripBits::OVER_PRESSURE, TripBits::SENSOR];
                self.crio.trip(bits[self.dice.roll(4) as usize]);
                self.crio.write(&spoilt.encode());
                true
            }
            _ => {
                self.crio.write(&spoilt.encode());
                true
            }
        };
        if expects_answer {
            self.answered();
        }
        self.crio.advance();
        let [pos, neg] = self.crio.true_kpa();
        (self.seen.most_kpa, self.seen.least_kpa) = (self.seen.most_kpa.max(pos), self.seen.least_kpa.min(neg));
    }

    fn change_sensors(&mut self) {
        for c in 0..2 {
            self.faulty[c] = self.faulty[c].saturating_sub(1);
            if self.faulty[c] == 0 {
                self.crio.faults[c].clear();
            }
        }
        if self.dice.chance(0.001) {
            // For one tick a reading is believed neither way.
            let c = self.dice.roll(2) as usize;
            (self.crio.faults[c], self.faulty[c]) = (vec![SensorFault::Offset([-40.0, 20.0][c])], 1);
            self.seen.sensor_faults += 1;
        }
        if self.dice.chance(0.0005) {
            let c = self.dice.roll(2) as usize;
            let off = 20.0 * (self.dice.share() - 0.5);
            let fault = match self.dice.roll(6) {
                4 => SensorFault::Offset(4.0 * off),
                0 => SensorFault::Stuck,
                1 => SensorFault::NotANumber,
                2 => SensorFault::BrokenWire,
                3 => SensorFault::Reading([1_100.0, -104.0][c]),
                _ => SensorFault::Offset(off),
            };
            self.crio.faults[c] = vec![fault];
            self.faulty[c] = 1 + self.dice.roll(200);
            self.seen.sensor_faults += 1;
        }
    }

    /// The frame of a cRIO that now and then says what is not so.
    fn spoilt(&mut self, mut sense: Sense) -> Sense {
        self.lying = self.lying.saturating_sub(1);
        if self.dice.chance(0.0005) {
            self.lying = 1 + self.dice.roll(6);
            self.seen.lies += 1;
        }
        if self.lying > 0 {
            match self.dice.roll(4) {
                0 => sense.duty = [0.5, f32::NAN],
                1 => sense.command_in_force = 0,
                2 => sense.pump_running = !sense.pump_running,
                _ => sense.tick = sense.tick.wrapping_add(1_500),
            }
        }
        sense
    }

    fn answered(&mut self) {
        // A frame whose numbering cannot be right is answered by nobody.
        let patience = if self.lying > 0 { Duration::from_millis(20) } else { SOON };
        match self.crio.answer(patience) {
            Answer::Command(command) => {
                let now = counted(self.task);
                let before = *self.allocated.get_or_insert(now);
                if now > before {
                    println!("{} allocations before the answer to tick {}", now - before, self.seen.ticks);
                }
                self.seen.allocations += now - before;
                self.allocated = Some(now);
                assert!(command.duty.iter().all(|duty| (0.0..=1.0).contains(duty)), "{command:?}");
                if command.mode == Mode::Vent {
                    assert_eq!((command.duty, command.pump_on()), ([1.0; 2], false), "vented means open");
                } else {
                    self.seen.controlled += 1;
                    self.seen.held += u64::from(command.mode == Mode::Hold);
                    for (before, now) in self.last.iter().zip(command.duty) {
                        self.seen.fastest_closing = self.seen.fastest_closing.max(before - now);
                    }
                }
                self.last = command.duty;
            }
            Answer::Bye(_) | Answer::Closed => self.open(),
            Answer::Silence => assert!(self.lying > 0, "no answer to a sound frame: {:?}", self.seen),
        }
    }
}

/// Acknowledges and arms whenever that can be done, as a person would who trusts the daemon too much.
fn operate(socket: &std::path::Path, over: &AtomicBool) {
    while !over.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(5));
        let Some(status) = ask(socket, &Ask::Status {}).ok().and_then(|reply| reply.status) else { continue };
        if status.latched.is_some() {
            let _ = ask(socket, &Ask::Acknowledge {});
        } else if status.can_arm {
            let _ = ask(socket, &Ask::Arm {});
        }
    }
}

/// Publishes policies that are none, again and again.
fn publish(folder: &Folder, over: &AtomicBool) {
    let sound = controller::daemon::shipped_policy().unwrap().1;
    let mut dice = Dice::new(77);
    for round in 0.. {
        if over.load(Ordering::Relaxed) {
            return;
        }
        let mut bytes = sound.clone();
        match round % 3 {
            0 => bytes.truncate(dice.roll(bytes.len() as u64) as usize),
            1 => bytes = (0..2_000).map(|_| dice.roll(256) as u8).collect(),
            _ => {
                let at = dice.roll(bytes.len() as u64) as usize;
                bytes[at] ^= 0x55;
            }
        }
        // Few names, each published anew again and again.
        let part = folder.join("policies/.part");
        std::fs::write(&part, bytes).unwrap();
        std::fs::rename(part, folder.join(&format!("policies/bad-{}.onnx", round % 20))).unwrap();
        std::thread::sleep(Duration::from_millis(700));
    }
}

/// Flies so many ticks; what was seen.
fn soak(ticks: u64, seed: u64) -> Seen {
    static PANICS: AtomicUsize = AtomicUsize::new(0);
    let _alone = alone();
    let usual = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        PANICS.fetch_add(1, Ordering::Relaxed);
        usual(info);
    }));
    let folder = Folder::new();
    let crio = RawCrio::new("bench");
    let file =
        configuration(&folder, &crio.address().to_string(), "lockstep", "active = \"default\"\nfollow = \"newest\"");
    let daemon = Daemon::start(&file, |_| ());
    let task = daemon.tick_task();
    let over = AtomicBool::new(false);
    let seen = std::thread::scope(|scope| {
        scope.spawn(|| operate(daemon.socket(), &over));
        scope.spawn(|| publish(&folder, &over));
        let mut soak = Soak {
            crio,
            socket: daemon.socket().to_owned(),
            dice: Dice::new(seed),
            task,
            allocated: None,
            last: [1.0; 2],
            faulty: [0; 2],
            lying: 0,
            seen: Seen::default(),
        };
        soak.open();
        let flown = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            while soak.seen.ticks < ticks {
                soak.tick();
            }
        }));
        over.store(true, Ordering::Relaxed);
        soak.crio.cut();
        flown.unwrap_or_else(|cause| std::panic::resume_unwind(cause));
        soak.seen
    });
    daemon.end();
    println!("{seen:#?}");
    assert_eq!(PANICS.load(Ordering::Relaxed), 0, "panics");
    assert_eq!(seen.allocations, 0, "allocations on the tick's thread within sessions");
    // Whatever befell a tick, its record holds what it was decided by.
    let found = check_replay(&recordings(&folder, "runs", ""));
    println!("replayed: {found}");
    // What was answered with duties has a record.
    assert!(found["ticks"].as_u64() >= Some(seen.controlled), "{found}: {seen:?}");
    // The limits are 160 and -95 kPa; a sensor may be off by ten and not be found out.
    assert!(seen.most_kpa < 160.0 && seen.least_kpa > -95.0, "{seen:?}");
    // In the wire's single precision.
    assert!(seen.fastest_closing < 0.100_001, "{seen:?}");
    assert!(5 * seen.controlled > seen.ticks, "it must fly for much of the time: {seen:?}");
    seen
}

#[test]
fn twenty_thousand_ticks_of_random_faults_allocate_nothing_and_leave_no_limit() {
    let seen = soak(20_000, 1);
    assert!(seen.lost > 0 && seen.damaged > 0 && seen.twice > 0 && seen.out_of_order > 0, "{seen:?}");
    assert!(seen.sensor_faults > 0 && seen.lies > 0 && seen.trips > 0 && seen.cuts > 0 && seen.held > 0, "{seen:?}");
}

#[test]
#[ignore = "a million ticks: a quarter of an hour"]
fn a_million_ticks_of_random_faults_allocate_nothing_and_leave_no_limit() {
    let ticks = std::env::var("TICKS").ok().and_then(|text| text.parse().ok()).unwrap_or(1_000_000);
    soak(ticks, 2);
}

/// Tests of the thorough tier (docs/testing.md).
mod thorough {
    use super::*;

    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn a_hundred_thousand_ticks_of_random_faults_are_replayed_to_the_bit() {
        soak(100_000, 3);
    }
}

//! Time of a tick, of an MPObs prediction, and ticks per second of one core: `cargo bench -p model`.
//!
//! For each built-in rig: one tick (20 ms, 200 RK4 steps) of one rig and one prediction (five ticks, state saved and
//! put back), each timed by itself (the clock's own cost, some 25 ns, is included) at p50, p99.9 and maximum; then
//! ticks per second of one rig and of eight side by side, every lane at its own place of the duty schedule, medians
//! over repeats. The maximum on a shared machine tells of its other users.
//!
//! `PEER_RK4_C=path/to/rk4.c cargo bench -p model` also compiles that C program of the paper's rig
//! (`cc -O3 -march=native -ffast-math`), runs it in turns with ours, and prints the ratios of the same run and both
//! final pressures.
#![allow(missing_docs, clippy::unwrap_used)]

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::time::Instant;

use model::plant::{InstructionSet, Plant, Simulated, Simulation};
use model::predict::{DualPressureRig, Predictor};
use model::real::Lanes;
use model::rig::Rig;

type Eight = Lanes<8>;

const TICKS: u32 = 5000;
const REPEATS: usize = 9;
const TIMED_TICKS: u32 = 50_000;
const TIMED_PREDICTIONS: u32 = 20_000;

fn main() {
    println!(
        "instruction set {:?}; a tick is 200 RK4 steps, refined where check valves switch",
        InstructionSet::detect()
    );
    let peer = Peer::from_environment();
    for name in Rig::BUILTIN {
        let rig = Rig::builtin(name).unwrap();
        println!("{name}");
        spread("one tick", ticks(&rig));
        spread("MPObs, 5 ticks", predictions(&rig));
        // The C program simulates the paper's rig only.
        speeds(&rig, peer.as_ref().filter(|_| name == "dual_pressure"));
    }
}

/// The duties of the C program: three levels of each valve, 50 and 70 ticks long.
fn duty(tick: u32) -> [f64; 2] {
    let level = |ticks: u32| f64::from(tick / ticks % 3) - 1.0;
    [0.85 + 0.1 * level(50), 0.82 + 0.08 * level(70)]
}

/// Microseconds of single ticks, sorted.
fn ticks(rig: &Rig) -> Vec<f64> {
    let mut plant = DualPressureRig::new(rig).unwrap();
    sorted((0..TIMED_TICKS).map(|tick| microseconds(|| plant.tick(black_box(duty(tick)), true))))
}

/// Microseconds of predictions, sorted; correcting the model and running it along are not timed.
fn predictions(rig: &Rig) -> Vec<f64> {
    let (mut plant, mut predictor) = (DualPressureRig::new(rig).unwrap(), Predictor::new(rig).unwrap());
    sorted((0..TIMED_PREDICTIONS).map(|tick| {
        predictor.observe(plant.readings_kpa());
        let ahead = std::array::from_fn(|j| duty(tick + j as u32));
        let took = microseconds(|| {
            black_box(predictor.predict(black_box(&ahead), true));
        });
        predictor.advance(duty(tick), true);
        plant.tick(duty(tick), true);
        took
    }))
}

fn speeds(rig: &Rig, peer: Option<&Peer>) {
    // Exactly 200 steps to a tick, as in the C program.
    let mut rig = rig.clone();
    rig.integrator.refine_switching = false;
    let one = Arc::new(Plant::<f64>::new(&rig).unwrap());
    let eight = Arc::new(Plant::<Eight>::side_by_side(std::slice::from_ref(&rig)).unwrap());
    let (mut single, mut lanes, mut theirs) = (Vec::new(), Vec::new(), Vec::new());
    let mut end = Vec::new();
    for _ in 0..REPEATS {
        let (speed, kpa) = ticks_per_s(&one);
        single.push(speed);
        end = kpa;
        lanes.push(ticks_per_s(&eight).0);
        theirs.extend(peer.map(Peer::run));
    }
    let ratio = |ours: &[f64]| median(ours.iter().zip(&theirs).map(|(ours, theirs)| ours / theirs.ticks_per_s));
    let (one, eight) = (median(single.iter().copied()), median(lanes.iter().copied()));
    println!("  one rig         {one:>10.0} ticks/s, plain RK4");
    println!("  8 lanes         {eight:>10.0} ticks/s, plain RK4, all lanes, {:.1} times one rig", eight / one);
    if let Some(last) = theirs.last() {
        let speed = median(theirs.iter().map(|each| each.ticks_per_s));
        println!("  C program       {speed:>10.0} ticks/s");
        println!("  ratio, one rig  {:>10.2}", ratio(&single));
        println!("  ratio, 8 lanes  {:>10.2}", ratio(&lanes));
        println!(
            "  after {TICKS} ticks, kPa: {:.4} {:.4}, C program {:.4} {:.4}",
            end[0], end[1], last.kpa[0], last.kpa[1]
        );
    }
}

/// Ticks per second along the schedule from rest, all lanes counted, and where lane 0 ended in kPa.
fn ticks_per_s<R: Simulated>(plant: &Arc<Plant<R>>) -> (f64, Vec<f64>) {
    let mut simulation = Simulation::new(Arc::clone(plant));
    let column = |name: &str| plant.inputs().iter().position(|input| input.column == name).unwrap();
    let at = [column("u_pos"), column("u_neg")];
    let mut inputs = vec![R::splat(1.0); plant.inputs().len()];
    let start = Instant::now();
    for tick in 0..TICKS {
        for (channel, at) in at.into_iter().enumerate() {
            inputs[at] = R::from_lanes(|lane| duty(tick + 37 * lane as u32)[channel]);
        }
        simulation.tick(black_box(&inputs));
    }
    let speed = f64::from(TICKS) * R::LANES as f64 / start.elapsed().as_secs_f64();
    (speed, simulation.readings_kpa().map(|reading| reading.lane(0)).collect())
}

/// The compiled C program.
struct Peer {
    program: PathBuf,
}

struct PeerRun {
    ticks_per_s: f64,
    kpa: [f64; 2],
}

impl Peer {
    fn from_environment() -> Option<Self> {
        let source = std::env::var_os("PEER_RK4_C")?;
        let program = std::env::temp_dir().join(format!("peer-rk4-{}", std::process::id()));
        let flags = ["-O3", "-march=native", "-ffast-math"];
        let made = Command::new("cc").args(flags).arg("-o").arg(&program).arg(Path::new(&source)).arg("-lm").status();
        match made {
            Ok(status) if status.success() => Some(Peer { program }),
            Ok(_) => {
                println!("no ratio: cc cannot compile {}", source.display());
                None
            }
            Err(error) => {
                println!("no ratio: no C compiler: {error}");
                None
            }
        }
    }

    /// One run of as many ticks as ours.
    fn run(&self) -> PeerRun {
        let output = Command::new(&self.program).arg(TICKS.to_string()).output().unwrap();
        let line = String::from_utf8(output.stdout).unwrap();
        let figure = |key: &str| -> f64 {
            line.split_whitespace().find_map(|word| word.strip_prefix(key)).unwrap().parse().unwrap()
        };
        PeerRun { ticks_per_s: figure("ticks_per_s="), kpa: [figure("p_pos_kpa="), figure("p_neg_kpa=")] }
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.program);
    }
}

fn microseconds(work: impl FnOnce()) -> f64 {
    let start = Instant::now();
    work();
    start.elapsed().as_secs_f64() * 1e6
}

fn sorted(numbers: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut numbers: Vec<f64> = numbers.collect();
    numbers.sort_unstable_by(f64::total_cmp);
    numbers
}

fn median(numbers: impl Iterator<Item = f64>) -> f64 {
    let sorted = sorted(numbers);
    sorted[sorted.len() / 2]
}

fn spread(what: &str, us: Vec<f64>) {
    let at = |share: f64| us[((share * us.len() as f64).ceil() as usize).clamp(1, us.len()) - 1];
    println!("  {what:<15} p50 {:.1} µs, p99.9 {:.1} µs, max {:.1} µs over {}", at(0.5), at(0.999), at(1.0), us.len());
}

//! `trainer bench`: how fast this machine is at the paper's rig.
//!
//! | figure | what is timed |
//! | --- | --- |
//! | `ticks_per_s_single` | one rig, ticks of 200 RK4 steps, from rest along [`crate::schedule`] |
//! | `ticks_per_s_lanes` | [`LANES`] rigs side by side on one core, each at its own place of the schedule; rig ticks, all lanes counted |
//! | `mpobs_us_p50`, `mpobs_us_p999` | one MPObs prediction: five ticks ahead, state saved and put back |
//!
//! | `updates_per_s` | SAC + CAPS updates of the paper's Table IV (84 in, 12 out, two layers of 256, batch 128) on `updates_threads` threads, all cores unless `--threads` says otherwise |
//! | `fma_gflop_per_s` | what the same threads reach in multiply-adds alone, the bound of the line above |
//!
//! All but the updates runs in one thread. Machines are shared, so each speed is the median of several repeats, single
//! rig and lanes in turns, by wall clock and (`_cpu`) by the thread's own CPU time: where the two differ,
//! something else took the core. Lane 0 must end with the bits of the single rig, or nothing is reported.

use std::hint::black_box;
use std::sync::Arc;
use std::time::{Duration, Instant};

use clap::Args;
use clap::builder::RangedU64ValueParser;
use model::plant::{InstructionSet, Plant, Simulated, Simulation};
use model::predict::{DualPressurePorts, DualPressureRig, Predictor};
use model::real::Lanes;
use model::rig::{Rig, RigError};
use proto::rig_file::RigFileError;
use rustix::time::{ClockId, clock_gettime};
use serde_json::json;

use crate::failure::{Failure, tell};
use crate::progress::Progress;
use crate::schedule::duty;
use crate::stdout;

/// Rigs side by side; the width that the model's own work uses.
const LANES: usize = 8;
/// Ticks by which the schedule of a lane is ahead of its neighbour's.
const LANE_SHIFT: u32 = 37;
/// Share of the core lost to other work that is worth a word.
const SHARED: f64 = 0.1;
const RIG: &str = "dual_pressure";

/// Measures this machine's speed at the paper's rig; a few seconds.
///
/// A tick is 20 ms of the rig, 200 RK4 steps. Speeds are ticks per second of one core, medians over repeats.
/// The predictions (MPObs) are what the daemon does in each tick: five ticks ahead.
#[derive(Debug, Args)]
#[command(after_help = "Example:
  trainer bench --json")]
pub(crate) struct BenchArgs {
    /// Ticks of each repeat of the speeds
    #[arg(long, value_name = "N", default_value_t = 5000, value_parser = RangedU64ValueParser::<u32>::new().range(1..=1_000_000))]
    ticks: u32,
    /// Repeats of each speed, of which the median is told
    #[arg(long, value_name = "N", default_value_t = 9, value_parser = RangedU64ValueParser::<u32>::new().range(1..=1001))]
    repeats: u32,
    /// Predictions that are timed one by one; of fewer than 1000 the 99.9th percentile is the slowest
    #[arg(long, value_name = "N", default_value_t = 20_000, value_parser = RangedU64ValueParser::<u32>::new().range(100..=10_000_000))]
    predictions: u32,
    /// Threads that learn (all cores, 4 at most)
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<u32>::new().range(1..=64))]
    threads: Option<u32>,
    /// Repeats of half a second of learning; 0 leaves it out
    #[arg(long, value_name = "N", default_value_t = 7, value_parser = RangedU64ValueParser::<u32>::new().range(0..=1001))]
    learning: u32,
    /// Print the figures as one JSON object instead of a table
    #[arg(long)]
    json: bool,
}

/// Speed of learning, and the machine's bound beside it.
struct Learning {
    speed: sac::UpdateSpeed,
    fma_per_s: f64,
}

const LEARNING_REPEAT: Duration = Duration::from_millis(500);
/// Transitions of the replay that is learned from: as many as the paper keeps, so that memory is as far away.
const TRANSITIONS: usize = 500_000;

fn learning(args: &BenchArgs) -> Result<Option<Learning>, Failure> {
    if args.learning == 0 {
        return Ok(None);
    }
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let threads = args.threads.map_or(cores.min(crate::train::MOST_THREADS), |n| n as usize);
    let unavailable = |error: sac::LearnerError| Failure::Learner(error.to_string());
    let mut learner = sac::synthetic_learner(TRANSITIONS, sac::Machine::with_threads(threads)).map_err(unavailable)?;
    let before = sac::fma_peak(threads, LEARNING_REPEAT);
    let speed = sac::update_speed(&mut learner, args.learning as usize, LEARNING_REPEAT);
    Ok(Some(Learning { speed, fma_per_s: before.max(sac::fma_peak(threads, LEARNING_REPEAT)) }))
}

/// The lanes did not do what the single rig does, so their speed means nothing.
#[derive(Debug, thiserror::Error)]
#[error("lane 0 ended at {lanes:?} kPa, the single rig at {single:?} kPa; this build of the model is wrong, report it")]
pub(crate) struct LanesDiffer {
    single: Vec<f64>,
    lanes: Vec<f64>,
}

/// Resources that some work took.
#[derive(Debug, Clone, Copy)]
struct Took {
    wall: Duration,
    cpu: Duration,
}

/// Ticks per second by wall clock and CPU time, medians.
#[derive(Debug, Clone, Copy)]
struct Speed {
    wall: f64,
    cpu: f64,
}

pub(crate) fn run(args: &BenchArgs) -> Result<(), Failure> {
    let wrong = |problem: RigError| RigFileError::Rig { file: RIG.to_owned(), problem };
    let mut rig = Rig::builtin(RIG).map_err(wrong)?;
    // Exactly 200 steps to a tick, as in the C program that the figures are held against.
    rig.integrator.refine_switching = false;
    let one = Arc::new(Plant::<f64>::new(&rig).map_err(wrong)?);
    let many = Arc::new(Plant::<Lanes<LANES>>::side_by_side(std::slice::from_ref(&rig)).map_err(wrong)?);
    // Predictions as the daemon makes them.
    rig.integrator.refine_switching = true;
    let predictor = Predictor::new(&rig).map_err(wrong)?;
    let plant = DualPressureRig::new(&rig).map_err(wrong)?;

    let mut progress = Progress::new("measuring", 2 * u64::from(args.repeats));
    let (mut single, mut lanes) = (Vec::new(), Vec::new());
    let mut ends_kpa = Vec::new();
    for _ in 0..args.repeats {
        let (took, end_kpa) = along_the_schedule(&one, args.ticks);
        single.push(took);
        progress.advance(1);
        let (took, lane_kpa) = along_the_schedule(&many, args.ticks);
        lanes.push(took);
        progress.advance(1);
        if end_kpa.iter().zip(&lane_kpa).any(|(one, lane)| one.to_bits() != lane.to_bits()) {
            return Err(LanesDiffer { single: end_kpa, lanes: lane_kpa }.into());
        }
        ends_kpa = end_kpa;
    }
    let single = speed(&single, f64::from(args.ticks));
    let lanes = speed(&lanes, f64::from(args.ticks) * LANES as f64);
    let mpobs_us = predictions(plant, predictor, args.predictions);
    drop(progress);
    let learning = learning(args)?;

    let [p50, p999, max] = [0.5, 0.999, 1.0].map(|share| percentile(&mpobs_us, share));
    let end = |channel: usize| ends_kpa.get(channel).copied().unwrap_or(f64::NAN);
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let set = format!("{:?}", InstructionSet::detect()).to_lowercase();
    if args.json {
        let mut figures = json!({
            "rig": RIG, "ticks": args.ticks, "repeats": args.repeats, "lanes": LANES, "predictions": args.predictions,
            "ticks_per_s_single": single.wall, "ticks_per_s_single_cpu": single.cpu,
            "ticks_per_s_lanes": lanes.wall, "ticks_per_s_lanes_cpu": lanes.cpu,
            "mpobs_us_p50": p50, "mpobs_us_p999": p999, "mpobs_us_max": max,
            "p_pos_kpa": end(0), "p_neg_kpa": end(1), "instruction_set": set, "cores": cores,
        });
        if let Some(Learning { speed, fma_per_s }) = learning {
            figures["updates_per_s"] = speed.updates_per_s.into();
            figures["updates_threads"] = speed.threads.into();
            figures["fma_gflop_per_s"] = (fma_per_s * 1e-9).into();
            figures["updates_share_of_fma"] = speed.part_of(fma_per_s).into();
        }
        return stdout::say_json(&figures);
    }
    let learned = learning.map_or(String::new(), |Learning { speed, fma_per_s }| {
        format!(
            "\nlearning           {:>13.0} updates/s on {} threads, {:.0} % of {:.0} GFLOP/s",
            speed.updates_per_s,
            speed.threads,
            100.0 * speed.part_of(fma_per_s),
            fma_per_s * 1e-9
        )
    });
    let shared = 1.0 - (single.wall + lanes.wall) / (single.cpu + lanes.cpu);
    if shared > SHARED {
        tell(&format!(
            "other work took {:.0} % of this core, so wall clock figures are too slow; measure again when idle",
            100.0 * shared
        ));
    }
    stdout::say(&format!(
        "{RIG}, one core of {cores}, {set}; a tick is 20 ms, 200 RK4 steps; medians of {} repeats\n\
         \x20                           wall      CPU time\n\
         one rig            {:>13.0} {:>13.0}  ticks/s\n\
         {LANES} lanes            {:>13.0} {:>13.0}  ticks/s, all lanes ({:.1} times one rig)\n\
         MPObs, 5 ticks     p50 {p50:.1} µs, p99.9 {p999:.1} µs, max {max:.1} µs over {} predictions\n\
         after {} ticks     p_pos_kpa={:.4} p_neg_kpa={:.4}{learned}",
        args.repeats,
        single.wall,
        single.cpu,
        lanes.wall,
        lanes.cpu,
        lanes.wall / single.wall,
        args.predictions,
        args.ticks,
        end(0),
        end(1),
    ))
}

/// Runs from rest along the schedule; what it took, and where lane 0's sensors ended, in kPa.
fn along_the_schedule<R: Simulated>(plant: &Arc<Plant<R>>, ticks: u32) -> (Took, Vec<f64>) {
    // The inputs of this rig: two duties, and its relay held on.
    let columns: Vec<Option<usize>> = plant
        .inputs()
        .iter()
        .map(|input| DualPressurePorts::DUTY.iter().position(|column| *column == input.column))
        .collect();
    let mut inputs = vec![R::splat(1.0); columns.len()];
    let mut simulation = Simulation::new(Arc::clone(plant));
    let took = timed(|| {
        for tick in 0..ticks {
            for (slot, duty_of) in inputs.iter_mut().zip(&columns) {
                if let Some(channel) = duty_of {
                    *slot = R::from_lanes(|lane| {
                        duty(tick + LANE_SHIFT * lane as u32).get(*channel).copied().unwrap_or(f64::NAN)
                    });
                }
            }
            simulation.tick(black_box(&inputs));
        }
    });
    (took, simulation.readings_kpa().map(|reading| reading.lane(0)).collect())
}

/// Times predictions one by one, in µs, sorted; the model is corrected and run along as in the daemon, untimed.
fn predictions(mut plant: DualPressureRig, mut predictor: Predictor, count: u32) -> Vec<f64> {
    let mut took_us = Vec::with_capacity(count as usize);
    for tick in 0..count {
        let now = duty(tick);
        let ahead = std::array::from_fn(|j| duty(tick + j as u32));
        predictor.observe(plant.readings_kpa());
        let start = Instant::now();
        black_box(predictor.predict(black_box(&ahead), true));
        took_us.push(start.elapsed().as_secs_f64() * 1e6);
        predictor.advance(now, true);
        plant.tick(now, true);
    }
    took_us.sort_unstable_by(f64::total_cmp);
    took_us
}

fn timed(work: impl FnOnce()) -> Took {
    let (wall, cpu) = (Instant::now(), cpu_time());
    work();
    Took { wall: wall.elapsed(), cpu: cpu_time().saturating_sub(cpu) }
}

/// CPU time of this thread.
fn cpu_time() -> Duration {
    // Never negative: it counts from the thread's start.
    Duration::try_from(clock_gettime(ClockId::ThreadCPUTime)).unwrap_or_default()
}

fn speed(took: &[Took], ticks: f64) -> Speed {
    let median = |time: fn(&Took) -> Duration| {
        let mut seconds: Vec<f64> = took.iter().map(|each| time(each).as_secs_f64()).collect();
        seconds.sort_unstable_by(f64::total_cmp);
        ticks / percentile(&seconds, 0.5)
    };
    Speed { wall: median(|took| took.wall), cpu: median(|took| took.cpu) }
}

/// The smallest of sorted numbers that `share` of all do not exceed; NaN of none.
fn percentile(sorted: &[f64], share: f64) -> f64 {
    let rank = (share * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.clamp(1, sorted.len().max(1)) - 1).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_members_of_the_sample() {
        let thousand: Vec<f64> = (1..=1000).map(f64::from).collect();
        assert_eq!([0.5, 0.999, 1.0].map(|share| percentile(&thousand, share)), [500.0, 999.0, 1000.0]);
        assert_eq!(percentile(&[3.0], 0.5), 3.0);
        assert!(percentile(&[], 0.5).is_nan());
    }

    #[test]
    fn cpu_time_runs_with_work_and_not_with_sleep() {
        let asleep = timed(|| std::thread::sleep(Duration::from_millis(30)));
        // A sleep costs microseconds of CPU; thirty milliseconds of it would be wall time.
        assert!(asleep.wall >= Duration::from_millis(30) && asleep.cpu < Duration::from_millis(15), "{asleep:?}");
        let awake = timed(|| {
            let start = cpu_time();
            while cpu_time() - start < Duration::from_millis(5) {}
        });
        assert!(awake.cpu >= Duration::from_millis(5), "{awake:?}");
    }
}

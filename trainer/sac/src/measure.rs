//! Speed of the learner on this machine, beside what the machine could do.

use std::hint::black_box;
use std::time::{Duration, Instant};

use crate::feature_map::FeatureMap;
use crate::kernel::{Cpu, Vector, Work};
use crate::learner::{Learner, LearnerError, Machine};
use crate::replay::Transition;
use crate::settings::{Settings, Shape};

/// Multiplications and additions of an update in the matrix products alone, with 84 observations, 12 actions,
/// [256, 256] and 128 samples, as the peers' benchmark counts them: 1,859,584 × 128 × 2.
const FLOP_AN_UPDATE: f64 = 476.05e6;

/// A measured speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UpdateSpeed {
    /// Threads.
    pub threads: usize,
    /// Median over the repeats.
    pub updates_per_s: f64,
    /// Slowest and fastest repeat.
    pub range: [f64; 2],
    /// Median per second of the calling thread's own processor time, where the system tells it: what one thread
    /// would do if nobody else wanted its core.
    pub updates_per_own_s: Option<f64>,
}

impl UpdateSpeed {
    /// As a part of what `flop_per_s` on these threads together would allow.
    pub fn part_of(&self, flop_per_s: f64) -> f64 {
        self.updates_per_s * FLOP_AN_UPDATE / flop_per_s
    }
}

/// A learner of the paper's size with this many made-up transitions.
///
/// # Errors
/// No thread to be had.
pub fn synthetic_learner(transitions: usize, machine: Machine) -> Result<Learner, LearnerError> {
    let shape = Shape { observations: 84, goal: 32..84, actions: 12 };
    let mut settings = Settings::paper(&shape);
    settings.replay_capacity = transitions.max(settings.batch);
    settings.lambda_temporal = 0.1;
    settings.lambda_spatial = 0.1;
    settings.spatial_sigma.iter_mut().for_each(|sigma| *sigma = sigma.min(0.05));
    let mut learner = Learner::new(shape, FeatureMap::identity(84)?, settings, machine)?;
    let mut state = 1u64;
    let mut number = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1 << 23) as f32 - 1.0
    };
    for n in 0..transitions {
        let mut numbers = [0.0; 181];
        numbers.iter_mut().for_each(|x| *x = number());
        let (observation, rest) = numbers.split_at(84);
        let (next_observation, rest) = rest.split_at(84);
        let (action, reward) = rest.split_at(12);
        let terminal = n.is_multiple_of(100);
        let transition = Transition { observation, action, reward: reward[0], next_observation, terminal };
        // The sizes are those of the shape above.
        let _ = learner.push(&transition);
    }
    Ok(learner)
}

/// Updates per second of a learner: the median of so many repeats of this length, after one to warm up.
pub fn update_speed(learner: &mut Learner, repeats: usize, length: Duration) -> UpdateSpeed {
    let mut once = || {
        let (start, own, mut updates) = (Instant::now(), own_seconds(), 0.0);
        while start.elapsed() < length {
            learner.update(8);
            updates += 8.0;
        }
        let own = own.zip(own_seconds()).map(|(before, after)| updates / (after - before));
        (updates / start.elapsed().as_secs_f64(), own)
    };
    once();
    let measured: Vec<(f64, Option<f64>)> = (0..repeats.max(1)).map(|_| once()).collect();
    let speeds = sorted(measured.iter().map(|&(speed, _)| speed));
    let own = sorted(measured.iter().filter_map(|&(_, own)| own));
    UpdateSpeed {
        threads: learner.threads(),
        updates_per_s: speeds[speeds.len() / 2],
        range: [speeds[0], speeds[speeds.len() - 1]],
        updates_per_own_s: own.get(own.len() / 2).copied(),
    }
}

fn sorted(numbers: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut numbers: Vec<f64> = numbers.collect();
    numbers.sort_by(f64::total_cmp);
    numbers
}

/// Seconds that this thread has had a processor (Linux).
fn own_seconds() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    let nanoseconds: f64 = text.split_whitespace().next()?.parse().ok()?;
    Some(nanoseconds * 1e-9)
}

/// Floating-point operations per second of fused products in registers, on so many threads at once, all summed.
pub fn fma_peak(threads: usize, length: Duration) -> f64 {
    let probe = || {
        let cpu = Cpu::best();
        // 2 operations × 16 lanes × 16 sums × 4096 rounds.
        let operations = 2.0 * 16.0 * 16.0 * 4096.0;
        let mut best = f64::INFINITY;
        let start = Instant::now();
        while start.elapsed() < length {
            let one = Instant::now();
            black_box(cpu.run(Products { rounds: black_box(4096) }));
            best = best.min(one.elapsed().as_secs_f64());
        }
        operations / best
    };
    std::thread::scope(|scope| {
        let others: Vec<_> = (1..threads).map(|_| scope.spawn(probe)).collect();
        let own = probe();
        own + others.into_iter().map(|other| other.join().unwrap_or(0.0)).sum::<f64>()
    })
}

/// Fused products that wait for nothing but themselves: 16 sums cover the latency of two units.
struct Products {
    rounds: usize,
}

impl Work for Products {
    type Output = f32;
    #[inline(always)]
    fn run<V: Vector>(self) -> f32 {
        crate::kernel::chained_products::<V>(self.rounds)
    }
}

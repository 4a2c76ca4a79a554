//! Threads that go through an update together.
//!
//! An update has six phases with a barrier after each: batch through actor, slow critics and the first critic; its
//! step; batch through the second critic; its step; batch through critics and actor; the actor's step and the
//! temperature's. In every other one, from the first, each thread writes its own panels and reads all parameters, in
//! the others it is the other way round. Critics take turns so that all that one needs stays in the second-level cache. The locks below say so to the
//! compiler: between meetings nobody ever waits for one, and a mistake would stand still instead of racing.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard, mpsc};
use std::thread::JoinHandle;

use crate::actor_step::{ActorPhase, step_actor};
use crate::adam::AdamStep;
use crate::batch::{Block, Frame, Lanes, Smoothness};
use crate::critic_step::{CriticPhase, step_critic};
use crate::elementary::exp;
use crate::network_step::StepScratch;
use crate::parameters::{Kind, NetView, Part};
use crate::replay::Replay;
use crate::settings::TemperatureRule;

/// Reads; a thread that died left numbers, not broken structures.
pub(crate) fn read<T>(lock: &RwLock<T>) -> RwLockReadGuard<'_, T> {
    lock.read().unwrap_or_else(PoisonError::into_inner)
}

/// Writes; see [`read`].
pub(crate) fn write<T>(lock: &RwLock<T>) -> RwLockWriteGuard<'_, T> {
    lock.write().unwrap_or_else(PoisonError::into_inner)
}

/// Where threads wait for each other, spinning: a phase takes a fraction of a millisecond.
#[derive(Debug)]
struct Barrier {
    threads: usize,
    arrived: AtomicUsize,
    held: AtomicUsize,
}

/// Turns of the waiting loop before the core is offered to others.
const PATIENCE: u32 = 1 << 14;

impl Barrier {
    fn wait(&self) {
        if self.threads == 1 {
            return;
        }
        let held = self.held.load(Ordering::Acquire);
        if self.arrived.fetch_add(1, Ordering::AcqRel) + 1 == self.threads {
            self.arrived.store(0, Ordering::Relaxed);
            self.held.store(held.wrapping_add(1), Ordering::Release);
            return;
        }
        let mut turns = 0;
        while self.held.load(Ordering::Acquire) == held {
            if turns < PATIENCE {
                turns += 1;
                std::hint::spin_loop();
            } else {
                std::thread::yield_now();
            }
        }
    }
}

/// `ln α` and its moments.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Temperature {
    pub(crate) log: f32,
    pub(crate) mean: f32,
    pub(crate) square: f32,
}

/// Sums over updates of the batch means.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Sums {
    pub(crate) critic_loss: f64,
    pub(crate) actor_loss: f64,
    pub(crate) entropy: f64,
    pub(crate) value: f64,
    pub(crate) temporal: f64,
    pub(crate) spatial: f64,
}

/// Everything that the threads share.
#[derive(Debug)]
pub(crate) struct Shared {
    pub(crate) frame: Frame,
    pub(crate) replay: RwLock<Replay>,
    /// One for each thread.
    pub(crate) critics: Vec<RwLock<[Part; 2]>>,
    pub(crate) actor: Vec<RwLock<Part>>,
    pub(crate) blocks: Vec<RwLock<Block>>,
    pub(crate) temperature: RwLock<Temperature>,
    pub(crate) sums: Mutex<Sums>,
    barrier: Barrier,
}

/// Part of the actor in an update.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ActorUpdate {
    /// Actor and temperature take their steps.
    Learns,
    /// Both stay; the critics alone learn.
    Frozen,
}

/// Updates to be done: so many `times`, the `first` of which has this number (from 0).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Job {
    pub(crate) first: u64,
    pub(crate) times: u64,
    pub(crate) smoothness: Smoothness,
    pub(crate) learning_rate: f32,
    pub(crate) actor: ActorUpdate,
}

impl Shared {
    pub(crate) fn new(
        frame: Frame,
        replay: Replay,
        critics: Vec<[Part; 2]>,
        actor: Vec<Part>,
        temperature: Temperature,
    ) -> Self {
        let threads = actor.len();
        let blocks = (0..threads).map(|t| RwLock::new(Block::new(&frame, t, threads))).collect();
        Self {
            frame,
            replay: RwLock::new(replay),
            critics: critics.into_iter().map(RwLock::new).collect(),
            actor: actor.into_iter().map(RwLock::new).collect(),
            blocks,
            temperature: RwLock::new(temperature),
            sums: Mutex::default(),
            barrier: Barrier { threads, arrived: AtomicUsize::new(0), held: AtomicUsize::new(0) },
        }
    }

    /// One thread's share of a job.
    fn work(&self, thread: usize, job: Job, room: &mut StepScratch) {
        for time in job.first..job.first + job.times {
            self.update(thread, job, time, room);
        }
    }

    fn update(&self, thread: usize, job: Job, time: u64, room: &mut StepScratch) {
        let Job { smoothness, learning_rate, .. } = job;
        let settings = &self.frame.settings;
        let adam = AdamStep::new(time + 1, learning_rate, settings.soft_update);
        let temperature = exp(read(&self.temperature).log);
        for c in 0..2 {
            let (actor, critics) = (self.actor.iter().map(read).collect::<Vec<_>>(), self.read_critics());
            let phase = CriticPhase {
                frame: &self.frame,
                replay: &read(&self.replay),
                actor: &NetView::new(actor.iter().map(|part| &**part), Kind::Value),
                critics: &twins(&critics, Kind::Value),
                slow: &twins(&critics, Kind::Target),
                smoothness,
                temperature,
                time,
            };
            let mut block = write(&self.blocks[thread]);
            if c == 0 {
                phase.ask(&mut block);
            }
            phase.pass(c, &mut block);
            drop((block, actor, critics));
            self.barrier.wait();
            {
                let blocks: Vec<_> = self.blocks.iter().map(read).collect();
                let blocks: Vec<&Block> = blocks.iter().map(|block| &**block).collect();
                step_critic(&self.frame, &blocks, room, &mut write(&self.critics[thread])[c], adam);
            }
            self.barrier.wait();
        }
        if job.actor == ActorUpdate::Frozen {
            if thread == 0 {
                let blocks: Vec<_> = self.blocks.iter().map(read).collect();
                let records = blocks.iter().flat_map(|block| &block.panels).map(|panel| &panel.records);
                let loss: f64 = records.flat_map(|r| &r.critic_loss).flat_map(|line| line.0).map(f64::from).sum();
                let mut sums = self.sums.lock().unwrap_or_else(PoisonError::into_inner);
                sums.critic_loss += loss / settings.batch as f64;
            }
            // The next update writes the panels that the first thread reads here.
            self.barrier.wait();
            return;
        }
        {
            let (actor, critics) = (self.actor.iter().map(read).collect::<Vec<_>>(), self.read_critics());
            let phase = ActorPhase {
                frame: &self.frame,
                actor: &NetView::new(actor.iter().map(|part| &**part), Kind::Value),
                critics: &twins(&critics, Kind::Value),
                smoothness,
                temperature,
            };
            phase.pass(&mut write(&self.blocks[thread]));
        }
        self.barrier.wait();
        {
            let blocks: Vec<_> = self.blocks.iter().map(read).collect();
            let blocks: Vec<&Block> = blocks.iter().map(|block| &**block).collect();
            if thread == 0 {
                self.conclude(&blocks, temperature, adam);
            }
            step_actor(&self.frame, &blocks, smoothness, room, &mut write(&self.actor[thread]), adam);
        }
        self.barrier.wait();
    }

    fn read_critics(&self) -> Vec<RwLockReadGuard<'_, [Part; 2]>> {
        self.critics.iter().map(read).collect()
    }

    /// The report's sums and the temperature's step, `∂/∂ln α of −α (ln π + target)`, by one thread.
    fn conclude(&self, blocks: &[&Block], temperature: f32, adam: AdamStep) {
        let records = || blocks.iter().flat_map(|block| &block.panels).map(|panel| &panel.records);
        let batch = self.frame.settings.batch as f64;
        let sum = |lanes: &Lanes| lanes.iter().flat_map(|line| line.0).map(f64::from).sum::<f64>();
        let log_probability = records().map(|r| sum(&r.log_probability)).sum::<f64>() / batch;
        let mut sums = self.sums.lock().unwrap_or_else(PoisonError::into_inner);
        sums.critic_loss += records().map(|r| sum(&r.critic_loss)).sum::<f64>() / batch;
        sums.actor_loss += records().map(|r| sum(&r.actor_loss)).sum::<f64>() / batch;
        sums.entropy -= log_probability;
        sums.value += records().map(|r| sum(&r.value)).sum::<f64>() / batch;
        sums.temporal += records().map(|r| sum(&r.temporal)).sum::<f64>() / batch;
        sums.spatial += records().map(|r| sum(&r.spatial)).sum::<f64>() / batch;
        if matches!(self.frame.settings.temperature, TemperatureRule::Learned(_)) {
            let gradient = -temperature * (log_probability as f32 + self.frame.settings.target_entropy);
            let mut state = write(&self.temperature);
            let (log, mean, square) = adam.apply(state.log, state.mean, state.square, gradient);
            *state = Temperature { log, mean, square };
        }
    }
}

/// Both critics, put together from their parts.
fn twins<'a>(parts: &'a [RwLockReadGuard<'_, [Part; 2]>], kind: Kind) -> [NetView<'a>; 2] {
    [0, 1].map(|c| NetView::new(parts.iter().map(move |part| &part[c]), kind))
}

/// The threads beside the caller's; they sleep between jobs and end with this value.
#[derive(Debug)]
pub(crate) struct Workers {
    shared: Arc<Shared>,
    jobs: Vec<mpsc::Sender<Job>>,
    handles: Vec<JoinHandle<()>>,
    room: StepScratch,
}

impl Workers {
    pub(crate) fn new(shared: Arc<Shared>) -> std::io::Result<Self> {
        let (mut jobs, mut handles) = (Vec::new(), Vec::new());
        for thread in 1..shared.actor.len() {
            let (sender, receiver) = mpsc::channel::<Job>();
            let shared = Arc::clone(&shared);
            let run = move || {
                let mut room = StepScratch::new(&shared.frame);
                receiver.iter().for_each(|job| shared.work(thread, job, &mut room));
            };
            handles.push(std::thread::Builder::new().name(format!("learn-{thread}")).spawn(run)?);
            jobs.push(sender);
        }
        let room = StepScratch::new(&shared.frame);
        Ok(Self { shared, jobs, handles, room })
    }

    pub(crate) fn threads(&self) -> usize {
        self.jobs.len() + 1
    }

    /// Runs a job on all threads; back when it is done.
    pub(crate) fn run(&mut self, job: Job) {
        // A receiver lives as long as its sender here, so a job cannot get lost.
        for sender in &self.jobs {
            let _ = sender.send(job);
        }
        self.shared.work(0, job, &mut self.room);
    }
}

impl Drop for Workers {
    fn drop(&mut self) {
        self.jobs.clear();
        self.handles.drain(..).for_each(|handle| drop(handle.join()));
    }
}

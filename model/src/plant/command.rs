//! The command path of a valve: from the duty sent to the duty that acts, instant by instant.

use super::INSTANTS_PER_STEP;
use crate::mechanism::{Delay, Lag, Play};
use crate::real::Real;

/// A duty over one tick, at the instants the integrator asks for: one value, or one for each.
#[derive(Debug, Clone)]
pub(crate) struct Samples<R> {
    values: Vec<R>,
    spread: bool,
}

impl<R: Real> Samples<R> {
    /// Room for a tick of `steps` integration steps.
    pub(crate) fn new(steps: usize) -> Self {
        Samples { values: vec![R::splat(0.0); INSTANTS_PER_STEP * steps + 1], spread: false }
    }

    /// Sets the duty that was sent, constant over the tick.
    #[inline(always)]
    pub(crate) fn set(&mut self, duty: R) {
        self.spread = false;
        if let Some(first) = self.values.first_mut() {
            *first = duty;
        }
    }

    /// The duty at the start of the tick.
    #[inline(always)]
    pub(crate) fn first(&self) -> R {
        self.values.first().copied().unwrap_or(R::splat(0.0))
    }

    /// The duty at instant `k`.
    #[inline(always)]
    pub(crate) fn at(&self, k: usize) -> R {
        let k = if self.spread { k } else { 0 };
        self.values.get(k).copied().unwrap_or(R::splat(0.0))
    }

    /// Instants after the first in a tick.
    pub(crate) fn instants(&self) -> usize {
        self.values.len() - 1
    }

    /// Makes room for a duty that changes within the tick.
    #[inline(always)]
    pub(crate) fn spread(&mut self) {
        if !self.spread {
            let first = self.first();
            self.values.fill(first);
            self.spread = true;
        }
    }

    /// Replaces each sample in the order of time (just one where the duty is constant).
    #[inline(always)]
    pub(crate) fn each(&mut self, mut f: impl FnMut(R) -> R) {
        if self.spread {
            for value in &mut self.values {
                *value = f(*value);
            }
        } else if let Some(first) = self.values.first_mut() {
            *first = f(*first);
        }
    }
}

/// One operator on the command path.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Stage<R> {
    /// `command_delay`
    Delay(Delay<R>),
    /// `valve_lag`
    Lag(Lag<R>),
    /// `valve_hysteresis`
    Play(Play<R>),
}

impl Stage<f64> {
    /// The order along the path: wire, coil, flapper.
    pub(crate) fn rank(&self) -> u8 {
        match self {
            Stage::Delay(_) => 0,
            Stage::Lag(_) => 1,
            Stage::Play(_) => 2,
        }
    }
}

impl<R: Real> Stage<R> {
    /// Numbers it remembers from tick to tick.
    pub(crate) fn memory_len(&self) -> usize {
        match self {
            Stage::Delay(_) => crate::mechanism::LONGEST_TICKS,
            Stage::Lag(_) | Stage::Play(_) => 1,
        }
    }

    /// Merges twins; `None` if they are of different kinds.
    pub(crate) fn side_by_side(parts: &[Stage<f64>]) -> Option<Self> {
        macro_rules! all {
            ($kind:ident, $operator:ident) => {{
                let same: Option<Vec<$operator<f64>>> =
                    parts.iter().map(|s| if let Stage::$kind(o) = s { Some(*o) } else { None }).collect();
                Some(Stage::$kind($operator::side_by_side(&same?)))
            }};
        }
        match parts.first()? {
            Stage::Delay(_) => all!(Delay, Delay),
            Stage::Lag(_) => all!(Lag, Lag),
            Stage::Play(_) => all!(Play, Play),
        }
    }

    #[inline(always)]
    fn run(&self, memory: &mut [R], samples: &mut Samples<R>) {
        match self {
            Stage::Delay(delay) => delay.run(memory, samples),
            Stage::Lag(lag) => {
                if let Some(memory) = memory.first_mut() {
                    lag.run(memory, samples);
                }
            }
            Stage::Play(play) => {
                if let Some(memory) = memory.first_mut() {
                    play.run(memory, samples);
                }
            }
        }
    }
}

/// The command path of one valve.
#[derive(Debug, Clone)]
pub(crate) struct CommandPath<R> {
    /// Input that carries the duty.
    pub(crate) input: usize,
    /// Where its memory starts.
    pub(crate) memory: usize,
    /// Operators in the order they act.
    pub(crate) stages: Vec<Stage<R>>,
}

impl<R: Real> CommandPath<R> {
    /// Merges twins; `None` if their structure differs.
    pub(crate) fn side_by_side(parts: &[&CommandPath<f64>]) -> Option<Self> {
        let first = parts.first()?;
        let same = |p: &&CommandPath<f64>| {
            p.input == first.input && p.memory == first.memory && p.stages.len() == first.stages.len()
        };
        if !parts.iter().all(same) {
            return None;
        }
        let stages = (0..first.stages.len())
            .map(|i| Stage::side_by_side(&parts.iter().filter_map(|p| p.stages.get(i).copied()).collect::<Vec<_>>()))
            .collect::<Option<_>>()?;
        Some(CommandPath { input: first.input, memory: first.memory, stages })
    }

    /// Fills `samples` with the duty that acts over the tick in which `sent` is commanded.
    #[inline(always)]
    pub(crate) fn run(&self, sent: R, memory: &mut [R], samples: &mut Samples<R>) {
        samples.set(sent);
        let mut at = self.memory;
        for stage in &self.stages {
            let end = at + stage.memory_len();
            if let Some(own) = memory.get_mut(at..end) {
                stage.run(own, samples);
            }
            at = end;
        }
    }

    /// Sets the memory as if `duty` had been commanded for ever.
    pub(crate) fn settle(&self, duty: R, memory: &mut [R]) {
        let len: usize = self.stages.iter().map(Stage::memory_len).sum();
        if let Some(own) = memory.get_mut(self.memory..self.memory + len) {
            own.fill(duty);
        }
    }
}

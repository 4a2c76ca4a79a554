//! The command path of a valve: from the duty sent to the duty that acts, instant by instant.

use super::INSTANTS_PER_STEP;
use crate::mechanism::{Bend, Delay, Heat, Lag, Play, Stick};
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

    /// Tells whether the duty changes within the tick.
    #[inline(always)]
    pub(crate) fn is_spread(&self) -> bool {
        self.spread
    }

    /// Puts the mean over each step at its middle instant, where the integrator then reads it for the whole step.
    #[inline(always)]
    pub(crate) fn take_means(&mut self) {
        if !self.spread {
            return;
        }
        let (quarter, eighth) = (R::splat(0.25), R::splat(0.125));
        for first in (0..self.instants()).step_by(INSTANTS_PER_STEP) {
            if let Some([a, b, c, d, e]) = self.values.get_mut(first..first + INSTANTS_PER_STEP + 1) {
                *c = quarter.mul_add(*b + *c + *d, eighth * (*a + *e));
            }
        }
    }

    /// Multiplies the duty at instant `k`.
    #[inline(always)]
    pub(crate) fn scale(&mut self, k: usize, factor: R) {
        if let Some(value) = self.values.get_mut(k) {
            *value = *value * factor;
        }
    }

    /// The samples in the order of time (just one where the duty is constant), to be replaced one by one. For loops and
    /// not for closures, which are not compiled for the instruction set of the tick around them.
    #[inline(always)]
    pub(crate) fn in_time(&mut self) -> &mut [R] {
        let count = if self.spread { self.values.len() } else { 1 };
        self.values.get_mut(..count).unwrap_or_default()
    }
}

/// One operator on the command path.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Stage<R> {
    /// `command_delay`
    Delay(Delay<R>),
    /// `coil_heating`
    Heat(Heat<R>),
    /// `valve_lag` of the coil
    Lag(Lag<R>),
    /// `valve_lag` of the armature
    LateArmature(Lag<R>),
    /// `valve_force_curve`, the coil's part
    Bend(Bend<R>),
    /// `valve_stiction`
    Stick(Stick<R>),
    /// `valve_hysteresis`
    Play(Play<R>),
}

impl Stage<f64> {
    /// The order along the path: wire, (supply,) coil, friction and hysteresis, armature.
    pub(crate) fn rank(&self) -> u8 {
        match self {
            Stage::Delay(_) => 0,
            Stage::Heat(_) => 1,
            Stage::Lag(_) => 2,
            Stage::Bend(_) => 3,
            Stage::Stick(_) => 4,
            Stage::Play(_) => 5,
            Stage::LateArmature(_) => 6,
        }
    }
}

impl<R: Real> Stage<R> {
    /// Numbers it remembers from tick to tick.
    pub(crate) fn memory_len(&self) -> usize {
        match self {
            Stage::Delay(_) => crate::mechanism::LONGEST_TICKS,
            Stage::Heat(_) => Heat::MEMORY,
            Stage::Lag(_) | Stage::Stick(_) | Stage::LateArmature(_) => 1,
            Stage::Play(_) => Play::<R>::MEMORY,
            Stage::Bend(_) => 0,
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
            Stage::Heat(_) => all!(Heat, Heat),
            Stage::Lag(_) => all!(Lag, Lag),
            Stage::Bend(_) => all!(Bend, Bend),
            Stage::Stick(_) => all!(Stick, Stick),
            Stage::Play(_) => all!(Play, Play),
            Stage::LateArmature(_) => all!(LateArmature, Lag),
        }
    }

    #[inline(always)]
    fn run(&self, memory: &mut [R], samples: &mut Samples<R>) {
        match (self, memory) {
            (Stage::Delay(delay), memory) => delay.run(memory, samples),
            (Stage::Bend(bend), _) => bend.run(samples),
            (Stage::Heat(heat), memory) => heat.run(memory, samples),
            (Stage::Lag(lag) | Stage::LateArmature(lag), [memory]) => lag.run(memory, samples),
            (Stage::Stick(stick), [memory]) => stick.run(memory, samples),
            (Stage::Play(play), memory) => play.run(memory, samples),
            _ => {}
        }
    }

    /// Sets the memory as if `duty` had come in for ever; what comes out then.
    fn settle(&self, duty: R, memory: &mut [R]) -> R {
        match self {
            Stage::Heat(heat) => {
                memory.fill(heat.initial);
                heat.at(duty, heat.initial)
            }
            Stage::Bend(bend) => bend.at(duty),
            Stage::Delay(_) | Stage::Lag(_) | Stage::Stick(_) | Stage::Play(_) | Stage::LateArmature(_) => {
                memory.fill(duty);
                duty
            }
        }
    }
}

/// The command path of one valve, or of a pump whose flow is commanded.
#[derive(Debug, Clone)]
pub(crate) struct CommandPath<R> {
    /// Input that carries the duty.
    pub(crate) input: usize,
    /// Where its memory starts.
    pub(crate) memory: usize,
    /// True where it draws its current from the supply that all valves share.
    pub(crate) on_supply: bool,
    /// Operators in the order they act.
    pub(crate) stages: Vec<Stage<R>>,
}

impl<R: Real> CommandPath<R> {
    /// Merges twins; `None` if their structure differs.
    pub(crate) fn side_by_side(parts: &[&CommandPath<f64>]) -> Option<Self> {
        let first = parts.first()?;
        let same = |p: &&CommandPath<f64>| {
            p.input == first.input
                && p.memory == first.memory
                && p.on_supply == first.on_supply
                && p.stages.len() == first.stages.len()
        };
        if !parts.iter().all(same) {
            return None;
        }
        let stages = (0..first.stages.len())
            .map(|i| Stage::side_by_side(&parts.iter().filter_map(|p| p.stages.get(i).copied()).collect::<Vec<_>>()))
            .collect::<Option<_>>()?;
        Some(CommandPath { input: first.input, memory: first.memory, on_supply: first.on_supply, stages })
    }

    /// Fills `samples` with the duty that acts over the tick in which `sent` is commanded.
    #[inline(always)]
    pub(crate) fn run(&self, sent: R, memory: &mut [R], samples: &mut Samples<R>) {
        samples.set(sent);
        self.run_stages(memory, samples, |_| true);
    }

    /// The part of [`CommandPath::run`] up to the driver, which is what draws current.
    #[inline(always)]
    pub(crate) fn run_to_driver(&self, sent: R, memory: &mut [R], samples: &mut Samples<R>) {
        samples.set(sent);
        self.run_stages(memory, samples, |stage| matches!(stage, Stage::Delay(_)));
    }

    /// The rest of it, on what the driver puts out.
    #[inline(always)]
    pub(crate) fn run_from_driver(&self, memory: &mut [R], samples: &mut Samples<R>) {
        self.run_stages(memory, samples, |stage| !matches!(stage, Stage::Delay(_)));
    }

    #[inline(always)]
    fn run_stages(&self, memory: &mut [R], samples: &mut Samples<R>, which: impl Fn(&Stage<R>) -> bool) {
        let mut at = self.memory;
        for stage in &self.stages {
            let end = at + stage.memory_len();
            if let Some(own) = memory.get_mut(at..end)
                && which(stage)
            {
                stage.run(own, samples);
            }
            at = end;
        }
    }

    /// Tells whether a coil in it warms.
    pub(crate) fn warms(&self) -> bool {
        self.stages.iter().any(|stage| matches!(stage, Stage::Heat(_)))
    }

    /// Warms its coils by the duties of some ticks, and how much of each there was, `instants` long.
    pub(crate) fn warm(&self, instants: usize, ticks: usize, held: &dyn Fn(usize) -> (R, R), memory: &mut [R]) {
        for (stage, start) in self.memories() {
            if let (Stage::Heat(heat), Some(own)) = (stage, memory.get_mut(start..start + stage.memory_len())) {
                heat.hold(instants, (0..ticks).map(held), own);
            }
        }
    }

    /// Sets the memory as if `sent` had been commanded for ever, `supplied` of it through the supply; what acts then.
    pub(crate) fn settle(&self, sent: R, supplied: R, memory: &mut [R]) -> R {
        let mut at = self.memory;
        let mut duty = supplied;
        for stage in &self.stages {
            let end = at + stage.memory_len();
            if let Some(own) = memory.get_mut(at..end) {
                // The wire in front of the driver carries what was sent.
                if matches!(stage, Stage::Delay(_)) {
                    own.fill(sent);
                } else {
                    duty = stage.settle(duty, own);
                }
            }
            at = end;
        }
        duty
    }

    /// Moves the flapper within the play at the path's end, if it has one, by a share of its half width (−1 … 1); an
    /// armature that is late has long been there.
    pub(crate) fn place_in_play(&self, share: R, memory: &mut [R]) {
        let mut placed = None;
        for (stage, start) in self.memories() {
            match (stage, memory.get_mut(start..start + stage.memory_len())) {
                (Stage::Play(play), Some(own)) => placed = Some(play.place(share, own)),
                (Stage::LateArmature(_), Some(own)) => {
                    if let Some(placed) = placed {
                        own.fill(placed);
                    }
                }
                _ => {}
            }
        }
    }

    /// Moves what dry friction holds by a share of its band (−1 … 1), and what follows it along with it.
    pub(crate) fn place_in_friction(&self, share: R, memory: &mut [R]) {
        let mut moved = R::splat(0.0);
        for (stage, start) in self.memories() {
            if let Stage::Stick(stick) = stage {
                moved = stick.band * share;
            }
            let follows = matches!(stage, Stage::Stick(_) | Stage::Play(_) | Stage::LateArmature(_));
            let own = memory.get_mut(start..start + stage.memory_len()).filter(|_| follows);
            own.into_iter().flatten().for_each(|duty| *duty += moved);
        }
    }

    /// Where the memory of each stage starts.
    pub(crate) fn memories(&self) -> impl Iterator<Item = (&Stage<R>, usize)> {
        let mut at = self.memory;
        self.stages.iter().map(move |stage| {
            let start = at;
            at += stage.memory_len();
            (stage, start)
        })
    }
}

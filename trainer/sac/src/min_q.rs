//! Gradient of the critics by the actor's actions: `∂ min_i Q_i / ∂a`.
//!
//! Only the smaller critic of each sample has a gradient. So a thread puts the samples of all its panels together
//! anew, by the critic that is the smaller, and passes each critic's own samples back through it alone: about half of
//! the work of passing all through both. The way back needs nothing of a sample but the bits of its gates, which makes
//! moving it cheap; and as lanes know nothing of each other, where a sample lies changes no bit of its gradient.

use crate::batch::{Lanes, NO_LANES, Panel, Scratch};
use crate::kernel::{Cpu, Gate, LANES, Line, Vector, WIDTH, Work};
use crate::parameters::NetView;
use crate::trace::Trace;

/// A sample by its panel and lane.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place {
    panel: usize,
    lane: usize,
}

/// Compares the critics' outputs: the smaller values, and the samples of which the first critic's is smaller.
pub(crate) struct Compare<'a> {
    pub(crate) critics: &'a [Trace; 2],
}

impl Work for Compare<'_> {
    type Output = (Lanes, Gate);
    #[inline(always)]
    fn run<V: Vector>(self) -> (Lanes, Gate) {
        let (mut value, mut firsts) = (NO_LANES, 0);
        let [first, second] = self.critics;
        for half in 0..2 {
            for l in 0..WIDTH {
                let (a, b) = (first.output[half].0[l], second.output[half].0[l]);
                value[half].0[l] = smaller(a, b);
                firsts |= Gate::from(a < b) << (half * WIDTH + l);
            }
        }
        (value, firsts)
    }
}

/// The smaller of two, or NaN where either is.
#[inline(always)]
pub(crate) fn smaller(a: f32, b: f32) -> f32 {
    if a < b || a.is_nan() { a } else { b }
}

/// Sets the smaller values and the action gradients of `loss = −mean min_i Q_i` in all panels, which the critics have
/// passed forward.
pub(crate) fn min_q(cpu: Cpu, critics: &[NetView<'_>; 2], batch: usize, panels: &mut [Panel], scratch: &mut Scratch) {
    let mut places = [Vec::new(), Vec::new()];
    for (n, panel) in panels.iter_mut().enumerate() {
        let (value, firsts) = cpu.run(Compare { critics: &panel.critics });
        panel.records.value = value;
        for lane in 0..LANES {
            places[if firsts >> lane & 1 == 1 { 0 } else { 1 }].push(Place { panel: n, lane });
        }
    }
    for (c, (places, net)) in places.iter().zip(critics).enumerate() {
        for places in places.chunks(LANES) {
            let Scratch { judge, action_gradient, .. } = scratch;
            cpu.run(Gather { places, from: panels, c, slope: -1.0 / batch as f32, to: judge });
            judge.backward(cpu, net, 1);
            judge.to_inputs(cpu, net, action_gradient);
            for (at, place) in places.iter().enumerate() {
                let to = panels[place.panel].action_gradient.chunks_exact_mut(2);
                for (to, from) in to.zip(action_gradient.chunks_exact(2)) {
                    to[place.lane / WIDTH].0[place.lane % WIDTH] = from[at / WIDTH].0[at % WIDTH];
                }
            }
        }
    }
}

/// Makes up to 32 samples a panel that critic `c` has passed, and sets its last gradient.
struct Gather<'a> {
    places: &'a [Place],
    from: &'a [Panel],
    c: usize,
    slope: f32,
    to: &'a mut Trace,
}

impl Work for Gather<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        for (l, gates) in self.to.gates.iter_mut().enumerate() {
            gates.fill(0);
            for (at, place) in self.places.iter().enumerate() {
                let from = &self.from[place.panel].critics[self.c].gates[l];
                for (to, from) in gates.iter_mut().zip(from) {
                    *to |= (from >> place.lane & 1) << at;
                }
            }
        }
        let Some(gradient) = self.to.gradient.last_mut() else { return };
        gradient.fill(Line::ZERO);
        for at in 0..self.places.len() {
            gradient[at / WIDTH].0[at % WIDTH] = self.slope;
        }
    }
}

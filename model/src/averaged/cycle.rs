//! One cylinder over revolutions at given port pressures: what a pump draws and delivers once it repeats itself.
//!
//! The same cylinder as `plant`'s (paper eqs. (1)-(3), with springs, rings and lines if the pump has them), alone
//! between two ports. Eight cells of the table are worked out side by side. In revolutions `r` instead of seconds,
//!
//! ```text
//! dP/dr = −P V'/V + (R T/V)(ṁ_in − ṁ_out − ṁ_blow)/n
//! ```
//!
//! with `n` in rev/s, so that cells may turn at different speeds. The map from the pressure at one bottom dead centre to
//! the next is nearly straight and forgets two thirds of a deviation (on the paper's rig), so two revolutions and one
//! step of Aitken's find where it repeats itself.

use super::pump_geometry::{PumpGeometry, Spring};
use crate::orifice::FlowFunction;
use crate::plant::{InstructionSet, WallTable};
use crate::real::{Lanes, Real};

/// Cells worked out at once.
pub(crate) type Eight = Lanes<8>;

/// Phases at which the ripple is tabled.
pub(crate) const PHASES: usize = 64;

/// Results of eight cells.
#[derive(Debug, Clone)]
pub(crate) struct Cells {
    /// Mean flow at the inlet and at the outlet of the whole pump, in kg/s.
    pub(crate) drawn: Eight,
    pub(crate) delivered: Eight,
    /// Mean gas in all cylinders, in kg.
    pub(crate) content: Eight,
    /// Change of the flows at inlet and outlet per gas in the cylinders beyond its mean, in 1/s.
    pub(crate) drawn_response: Eight,
    pub(crate) delivered_response: Eight,
    /// With what rate that excess disappears, in 1/s.
    pub(crate) relaxation: Eight,
    /// Gas drawn and delivered beyond the mean at each phase of the crank, in kg; zero on average.
    pub(crate) drawn_ripple: Vec<Eight>,
    pub(crate) delivered_ripple: Vec<Eight>,
}

/// A pump ready to be turned: what all cells share.
#[derive(Debug)]
pub(crate) struct Bench {
    machine: PumpGeometry,
    law: FlowFunction<Eight>,
    walls: WallTable<f64>,
    steps: usize,
    /// Steps that each piston is ahead of the shaft, counted from its own bottom dead centre (the trace starts there, half a
    /// revolution after a phase of zero); less than a revolution.
    offsets: Vec<usize>,
    /// Share of the pressure before a check valve below which the drop across it drives a laminar flow, in proportion; 0
    /// for never.
    laminar: f64,
}

/// Port pressures of eight cells, in Pa, with their ripple at the start of each step.
struct Ports {
    inlet: Eight,
    outlet: Eight,
    inlet_ripple: Vec<Eight>,
    outlet_ripple: Vec<Eight>,
}

/// Gas that went through one cylinder since the start of a revolution, at the start of each step and at its end, in kg.
struct Trace {
    drawn: Vec<Eight>,
    delivered: Vec<Eight>,
    content: Vec<Eight>,
}

/// Deviations are taken this small against the pressure: a percent stays in the straight part.
const NUDGE: f64 = 0.01;
/// Share of the pressure at which gas enters past a spring that is begun with; nine tenths are reached on the paper's rig.
const EMPTIER: f64 = 0.75;
/// A stalled cylinder keeps what it has for ever; the relaxation is cut off there.
const LONGEST_MEMORY: f64 = 0.98;

impl Bench {
    pub(crate) fn new(machine: &PumpGeometry, smooth: bool) -> Self {
        // The step of the detailed pump or half of it, and a whole number of steps between two tabled phases.
        let (finer, laminar) = if smooth { (2.0, LAMINAR) } else { (1.0, 0.0) };
        let per_phase =
            (finer / (machine.speed * machine.step_s * PHASES as f64)).ceil().clamp(2.0 * finer, 40.0 * finer);
        let steps = PHASES * per_phase as usize;
        let mut walls = WallTable::new(1, 1, steps, &[]);
        let (drive, cylinders) = machine.crank();
        // One revolution per second, so that the table is per revolution; it starts at bottom dead centre.
        walls.turn(0, &drive, &cylinders, 0.0, 1.0, 0.25 / steps as f64);
        let offset = |phase: &f64| ((phase + 0.5).rem_euclid(1.0) * steps as f64).round() as usize % steps;
        let offsets = machine.phases.iter().map(offset).collect();
        Bench {
            machine: machine.clone(),
            law: FlowFunction::from_lanes(&[machine.law]),
            walls,
            steps,
            offsets,
            laminar,
        }
    }

    /// The pump that is turned.
    pub(crate) fn machine(&self) -> &PumpGeometry {
        &self.machine
    }

    /// Works out eight cells at port pressures in Pa.
    pub(crate) fn cells(&self, inlet: Eight, outlet: Eight) -> Cells {
        let machine = &self.machine;
        let one = Eight::splat(1.0);
        let speed = machine.speed_at(inlet, outlet);
        let still = vec![Eight::splat(0.0); self.steps];
        let mut ports = Ports { inlet, outlet, inlet_ripple: still.clone(), outlet_ripple: still };
        let mut trace = Trace::new(self.steps);
        // Ports at rest: where the cylinder repeats itself, and how fast it forgets.
        let begun = self.begun(inlet);
        let first = self.turn(&ports, speed, begun, &mut trace);
        let second = self.turn(&ports, speed, first, &mut trace);
        let kept = memory(second - first, first - begun);
        let mut start = first + (second - first) / (one - kept);
        start = self.turn(&ports, speed, start, &mut trace);
        // Ports that breathe with what the pump moves, as they do in chambers of finite size.
        for _ in 0..2 {
            let (drawn, delivered) = (self.ripple(&trace.drawn), self.ripple(&trace.delivered));
            ports.inlet_ripple = self.seen(&drawn, -machine.inlet_pa_per_kg);
            ports.outlet_ripple = self.seen(&delivered, machine.outlet_pa_per_kg);
            let end = self.turn(&ports, speed, start, &mut trace);
            start += (end - start) / (one - kept);
        }
        let end = self.turn(&ports, speed, start, &mut trace);
        let (drawn, delivered) = (trace.last_drawn(), trace.last_delivered());
        let content = trace.content.iter().fold(Eight::splat(0.0), |sum, c| sum + *c) / Eight::splat(self.steps as f64);
        let (drawn_ripple, delivered_ripple) = (self.ripple(&trace.drawn), self.ripple(&trace.delivered));
        // A little more gas at bottom dead centre: what comes of it within a revolution.
        let nudge = start * Eight::splat(NUDGE);
        let nudged = self.turn(&ports, speed, start + nudge, &mut trace);
        let extra = nudge * self.gas_per_pa_at_bottom();
        let kept = memory(nudged - end, nudge);
        let relaxation = speed * kept.map(|k| -k.max(1e-6).ln());
        let response = |with: Eight, without: Eight| (with - without) / extra / (one - kept) * relaxation;
        let pistons = Eight::splat(machine.phases.len() as f64);
        let pick = |ripple: Vec<Eight>| ripple.into_iter().step_by(self.steps / PHASES).collect();
        Cells {
            drawn: drawn * speed * pistons,
            delivered: delivered * speed * pistons,
            content: content * pistons,
            drawn_response: response(trace.last_drawn(), drawn),
            delivered_response: response(trace.last_delivered(), delivered),
            relaxation,
            drawn_ripple: pick(drawn_ripple),
            delivered_ripple: pick(delivered_ripple),
        }
    }

    /// The pressure at bottom dead centre that is begun with, in Pa: the inlet's, from which three revolutions lead to within 1e-5
    /// of where it repeats itself. Behind a spring that is too much: a cylinder that is fuller than the one that repeats itself
    /// may not draw at all in its next revolution, and then says nothing of how fast it forgets.
    fn begun(&self, inlet: Eight) -> Eight {
        let [spring, _] = self.machine.springs;
        if spring.cracking_pa > 0.0 {
            let entering = inlet - Eight::splat(spring.cracking_pa);
            (entering * Eight::splat(EMPTIER)).at_least(inlet * Eight::splat(NUDGE))
        } else {
            inlet
        }
    }

    /// Gas in one cylinder at bottom dead centre per pressure, in kg/Pa.
    fn gas_per_pa_at_bottom(&self) -> Eight {
        Eight::splat(1.0 / self.walls.at::<1>(0)[0].pressure_per_mass)
    }

    /// Gas that all pistons together have moved beyond the mean, by the phase of the shaft, in kg.
    fn ripple(&self, moved: &[Eight]) -> Vec<Eight> {
        let n = self.steps;
        let whole = moved.last().copied().unwrap_or(Eight::splat(0.0));
        let one = |step: usize| {
            let even = whole * Eight::splat(step as f64 / n as f64);
            moved.get(step).copied().unwrap_or(whole) - even
        };
        let total = |step: usize| self.cranks(step).fold(Eight::splat(0.0), |sum, crank| sum + one(crank));
        let mut ripple: Vec<Eight> = (0..n).map(total).collect();
        let mean = ripple.iter().fold(Eight::splat(0.0), |sum, r| sum + *r) / Eight::splat(n as f64);
        ripple.iter_mut().for_each(|r| *r = *r - mean);
        ripple
    }

    /// Ripple as the pistons see it, each at its own crank angle, on average; in Pa.
    fn seen(&self, ripple: &[Eight], pa_per_kg: f64) -> Vec<Eight> {
        let n = self.steps;
        let mut seen = vec![Eight::splat(0.0); n];
        let share = Eight::splat(pa_per_kg / self.machine.phases.len() as f64);
        for (step, r) in ripple.iter().enumerate() {
            for crank in self.cranks(step) {
                if let Some(slot) = seen.get_mut(crank) {
                    *slot += *r * share;
                }
            }
        }
        seen
    }

    /// The step, counted from its own bottom dead centre, at which each piston is when the shaft is at step `shaft` of a
    /// revolution.
    #[inline(always)]
    fn cranks(&self, shaft: usize) -> impl Iterator<Item = usize> + '_ {
        let n = self.steps;
        self.offsets.iter().map(move |offset| if shaft + offset < n { shaft + offset } else { shaft + offset - n })
    }

    /// Turns the cylinder once from a pressure at bottom dead centre; the pressure after it.
    fn turn(&self, ports: &Ports, speed: Eight, pressure: Eight, trace: &mut Trace) -> Eight {
        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx2,fma")]
        fn avx2(bench: &Bench, ports: &Ports, speed: Eight, pressure: Eight, trace: &mut Trace) -> Eight {
            revolution(bench, ports, speed, pressure, trace)
        }
        match InstructionSet::detect() {
            // SAFETY: `detect` has just found these features on this CPU.
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            InstructionSet::Avx2 => unsafe { avx2(self, ports, speed, pressure, trace) },
            _ => revolution(self, ports, speed, pressure, trace),
        }
    }
}

/// Share of a deviation that is left after a revolution.
fn memory(after: Eight, before: Eight) -> Eight {
    let ratio = Eight::from_lanes(|lane| {
        let (after, before) = (after.lane(lane), before.lane(lane));
        if before.abs() > 1e-9 * (1.0 + after.abs()) { after / before } else { 0.0 }
    });
    ratio.limited(Eight::splat(0.0), Eight::splat(LONGEST_MEMORY))
}

impl Trace {
    fn new(steps: usize) -> Self {
        let zero = vec![Eight::splat(0.0); steps + 1];
        Trace { drawn: zero.clone(), delivered: zero, content: vec![Eight::splat(0.0); steps] }
    }

    fn last_drawn(&self) -> Eight {
        self.drawn.last().copied().unwrap_or(Eight::splat(0.0))
    }

    fn last_delivered(&self) -> Eight {
        self.delivered.last().copied().unwrap_or(Eight::splat(0.0))
    }
}

/// Share of laminar flow where pumps are to be smooth.
const LAMINAR: f64 = 6e-3;

/// Flow through a check valve in kg/s, given its area by √(R T). A function, for a closure would not be compiled for the
/// instruction set of the revolution around it.
///
/// With the drop `x` by the pressure before it, the flow of an orifice times `(x²/(x² + ε²))^¾`, which begins as `x²`: 1 −
/// 3(ε/2x)² of it where it matters. An orifice's root has no slope at zero; at fixed steps it chatters there, and a valve that
/// opens a step sooner or later leaves kinks of 0.01 kPa in the pump's parameters, over which fits stumble. A flow that
/// began as `x` left 1.5e-5 of it, 0.001 kPa, in waves a per cent of a parameter long: enough to bend the slopes along
/// combinations that hardly show, and to end fits tens of log-likelihood early (1e-6 with this).
#[inline(always)]
fn orifice(
    law: &FlowFunction<Eight>,
    laminar: f64,
    area_by_speed: Eight,
    up: Eight,
    down: Eight,
    spring: Spring,
) -> Eight {
    let zero = Eight::splat(0.0);
    let difference = up - down;
    let beyond = difference - Eight::splat(spring.cracking_pa);
    if beyond.any_above(zero) {
        let drop = ((difference - Eight::splat(spring.taken_pa)) / up).at_least(zero);
        let mut flow = area_by_speed * up * law.at_drop(drop);
        if spring.opening_pa > 0.0 {
            // Over no less than what else is smooth, lest a step opens or shuts it whole.
            let range = Eight::splat(laminar).mul_add(up, Eight::splat(spring.opening_pa));
            let gone = (beyond / range).limited(zero, Eight::splat(1.0));
            flow = flow * gone * gone * (Eight::splat(3.0) - gone - gone);
        }
        if laminar == 0.0 {
            return flow;
        }
        let squared = drop * drop;
        let root = (squared / (squared + Eight::splat(laminar * laminar))).sqrt();
        flow * root * root.sqrt()
    } else {
        zero
    }
}

/// RK4 over one revolution.
#[inline(always)]
fn revolution(bench: &Bench, ports: &Ports, speed: Eight, pressure: Eight, trace: &mut Trace) -> Eight {
    let machine = &bench.machine;
    let splat = Eight::splat;
    let zero = splat(0.0);
    // By √(R T) of what flows through.
    let inlet_area = splat(machine.areas[0] * machine.inlet_inverse_speed);
    let outlet_area = splat(machine.areas[1] * machine.cylinder_inverse_speed);
    let [inlet_spring, outlet_spring] = machine.springs;
    let (blowby, air2) = (splat(machine.blowby), splat(machine.atmosphere_pa * machine.atmosphere_pa));
    let time = splat(1.0) / speed;
    let step = splat(1.0 / bench.steps as f64);
    let (half, sixth, two) = (step * splat(0.5), step * splat(1.0 / 6.0), splat(2.0));
    let mut p = pressure;
    let (mut drawn, mut delivered) = (zero, zero);
    for s in 0..bench.steps {
        let next = (s + 1) % bench.steps;
        let ripple = |of: &[Eight], at: usize| of.get(at).copied().unwrap_or(zero);
        let at = |of: &[Eight], base: Eight| {
            let (a, b) = (base + ripple(of, s), base + ripple(of, next));
            [a, (a + b) * splat(0.5), b]
        };
        let inlet = at(&ports.inlet_ripple, ports.inlet);
        let outlet = at(&ports.outlet_ripple, ports.outlet);
        let mut k = [[zero; 3]; 4];
        let mut y = p;
        for (stage, slope) in k.iter_mut().enumerate() {
            let moment = stage.div_ceil(2);
            let wall = bench.walls.at::<1>(4 * s + 2 * moment)[0];
            let into = orifice(&bench.law, bench.laminar, inlet_area, inlet[moment], y, inlet_spring);
            let out = orifice(&bench.law, bench.laminar, outlet_area, y, outlet[moment], outlet_spring);
            let blown = blowby * (y * y - air2);
            let gained = (into - out - blown) * splat(wall.pressure_per_mass) * time;
            *slope = [gained - y * splat(wall.growth), into, out];
            y = slope[0].mul_add(if stage < 2 { half } else { step }, p);
        }
        let mean = |i: usize| two.mul_add(k[1][i] + k[2][i], k[0][i] + k[3][i]);
        if let (Some(slot), Some(content)) = (trace.drawn.get_mut(s), trace.content.get_mut(s)) {
            *slot = drawn;
            *content = p / splat(bench.walls.at::<1>(4 * s)[0].pressure_per_mass);
        }
        if let Some(slot) = trace.delivered.get_mut(s) {
            *slot = delivered;
        }
        drawn = (sixth * time).mul_add(mean(1), drawn);
        delivered = (sixth * time).mul_add(mean(2), delivered);
        p = sixth.mul_add(mean(0), p);
    }
    if let (Some(slot), Some(other)) = (trace.drawn.last_mut(), trace.delivered.last_mut()) {
        *slot = drawn;
        *other = delivered;
    }
    p
}

//! The balances: mass flow of every element, and what they do to every pressure and temperature.
//!
//! The only place where terms are added up. Written once over [`Real`]; whether there is anything beyond the
//! paper's balances (temperatures, springs, muscles, tables) is a constant of the instantiation, so a rig without it
//! pays nothing.

use super::elements::{Parabolic, ShapedVent};
use super::residual::Target;
use super::walls::Wall;
use super::{MEMORY, MOST_DRIVES, MOST_RESIDUALS, Plant, Scratch};
use crate::mechanism::Stick;
use crate::orifice::FlowFunction;
use crate::real::Real;

/// Factors of temperature in flows, by node; thermal chambers' entries are refreshed at each evaluation.
pub(crate) struct Gas<R, const NODES: usize> {
    /// Temperature in K.
    pub(crate) temperature: [R; NODES],
    /// 1/√(R T) in s/m.
    pub(crate) inverse_speed: [R; NODES],
}

/// Mass and enthalpy on their way into each node.
struct Balance<R, const NODES: usize> {
    /// Σṁ in kg/s.
    mass: [R; NODES],
    /// Σ ṁ T in kg K/s: inflow at its own temperature, outflow at the node's.
    heat: [R; NODES],
}

impl<R: Real, const NODES: usize> Balance<R, NODES> {
    /// Moves `flow` (kg/s, at least zero) from `up` to `down`.
    #[inline(always)]
    fn pass<const EXTENDED: bool>(&mut self, up: usize, down: usize, flow: R, temperature: &[R; NODES]) {
        let (up, down) = (up % NODES, down % NODES);
        self.mass[up] = self.mass[up] - flow;
        self.mass[down] += flow;
        if EXTENDED {
            let heat = flow * temperature[up];
            self.heat[up] = self.heat[up] - heat;
            self.heat[down] += heat;
        }
    }

    /// Feeds `flow` (kg/s, either sign) of gas at `inlet` K into `node`.
    #[inline(always)]
    fn feed<const EXTENDED: bool>(&mut self, node: usize, flow: R, inlet: R, temperature: &[R; NODES]) {
        let zero = R::splat(0.0);
        let node = node % NODES;
        self.mass[node] += flow;
        if EXTENDED {
            // Drawn out, the gas leaves with the node's own temperature.
            self.heat[node] += flow.at_least(zero) * inlet - (-flow).at_least(zero) * temperature[node];
        }
    }
}

/// Steps at most for a valve with something in series: a line as wide as the valve takes four, one fifty times narrower
/// eighteen.
const SERIES_STEPS: usize = 40;
/// Chords among them before every other step halves the bracket instead: a valve that its spring keeps shut up to some
/// difference has a kink that chords are slow at.
const SERIES_CHORDS: usize = 10;
/// Share of the squared flow at which they stop.
const SERIES_TOLERANCE: f64 = 1e-10;

/// Areas that forces on a flapper open.
#[derive(Clone, Copy)]
struct Lifted<R> {
    /// By duty, spring and a table, in m².
    by: R,
    /// By the pressure difference, in m²/Pa, and by its square, in m²/Pa².
    pushed: [R; 2],
}

impl<R: Real> ShapedVent<R> {
    /// A P Φ through the valve in N: mass flow times √(R T). `held` is what friction holds the flapper at, in duty.
    #[inline(always)]
    pub(crate) fn flow(&self, law: &FlowFunction<R>, duty: R, held: Option<R>, extra_area: R, [up, down]: [R; 2]) -> R {
        let pulled = held.unwrap_or(duty);
        let pushed = if held.is_some() { [R::splat(0.0); 2] } else { [self.pressure_area, self.pressure_curvature] };
        let lifted = Lifted { by: self.input_area.mul_add(pulled, extra_area) - self.spring_area, pushed };
        if self.restricted { self.in_series(law, lifted, up, down) } else { self.through(law, lifted, up, down) }
    }

    /// Valve with its ports exchanged, for gas that passes the other way: what pushed the flapper open now pushes it shut.
    #[inline(always)]
    fn mirrored(&self) -> Self {
        ShapedVent {
            pressure_area: -self.pressure_area,
            upstream_drop: self.downstream_drop,
            downstream_drop: self.upstream_drop,
            ..*self
        }
    }

    /// Where friction holds the flapper (in duty) once a duty and pressures act that may break it loose; `swing` is how far
    /// the pumps take the difference of the pressures (in Pa) below and above these within a revolution.
    pub(crate) fn held_at(&self, held: R, duty: R, [up, down]: [R; 2], swing: [R; 2]) -> R {
        let difference = up - down;
        let slope = ((self.pressure_curvature + self.pressure_curvature).mul_add(difference, self.pressure_area))
            / self.input_area;
        let balance = self.balance(duty, up, down);
        let ends = swing.map(|pa| slope.mul_add(pa, balance));
        Stick { band: self.band, short: self.short }.moved_within(held, balance, ends)
    }

    /// All forces on the flapper but the spring's, in duty.
    #[inline(always)]
    pub(crate) fn balance(&self, duty: R, up: R, down: R) -> R {
        let difference = up - down;
        let pushed = self.pressure_curvature.mul_add(difference, self.pressure_area) * difference;
        duty + pushed / self.input_area
    }

    /// A P Φ of the valve alone.
    // A method, as is all that it takes below: closures would not be compiled for the instruction set of the tick.
    #[inline(always)]
    fn through(&self, law: &FlowFunction<R>, lifted: Lifted<R>, up: R, down: R) -> R {
        let difference = up - down;
        let [linear, curvature] = lifted.pushed;
        let lift = curvature.mul_add(difference, linear).mul_add(difference, lifted.by);
        let area = lift.at_least(R::splat(0.0));
        let full = area * self.inverse_full_area;
        let full2 = full * full;
        let limited = area / full2.mul_add(full2, R::splat(1.0)).sqrt().sqrt();
        limited * up * law.at_drop(difference / up)
    }

    /// By how much `y` exceeds the square of the flow that it leaves the valve.
    #[inline(always)]
    fn excess(&self, law: &FlowFunction<R>, lifted: Lifted<R>, up2: R, down2: R, y: R) -> R {
        let before = (up2 - self.upstream_drop * y).at_least(R::splat(0.0)).sqrt();
        let after = self.downstream_drop.mul_add(y, down2).sqrt();
        let flow = self.through(law, lifted, before, after);
        y - flow * flow
    }

    /// Solves for the flow through what is upstream, the valve, and what is downstream.
    ///
    /// With `y = (ṁ √(R T))²` the pressures at the valve are `P_up² − y/A²` and `P_down² + y/A²`, and `y` is where the
    /// square of the valve's own flow meets it. The difference `y − (valve)²` rises from below zero to above it between
    /// no flow and the flow that leaves the valve nothing. It is nearly straight, except where a narrow line meets a
    /// valve that opens with its pressure difference (then it goes with the third power of what is left); so chords
    /// keep the root bracketed, with the end that stays behind weighted down (Anderson and Björck, *BIT* 13, 1973). It
    /// is found to 1e-10 for lines of 1/5000 of the valve's area and wider.
    #[inline(always)]
    fn in_series(&self, law: &FlowFunction<R>, lifted: Lifted<R>, up: R, down: R) -> R {
        let (zero, one) = (R::splat(0.0), R::splat(1.0));
        let (up2, down2) = (up * up, down * down);
        // The flow that would leave the valve no difference.
        let most = ((up2 - down2) / (self.upstream_drop + self.downstream_drop)).at_least(zero);
        let (mut low, mut high) = (zero, most);
        let (mut below, mut above) = (self.excess(law, lifted, up2, down2, zero), most);
        // The first chord: the answer for a constant area and incompressible flow.
        let mut y = chord([low, high], [below, above], most);
        let mut open = one;
        let mut last = zero;
        for step in 0..SERIES_STEPS {
            let g = self.excess(law, lifted, up2, down2, y);
            // A lane that has arrived stays where it is, so that it has the bits it would have alone.
            open = open * R::from_lanes(|l| f64::from(g.lane(l).abs() > SERIES_TOLERANCE * y.lane(l)));
            if !open.any_above(zero) {
                break;
            }
            let side = g.map(|g| if g > 0.0 { 1.0 } else { -1.0 });
            let (is_above, is_below) = ((one + side) * R::splat(0.5), (one - side) * R::splat(0.5));
            // Twice on one side: the other end counts for less.
            let weight = R::from_lanes(|l| {
                let before = if side.lane(l) > 0.0 { above.lane(l) } else { below.lane(l) };
                let left = 1.0 - g.lane(l) / before;
                let weight = if left > 0.0 { left } else { 0.5 };
                if side.lane(l) == last.lane(l) { weight } else { 1.0 }
            });
            below = is_below * g + is_above * below * weight;
            above = is_above * g + is_below * above * weight;
            low = is_below * y + is_above * low;
            high = is_above * y + is_below * high;
            last = side;
            let next = if step < SERIES_CHORDS || step % 2 == 1 {
                chord([low, high], [below, above], most)
            } else {
                (low + high) * R::splat(0.5)
            };
            y = R::from_lanes(|l| if open.lane(l) > 0.0 { next.lane(l) } else { y.lane(l) });
        }
        y.sqrt()
    }
}

/// Where the line through a bracket's ends crosses zero, within 0 … `most`.
#[inline(always)]
fn chord<R: Real>([low, high]: [R; 2], [below, above]: [R; 2], most: R) -> R {
    let y = low + below * (high - low) / (below - above - R::splat(1e-300));
    y.limited(R::splat(0.0), most)
}

impl<R: Real> Parabolic<R> {
    /// The flow from a place of pressure `up` to one of pressure `down` in kg/s; zero against the pressure.
    #[inline(always)]
    fn flow(&self, up: R, down: R) -> R {
        let drive = ((up - down) * (up + down)).at_least(R::splat(0.0));
        let root = (self.linear * self.linear + R::splat(4.0) * self.quadratic * drive).sqrt();
        (drive + drive) / (self.linear + root)
    }
}

/// Time derivatives of the states at instant `k` of the tick.
///
/// `x` holds pressures in Pa by node (chambers, cylinders, given places); the states among them are the first
/// `STATES`, and temperatures in K of thermal chambers are the last of those.
#[inline(always)]
pub(crate) fn rates<R: Real, const STATES: usize, const NODES: usize, const EXTENDED: bool>(
    plant: &Plant<R>,
    scratch: &Scratch<R>,
    memory: &[R; MEMORY],
    gas: &mut Gas<R, NODES>,
    x: &[R; NODES],
    k: usize,
) -> [R; STATES] {
    let zero = R::splat(0.0);
    if EXTENDED {
        for chamber in &plant.thermal {
            let (node, temperature) = (chamber.node % NODES, x[chamber.temperature % NODES]);
            gas.temperature[node] = temperature;
            gas.inverse_speed[node] = R::splat(1.0) / (plant.gas_constant * temperature).sqrt();
        }
    }
    let Gas { temperature, inverse_speed } = &*gas;
    let mut balance = Balance { mass: [zero; NODES], heat: [zero; NODES] };

    let mut areas = [zero; MOST_RESIDUALS];
    let mut contents = [zero; MOST_DRIVES];
    if EXTENDED {
        for (residual, area) in plant.residuals.iter().zip(&mut areas) {
            let value = residual.at(scratch, memory, plant.atmosphere_pa, x, k);
            match residual.target {
                Target::Area => *area = value,
                Target::Node(node) => balance.feed::<EXTENDED>(node, value, residual.temperature, temperature),
            }
        }
        for check in &plant.spring_checks {
            let (up, down) = (x[check.up % NODES], x[check.down % NODES]);
            let beyond = up - down - check.cracking;
            if beyond.any_above(zero) {
                let gone = (beyond * check.inverse_opening).limited(zero, R::splat(1.0));
                let open = gone * gone * (R::splat(3.0) - gone - gone);
                let phi = plant.law(check.law).at_drop(((up - down - check.taken) / up).at_least(zero));
                let flow = check.area * open * inverse_speed[check.up % NODES] * up * phi;
                balance.pass::<EXTENDED>(check.up, check.down, flow, temperature);
            }
        }
        for vent in &plant.shaped_vents {
            let (up, down) = (x[vent.up % NODES], x[vent.down % NODES]);
            let extra = vent.residual.map_or(zero, |index| areas[index % MOST_RESIDUALS]);
            let held = vent.held.map(|slot| memory[slot % MEMORY]);
            let duty = scratch.duty(vent.command, k);
            let through = vent.flow(plant.law(vent.law), duty, held, extra, [up, down]);
            balance.pass::<EXTENDED>(vent.up, vent.down, through * inverse_speed[vent.up % NODES], temperature);
            if (down - up).any_above(zero) {
                let through = vent.mirrored().flow(plant.law(vent.law), duty, held, extra, [down, up]);
                balance.pass::<EXTENDED>(vent.down, vent.up, through * inverse_speed[vent.down % NODES], temperature);
            }
        }
        for (pump, content) in plant.averaged.iter().zip(&mut contents) {
            let (inlet, outlet) = (pump.inlet % NODES, pump.outlet % NODES);
            let running = scratch.running(pump.drive);
            let (held, warmth) = (x[pump.content % NODES], scratch.warmth(pump.drive));
            let [drawn, delivered, gained] = pump.flows(x[inlet], x[outlet], held, running, warmth);
            *content = gained;
            balance.feed::<EXTENDED>(inlet, -drawn, pump.temperature, temperature);
            balance.feed::<EXTENDED>(outlet, delivered, pump.temperature, temperature);
        }
        for line in &plant.parabolics {
            let (one, other) = (x[line.up % NODES], x[line.down % NODES]);
            let (there, back) = (line.flow(one, other), line.flow(other, one));
            balance.pass::<EXTENDED>(line.up, line.down, there, temperature);
            balance.pass::<EXTENDED>(line.down, line.up, back, temperature);
        }
    }
    for passage in &plant.passages {
        let (up, down) = (x[passage.up % NODES], x[passage.down % NODES]);
        let difference = up - down;
        // Check valves are shut most of the time, in all lanes at once.
        if difference.any_above(zero) {
            let phi = plant.law(passage.law).at_drop(difference / up);
            let flow = passage.area * inverse_speed[passage.up % NODES] * up * phi;
            balance.pass::<EXTENDED>(passage.up, passage.down, flow, temperature);
        }
    }
    for vent in &plant.vents {
        let (up, down) = (x[vent.up % NODES], x[vent.down % NODES]);
        let difference = up - down;
        let duty = scratch.duty(vent.command, k);
        let lift = vent.input_area.mul_add(duty, vent.pressure_area * difference) - vent.spring_area;
        let area = lift.at_least(zero);
        let phi = plant.law(vent.law).at_drop(difference / up);
        let flow = area * inverse_speed[vent.up % NODES] * up * phi;
        balance.pass::<EXTENDED>(vent.up, vent.down, flow, temperature);
        // An open nozzle has no direction: a chamber that a leak takes beyond the air, pump off, is vented as well. Eq. (3) as
        // printed has no flow there, for a running pump never brings it about.
        if (-difference).any_above(zero) {
            let phi = plant.law(vent.law).at_drop(-difference / down);
            let flow = area * inverse_speed[vent.down % NODES] * down * phi;
            balance.pass::<EXTENDED>(vent.down, vent.up, flow, temperature);
        }
    }
    for capillary in &plant.capillaries {
        let (one, other) = (x[capillary.up % NODES], x[capillary.down % NODES]);
        let flow = capillary.conductance * (one - other) * (one + other);
        balance.pass::<EXTENDED>(capillary.up, capillary.down, flow.at_least(zero), temperature);
        balance.pass::<EXTENDED>(capillary.down, capillary.up, (-flow).at_least(zero), temperature);
    }
    for (i, pump) in plant.displacements.iter().enumerate() {
        // What is displaced has the temperature that the inlet has now.
        let rt = if EXTENDED { plant.gas_constant * temperature[pump.up % NODES] } else { pump.rt };
        let command = pump.path.map_or_else(|| scratch.displacement(i), |path| scratch.duty(path, k));
        let open = ((command - pump.dead_zone) * pump.inverse_range).at_least(zero);
        let load = x[pump.down % NODES] - x[pump.up % NODES];
        let left = (R::splat(1.0) - pump.droop * load).at_least(zero);
        let flow = pump.flow * open * left * x[pump.up % NODES] / rt;
        balance.pass::<EXTENDED>(pump.up, pump.down, flow, temperature);
    }
    for (i, feed) in plant.feeds.iter().enumerate() {
        let flow = feed.flow.mul_add(scratch.feed(i), feed.offset);
        balance.feed::<EXTENDED>(feed.down, flow, feed.temperature, temperature);
    }

    if EXTENDED {
        for (joined, rate) in plant.joined.iter().zip(&scratch.joining) {
            balance.feed::<EXTENDED>(joined.node, joined.brings * *rate, joined.temperature, temperature);
        }
    }

    // Rigid isothermal chambers and cylinders are one formula; the others are overwritten below.
    let walls: &[Wall<R>; STATES] = scratch.walls(k);
    let mut dx = [zero; STATES];
    for i in 0..STATES {
        dx[i] = walls[i].pressure_per_mass * balance.mass[i] - walls[i].growth * x[i];
    }
    if EXTENDED {
        for (pump, gained) in plant.averaged.iter().zip(&contents) {
            dx[pump.content % STATES] = *gained;
        }
    }
    let mut displaced = [zero; NODES];
    let mut swept = [zero; NODES];
    if EXTENDED {
        for muscle in &plant.muscles {
            let (gains, loses) = (muscle.gains % NODES, muscle.loses % NODES);
            let contraction = x[muscle.contraction % NODES];
            let speed = (muscle.at_rest(x[gains], x[loses]) - contraction) * muscle.inverse_time;
            dx[muscle.contraction % STATES] = speed;
            let (volume, rate) = (muscle.area * contraction, muscle.area * speed);
            displaced[gains] += volume;
            swept[gains] += rate;
            displaced[loses] = displaced[loses] - volume;
            swept[loses] = swept[loses] - rate;
        }
    }
    if EXTENDED {
        for (joined, rate) in plant.joined.iter().zip(&scratch.joining) {
            let node = joined.node % NODES;
            dx[joined.volume % STATES] = *rate;
            displaced[node] += x[joined.volume % NODES];
            swept[node] += *rate;
        }
    }
    for chamber in &plant.compliant {
        let node = chamber.node % NODES;
        let p = x[node];
        let mut volume = chamber.compliance.mul_add(p, chamber.volume_at_vacuum);
        let mut gained = balance.mass[node] * chamber.rt;
        if EXTENDED {
            volume += displaced[node];
            gained = gained - p * swept[node];
        }
        let stiffness = chamber.compliance.mul_add(p, volume);
        dx[chamber.node % STATES] = gained / stiffness;
    }
    if EXTENDED {
        let kappa = plant.heat_capacity_ratio;
        for chamber in &plant.thermal {
            let node = chamber.node % NODES;
            let (p, t) = (x[node], temperature[node]);
            let volume = chamber.compliance.mul_add(p, chamber.volume_at_vacuum) + displaced[node];
            let stiffness = (kappa * chamber.compliance).mul_add(p, volume);
            let cooling = chamber.wall_conductance * (t - chamber.wall_temperature);
            let heating = kappa * plant.gas_constant * balance.heat[node] - (kappa - R::splat(1.0)) * cooling;
            let dp = (heating - kappa * p * swept[node]) / stiffness;
            let growth = (chamber.compliance * dp + swept[node]) / volume;
            let relative = dp / p + growth - balance.mass[node] * plant.gas_constant * t / (p * volume);
            dx[chamber.node % STATES] = dp;
            dx[chamber.temperature % STATES] = t * relative;
        }
    }
    dx
}

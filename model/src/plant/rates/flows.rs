//! Flow of every element, into the balance of the nodes it joins.

use super::Instant;
use super::balance::Balance;
use crate::plant::elements::Parabolic;
use crate::plant::residual::Target;
use crate::plant::{MEMORY, MOST_DRIVES, MOST_RESIDUALS};
use crate::real::Real;

impl<R: Real, const NODES: usize> Instant<'_, R, NODES> {
    /// Adds what flows through elements that the paper's rig has not, and gives the gain of averaged pumps' contents, by pump.
    #[inline(always)]
    pub(super) fn beyond_the_paper(&self, balance: &mut Balance<R, NODES>) -> [R; MOST_DRIVES] {
        let areas = self.residuals(balance);
        self.spring_checks(balance);
        self.shaped_vents(balance, &areas);
        let gained = self.averaged_pumps(balance);
        self.parabolics(balance);
        gained
    }

    /// Adds what flows through the elements of the paper's rig, and through those of other rigs that need nothing more.
    #[inline(always)]
    pub(super) fn paper<const EXTENDED: bool>(&self, balance: &mut Balance<R, NODES>) {
        self.passages::<EXTENDED>(balance);
        self.vents::<EXTENDED>(balance);
        self.capillaries::<EXTENDED>(balance);
        self.displacements::<EXTENDED>(balance);
        self.feeds::<EXTENDED>(balance);
    }

    /// Adds the gas that comes with volumes that are joined.
    #[inline(always)]
    pub(super) fn joined(&self, balance: &mut Balance<R, NODES>) {
        for (joined, rate) in self.plant.joined.iter().zip(&self.scratch.joining) {
            balance.feed::<true>(joined.node, joined.brings * *rate, joined.temperature, &self.gas.temperature);
        }
    }

    /// Feeds in tabled flows, and gives tabled areas of valves in m².
    #[inline(always)]
    fn residuals(&self, balance: &mut Balance<R, NODES>) -> [R; MOST_RESIDUALS] {
        let mut areas = [R::splat(0.0); MOST_RESIDUALS];
        for (residual, area) in self.plant.residuals.iter().zip(&mut areas) {
            let value = residual.at(self.scratch, self.memory, self.plant.atmosphere_pa, self.x, self.k);
            match residual.target {
                Target::Area => *area = value,
                Target::Node(node) => {
                    balance.feed::<true>(node, value, residual.temperature, &self.gas.temperature);
                }
            }
        }
        areas
    }

    #[inline(always)]
    fn spring_checks(&self, balance: &mut Balance<R, NODES>) {
        let (zero, x) = (R::splat(0.0), self.x);
        for check in &self.plant.spring_checks {
            let (up, down) = (x[check.up % NODES], x[check.down % NODES]);
            let beyond = up - down - check.cracking;
            if beyond.any_above(zero) {
                let gone = (beyond * check.inverse_opening).limited(zero, R::splat(1.0));
                let open = gone * gone * (R::splat(3.0) - gone - gone);
                let phi = self.plant.law(check.law).at_drop(((up - down - check.taken) / up).at_least(zero));
                let flow = check.area * open * self.gas.inverse_speed[check.up % NODES] * up * phi;
                balance.pass::<true>(check.up, check.down, flow, &self.gas.temperature);
            }
        }
    }

    #[inline(always)]
    fn shaped_vents(&self, balance: &mut Balance<R, NODES>, areas: &[R; MOST_RESIDUALS]) {
        let (zero, x) = (R::splat(0.0), self.x);
        let (temperature, inverse_speed) = (&self.gas.temperature, &self.gas.inverse_speed);
        for vent in &self.plant.shaped_vents {
            let (up, down) = (x[vent.up % NODES], x[vent.down % NODES]);
            let law = self.plant.law(vent.law);
            let extra = vent.residual.map_or(zero, |index| areas[index % MOST_RESIDUALS]);
            let held = vent.held.map(|slot| self.memory[slot % MEMORY]);
            let duty = self.scratch.duty(vent.command, self.k);
            let through = vent.flow(law, duty, held, extra, [up, down]);
            balance.pass::<true>(vent.up, vent.down, through * inverse_speed[vent.up % NODES], temperature);
            if (down - up).any_above(zero) {
                let through = vent.mirrored().flow(law, duty, held, extra, [down, up]);
                balance.pass::<true>(vent.down, vent.up, through * inverse_speed[vent.down % NODES], temperature);
            }
        }
    }

    /// Adds the flows of pumps that are averaged over a revolution, and gives what their contents gain, by pump.
    #[inline(always)]
    fn averaged_pumps(&self, balance: &mut Balance<R, NODES>) -> [R; MOST_DRIVES] {
        let (x, temperature) = (self.x, &self.gas.temperature);
        let mut contents = [R::splat(0.0); MOST_DRIVES];
        for (pump, content) in self.plant.averaged.iter().zip(&mut contents) {
            let (inlet, outlet) = (pump.inlet % NODES, pump.outlet % NODES);
            let running = self.scratch.running(pump.drive);
            let (held, warmth) = (x[pump.content % NODES], self.scratch.warmth(pump.drive));
            let [drawn, delivered, gained] = pump.flows(x[inlet], x[outlet], held, running, warmth);
            *content = gained;
            balance.feed::<true>(inlet, -drawn, pump.temperature, temperature);
            balance.feed::<true>(outlet, delivered, pump.temperature, temperature);
        }
        contents
    }

    #[inline(always)]
    fn parabolics(&self, balance: &mut Balance<R, NODES>) {
        for line in &self.plant.parabolics {
            let (one, other) = (self.x[line.up % NODES], self.x[line.down % NODES]);
            let (there, back) = (line.flow(one, other), line.flow(other, one));
            balance.pass::<true>(line.up, line.down, there, &self.gas.temperature);
            balance.pass::<true>(line.down, line.up, back, &self.gas.temperature);
        }
    }

    #[inline(always)]
    fn passages<const EXTENDED: bool>(&self, balance: &mut Balance<R, NODES>) {
        for passage in &self.plant.passages {
            let (up, down) = (self.x[passage.up % NODES], self.x[passage.down % NODES]);
            let difference = up - down;
            // Check valves are shut most of the time, in all lanes at once.
            if difference.any_above(R::splat(0.0)) {
                let phi = self.plant.law(passage.law).at_drop(difference / up);
                let flow = passage.area * self.gas.inverse_speed[passage.up % NODES] * up * phi;
                balance.pass::<EXTENDED>(passage.up, passage.down, flow, &self.gas.temperature);
            }
        }
    }

    #[inline(always)]
    fn vents<const EXTENDED: bool>(&self, balance: &mut Balance<R, NODES>) {
        let zero = R::splat(0.0);
        let (temperature, inverse_speed) = (&self.gas.temperature, &self.gas.inverse_speed);
        for vent in &self.plant.vents {
            let (up, down) = (self.x[vent.up % NODES], self.x[vent.down % NODES]);
            let difference = up - down;
            let duty = self.scratch.duty(vent.command, self.k);
            let lift = vent.input_area.mul_add(duty, vent.pressure_area * difference) - vent.spring_area;
            let area = lift.at_least(zero);
            let phi = self.plant.law(vent.law).at_drop(difference / up);
            let flow = area * inverse_speed[vent.up % NODES] * up * phi;
            balance.pass::<EXTENDED>(vent.up, vent.down, flow, temperature);
            // An open nozzle has no direction: a chamber that a leak takes beyond the air, pump off, is vented as well. Eq. (3)
            // as printed has no flow there, for a running pump never brings it about.
            if (-difference).any_above(zero) {
                let phi = self.plant.law(vent.law).at_drop(-difference / down);
                let flow = area * inverse_speed[vent.down % NODES] * down * phi;
                balance.pass::<EXTENDED>(vent.down, vent.up, flow, temperature);
            }
        }
    }

    #[inline(always)]
    fn capillaries<const EXTENDED: bool>(&self, balance: &mut Balance<R, NODES>) {
        let zero = R::splat(0.0);
        for capillary in &self.plant.capillaries {
            let (one, other) = (self.x[capillary.up % NODES], self.x[capillary.down % NODES]);
            let flow = capillary.conductance * (one - other) * (one + other);
            balance.pass::<EXTENDED>(capillary.up, capillary.down, flow.at_least(zero), &self.gas.temperature);
            balance.pass::<EXTENDED>(capillary.down, capillary.up, (-flow).at_least(zero), &self.gas.temperature);
        }
    }

    #[inline(always)]
    fn displacements<const EXTENDED: bool>(&self, balance: &mut Balance<R, NODES>) {
        let (zero, x, temperature) = (R::splat(0.0), self.x, &self.gas.temperature);
        for (i, pump) in self.plant.displacements.iter().enumerate() {
            // What is displaced has the temperature that the inlet has now.
            let rt = if EXTENDED { self.plant.gas_constant * temperature[pump.up % NODES] } else { pump.rt };
            let command =
                pump.path.map_or_else(|| self.scratch.displacement(i), |path| self.scratch.duty(path, self.k));
            let open = ((command - pump.dead_zone) * pump.inverse_range).at_least(zero);
            let load = x[pump.down % NODES] - x[pump.up % NODES];
            let left = (R::splat(1.0) - pump.droop * load).at_least(zero);
            let flow = pump.flow * open * left * x[pump.up % NODES] / rt;
            balance.pass::<EXTENDED>(pump.up, pump.down, flow, temperature);
        }
    }

    #[inline(always)]
    fn feeds<const EXTENDED: bool>(&self, balance: &mut Balance<R, NODES>) {
        for (i, feed) in self.plant.feeds.iter().enumerate() {
            let flow = feed.flow.mul_add(self.scratch.feed(i), feed.offset);
            balance.feed::<EXTENDED>(feed.down, flow, feed.temperature, &self.gas.temperature);
        }
    }
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

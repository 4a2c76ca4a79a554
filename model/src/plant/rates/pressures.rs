//! Derivatives of pressures, temperatures and volumes, from the sums of what flows.

use super::Instant;
use super::balance::Balance;
use crate::plant::MOST_DRIVES;
use crate::plant::walls::Wall;
use crate::real::Real;

/// Volumes that grow and shrink into each node.
struct Displaced<R, const NODES: usize> {
    /// Volume in m³.
    volume: [R; NODES],
    /// V̇ in m³/s.
    rate: [R; NODES],
}

impl<R: Real, const NODES: usize> Instant<'_, R, NODES> {
    /// Derivatives of all states; `gained` is what the contents of averaged pumps gain, by pump.
    #[inline(always)]
    pub(super) fn derivatives<const STATES: usize, const EXTENDED: bool>(
        &self,
        balance: &Balance<R, NODES>,
        gained: &[R; MOST_DRIVES],
    ) -> [R; STATES] {
        // Rigid isothermal chambers and cylinders are one formula; the others are overwritten below.
        let walls: &[Wall<R>; STATES] = self.scratch.walls(self.k);
        let mut dx = [R::splat(0.0); STATES];
        for i in 0..STATES {
            dx[i] = walls[i].pressure_per_mass * balance.mass[i] - walls[i].growth * self.x[i];
        }
        let mut displaced = Displaced { volume: [R::splat(0.0); NODES], rate: [R::splat(0.0); NODES] };
        if EXTENDED {
            for (pump, gained) in self.plant.averaged.iter().zip(gained) {
                dx[pump.content % STATES] = *gained;
            }
            self.muscles(&mut displaced, &mut dx);
            self.joining(&mut displaced, &mut dx);
        }
        self.compliant::<STATES, EXTENDED>(balance, &displaced, &mut dx);
        if EXTENDED {
            self.thermal(balance, &displaced, &mut dx);
        }
        dx
    }

    #[inline(always)]
    fn muscles<const STATES: usize>(&self, displaced: &mut Displaced<R, NODES>, dx: &mut [R; STATES]) {
        let x = self.x;
        for muscle in &self.plant.muscles {
            let (gains, loses) = (muscle.gains % NODES, muscle.loses % NODES);
            let contraction = x[muscle.contraction % NODES];
            let speed = (muscle.at_rest(x[gains], x[loses]) - contraction) * muscle.inverse_time;
            dx[muscle.contraction % STATES] = speed;
            let (volume, rate) = (muscle.area * contraction, muscle.area * speed);
            displaced.volume[gains] += volume;
            displaced.rate[gains] += rate;
            displaced.volume[loses] = displaced.volume[loses] - volume;
            displaced.rate[loses] = displaced.rate[loses] - rate;
        }
    }

    /// Grows the volumes that are being joined.
    #[inline(always)]
    fn joining<const STATES: usize>(&self, displaced: &mut Displaced<R, NODES>, dx: &mut [R; STATES]) {
        for (joined, rate) in self.plant.joined.iter().zip(&self.scratch.joining) {
            let node = joined.node % NODES;
            dx[joined.volume % STATES] = *rate;
            displaced.volume[node] += self.x[joined.volume % NODES];
            displaced.rate[node] += *rate;
        }
    }

    #[inline(always)]
    fn compliant<const STATES: usize, const EXTENDED: bool>(
        &self,
        balance: &Balance<R, NODES>,
        displaced: &Displaced<R, NODES>,
        dx: &mut [R; STATES],
    ) {
        for chamber in &self.plant.compliant {
            let node = chamber.node % NODES;
            let p = self.x[node];
            let mut volume = chamber.compliance.mul_add(p, chamber.volume_at_vacuum);
            let mut gained = balance.mass[node] * chamber.rt;
            if EXTENDED {
                volume += displaced.volume[node];
                gained = gained - p * displaced.rate[node];
            }
            let stiffness = chamber.compliance.mul_add(p, volume);
            dx[chamber.node % STATES] = gained / stiffness;
        }
    }

    #[inline(always)]
    fn thermal<const STATES: usize>(
        &self,
        balance: &Balance<R, NODES>,
        displaced: &Displaced<R, NODES>,
        dx: &mut [R; STATES],
    ) {
        let (kappa, gas_constant) = (self.plant.heat_capacity_ratio, self.plant.gas_constant);
        for chamber in &self.plant.thermal {
            let node = chamber.node % NODES;
            let (p, t, swept) = (self.x[node], self.gas.temperature[node], displaced.rate[node]);
            let volume = chamber.compliance.mul_add(p, chamber.volume_at_vacuum) + displaced.volume[node];
            let stiffness = (kappa * chamber.compliance).mul_add(p, volume);
            let cooling = chamber.wall_conductance * (t - chamber.wall_temperature);
            let heating = kappa * gas_constant * balance.heat[node] - (kappa - R::splat(1.0)) * cooling;
            let dp = (heating - kappa * p * swept) / stiffness;
            let growth = (chamber.compliance * dp + swept) / volume;
            let relative = dp / p + growth - balance.mass[node] * gas_constant * t / (p * volume);
            dx[chamber.node % STATES] = dp;
            dx[chamber.temperature % STATES] = t * relative;
        }
    }
}

//! Sums of what flows into and out of every node.

use crate::real::Real;

/// Mass and enthalpy on their way into each node.
pub(super) struct Balance<R, const NODES: usize> {
    /// Σṁ in kg/s.
    pub(super) mass: [R; NODES],
    /// Σ ṁ T in kg K/s: inflow at its own temperature, outflow at the node's.
    pub(super) heat: [R; NODES],
}

impl<R: Real, const NODES: usize> Balance<R, NODES> {
    /// Sums before anything flows.
    #[inline(always)]
    pub(super) fn at_rest() -> Self {
        Balance { mass: [R::splat(0.0); NODES], heat: [R::splat(0.0); NODES] }
    }

    /// Moves `flow` (kg/s, at least zero) from `up` to `down`.
    #[inline(always)]
    pub(super) fn pass<const EXTENDED: bool>(&mut self, up: usize, down: usize, flow: R, temperature: &[R; NODES]) {
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
    pub(super) fn feed<const EXTENDED: bool>(&mut self, node: usize, flow: R, inlet: R, temperature: &[R; NODES]) {
        let zero = R::splat(0.0);
        let node = node % NODES;
        self.mass[node] += flow;
        if EXTENDED {
            // Drawn out, the gas leaves with the node's own temperature.
            self.heat[node] += flow.at_least(zero) * inlet - (-flow).at_least(zero) * temperature[node];
        }
    }
}

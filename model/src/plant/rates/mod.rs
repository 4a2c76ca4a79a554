//! The balances: mass flow of every element, and what they do to every pressure and temperature.
//!
//! The only place where terms are added up. Written once over [`Real`]; whether there is anything beyond the
//! paper's balances (temperatures, springs, muscles, tables) is a constant of the instantiation, so a rig without it
//! pays nothing.
//!
//! | module | what |
//! | --- | --- |
//! | `balance` | sums over what flows into and out of every node |
//! | `flows` | flow of every element |
//! | `shaped_vent` | flow through a valve with more to it than a line in duty |
//! | `pressures` | what the sums do to pressures, temperatures and volumes |

mod balance;
mod flows;
mod pressures;
mod shaped_vent;

use self::balance::Balance;
use super::{MEMORY, MOST_DRIVES, Plant, Scratch};
use crate::real::Real;

/// Factors of temperature in flows, by node; thermal chambers' entries are refreshed at each evaluation.
pub(crate) struct Gas<R, const NODES: usize> {
    /// Temperature in K.
    pub(crate) temperature: [R; NODES],
    /// 1/√(R T) in s/m.
    pub(crate) inverse_speed: [R; NODES],
}

impl<R: Real, const NODES: usize> Gas<R, NODES> {
    /// Takes the temperatures of thermal chambers from the states `x`.
    #[inline(always)]
    fn refresh(&mut self, plant: &Plant<R>, x: &[R; NODES]) {
        for chamber in &plant.thermal {
            let (node, temperature) = (chamber.node % NODES, x[chamber.temperature % NODES]);
            self.temperature[node] = temperature;
            self.inverse_speed[node] = R::splat(1.0) / (plant.gas_constant * temperature).sqrt();
        }
    }
}

/// Plant at one instant of a tick.
struct Instant<'a, R, const NODES: usize> {
    plant: &'a Plant<R>,
    scratch: &'a Scratch<R>,
    memory: &'a [R; MEMORY],
    gas: &'a Gas<R, NODES>,
    /// Pressures in Pa by node, temperatures in K of thermal chambers behind them.
    x: &'a [R; NODES],
    /// Number of the instant within the tick.
    k: usize,
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
    if EXTENDED {
        gas.refresh(plant, x);
    }
    let here = Instant { plant, scratch, memory, gas, x, k };
    let mut balance = Balance::at_rest();
    // A sum is the same to the bit in this order alone.
    let gained = if EXTENDED { here.beyond_the_paper(&mut balance) } else { [R::splat(0.0); MOST_DRIVES] };
    here.paper::<EXTENDED>(&mut balance);
    if EXTENDED {
        here.joined(&mut balance);
    }
    here.derivatives::<STATES, EXTENDED>(&balance, &gained)
}

//! Rigs with their piston pumps averaged over a revolution: for fits, thousands of times as many simulations.
//!
//! In a detailed plant nearly all time goes into cylinders and check valves at 0.1 ms. What chambers feel of them in
//! the long run is a mean flow over the pressures at the ports, with a short memory: the gas that is in the cylinders.
//! With `M` the gas in all cylinders and `M̄`, `ṁ̄` what it and the flow settle to at given port pressures,
//!
//! ```text
//! ṁ_in  = ṁ̄_in(P) + a(P) (M − M̄(P))          a < 0: fuller cylinders draw less
//! ṁ_out = ṁ̄_out(P) + b(P) (M − M̄(P))
//! Ṁ     = ṁ_in − ṁ_out                         which conserves mass, and b − a = 1/τ
//! ```
//!
//! with `τ` some 15 ms on the paper's rig. All of it comes from the cylinder's own equations, turned at standing port
//! pressures until it repeats itself ([`cycle`]), the ports breathing as they do in chambers of the rig's size; so
//! springs, rings, lines, droop and speed are in it. Everything else of the rig (valves, chambers, lines, sensors, and
//! all their mechanisms) is the same code as in the detailed plant, at steps of milliseconds.
//!
//! A sensor that is read once a tick sees the pump's ripple: at 3000 rev/min always at the same crank angle, as a
//! constant that depends on the pressures; at other speeds it beats. The table holds the ripple over the crank's phase;
//! states are means, readings have it on top.
//!
//! What is lost, measured against the detailed plant over free runs of 40 s: 0.01 … 0.02 kPa rms on the built-in rigs
//! and with most mechanisms, 0.03 with other chambers or another number of pistons, 0.04 with uneven ones. A stroke that
//! moves a chamber by tens of percent is no small ripple: filling from rest is off by up to 1 kPa in the first half
//! second and by 0.6 kPa after it. A pump that stands is one volume of gas here and several cylinders at their own
//! pressures and angles in truth: after it is switched off chambers are up to 4 kPa off until they come to rest, and 0.2
//! kPa from 0.4 s after it is switched on again. So it is for searching, on stretches where the pump runs; what it finds
//! is to be refined on the detailed plant. A rig without piston pumps is the detailed plant itself.
//!
//! [`cycle`]: self

mod cycle;
mod grid;
mod pump_geometry;
mod table;

pub(crate) use pump_geometry::{PumpGeometry, Spring};
pub(crate) use table::PumpTable;

use std::sync::{Arc, Mutex, PoisonError};

/// Tables of pumps worked out so far, to be shared by all simulations of a fit and by its threads.
///
/// A table depends on the pump, on what hangs on it, and a little on the size of the chambers at its ports; while a fit
/// moves other numbers it is found here.
///
/// # Real-time
/// Making a plant works out tables and is not for the tick. Those of [`PumpTables::new`] are whole then, and a tick only reads them;
/// of [`PumpTables::smooth`] ones a run works out the parts that it comes near first, so no tick has them.
#[derive(Debug, Default)]
pub struct PumpTables {
    /// Newest last.
    known: Mutex<Vec<Known>>,
    /// True where pumps are smooth in their parameters.
    smooth: bool,
}

/// The numbers of a pump, and its table.
type Known = (Vec<u64>, Arc<PumpTable<f64>>);

/// Tables that are remembered; the oldest goes first. One takes some 60 kB, or 400 kB where absolute pressure matters.
const REMEMBERED: usize = 128;

impl PumpTables {
    /// None so far, of pumps as the detailed plant has them.
    pub const fn new() -> Self {
        PumpTables { known: Mutex::new(Vec::new()), smooth: false }
    }

    /// None so far, of pumps that are smooth in their parameters, for searches: check valves are laminar below a drop of
    /// 0.6 %, which an orifice is not. That moves a pressure by a tenth of a kPa, which a search that ends on the
    /// detailed plant takes out again and a feed-forward would not.
    pub const fn smooth() -> Self {
        PumpTables { known: Mutex::new(Vec::new()), smooth: true }
    }

    /// Number of those remembered.
    pub fn len(&self) -> usize {
        self.known.lock().unwrap_or_else(PoisonError::into_inner).len()
    }

    /// Tells whether none is remembered.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The table of a pump, worked out if it is new.
    pub(crate) fn of(&self, machine: &PumpGeometry) -> Arc<PumpTable<f64>> {
        let key = machine.key();
        let known = || self.known.lock().unwrap_or_else(PoisonError::into_inner);
        {
            let mut known = known();
            if let Some(found) = known.iter().position(|(known, _)| *known == key) {
                let entry = known.remove(found);
                let table = Arc::clone(&entry.1);
                known.push(entry);
                return table;
            }
        }
        // Two threads may work out the same one; both get the same numbers.
        let table = Arc::new(PumpTable::new(machine, self.smooth));
        let mut known = known();
        if known.len() >= REMEMBERED {
            known.remove(0);
        }
        known.push((key, Arc::clone(&table)));
        table
    }
}

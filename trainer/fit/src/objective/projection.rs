//! Projection that takes out of a residual what an unknown start could explain.
//!
//! The pressures that an arc starts from are known only as well as one reading is. Freeing them would double the
//! parameters of a fit with many windows; since their effect is linear over the noise, they are projected out instead
//! (variable projection, Golub & Pereyra 1973): with `S` the weighted effect of an arc's starts on its readings,
//!
//! ```text
//! r ← r − S (SᵀS)⁻¹ Sᵀ r
//! ```
//!
//! for residuals and for every column of the Jacobian. `S` is kept as orthonormal columns, so this is a few dots.

use crate::data::Records;
use crate::simulate::{Arc, Arcs};

/// Rows after which a chamber has forgotten its start: 5 s.
const REMEMBERED_ROWS: usize = 250;

/// Orthonormal effects of the starts of all arcs; by default of none.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Projection {
    arcs: Vec<ArcEffects>,
}

#[derive(Debug, Clone, PartialEq)]
struct ArcEffects {
    /// Places in the vector, in the order of the columns' numbers.
    places: Vec<std::ops::Range<usize>>,
    columns: Vec<Vec<f64>>,
}

impl Projection {
    /// From the effects of a shift of every channel's starts, of the recordings' layout and already weighted.
    pub(crate) fn new(records: &Records, arcs: &Arcs, effects: &[Vec<f64>]) -> Self {
        Projection { arcs: arcs.arcs().iter().map(|arc| ArcEffects::new(records, arc, effects)).collect() }
    }

    /// Takes out of `vector`, weighted readings in the recordings' layout, what the starts could explain.
    pub fn apply(&self, vector: &mut [f64]) {
        for arc in &self.arcs {
            for column in &arc.columns {
                let along: f64 = arc.zip(vector, column).map(|(v, c)| *v * c).sum();
                for (v, c) in arc.zip_mut(vector, column) {
                    *v -= along * c;
                }
            }
        }
    }
}

impl ArcEffects {
    fn new(records: &Records, arc: &Arc, effects: &[Vec<f64>]) -> Self {
        let layout = records.layout();
        let rows = arc.rows.start..arc.rows.end.min(arc.rows.start + REMEMBERED_ROWS);
        let places: Vec<_> = (0..layout.channels()).map(|c| layout.stretch(arc.record, c, rows.clone())).collect();
        let mut columns: Vec<Vec<f64>> = Vec::new();
        for effect in effects {
            let mut column: Vec<f64> =
                places.iter().flat_map(|p| effect.get(p.clone()).unwrap_or_default()).copied().collect();
            let before = norm(&column);
            for known in &columns {
                let along: f64 = column.iter().zip(known).map(|(a, b)| a * b).sum();
                for (a, b) in column.iter_mut().zip(known) {
                    *a -= along * b;
                }
            }
            let after = norm(&column);
            // An effect that is (nearly) the others' again, or that no weighted row sees, has nothing to take out.
            if after > 1e-6 * before && after.is_finite() && after > 0.0 {
                column.iter_mut().for_each(|a| *a /= after);
                columns.push(column);
            }
        }
        ArcEffects { places, columns }
    }

    fn zip<'a>(&'a self, vector: &'a [f64], column: &'a [f64]) -> impl Iterator<Item = (&'a f64, &'a f64)> {
        self.places.iter().flat_map(|p| vector.get(p.clone()).unwrap_or_default()).zip(column)
    }

    fn zip_mut<'a>(&'a self, vector: &'a mut [f64], column: &'a [f64]) -> impl Iterator<Item = (&'a mut f64, &'a f64)> {
        // Places are in order and do not overlap, so the vector can be handed out piece by piece.
        let mut rest = vector;
        let mut offset = 0;
        let mut pieces: Vec<&'a mut [f64]> = Vec::with_capacity(self.places.len());
        for place in &self.places {
            let Some((_, tail)) = rest.split_at_mut_checked(place.start - offset) else { break };
            let Some((piece, tail)) = tail.split_at_mut_checked(place.len()) else { break };
            pieces.push(piece);
            rest = tail;
            offset = place.end;
        }
        pieces.into_iter().flatten().zip(column)
    }
}

fn norm(vector: &[f64]) -> f64 {
    vector.iter().map(|v| v * v).sum::<f64>().sqrt()
}

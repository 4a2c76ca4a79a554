//! Plays side by side, undone.
//!
//! A flapper whose friction is not the same all along its way follows the mean of several plays of half widths `r_i`
//! (`valve_hysteresis` with `spread_duty`; a Prandtl-Ishlinskii model):
//!
//! ```text
//! z_i ← min(max(z_i, u − r_i), u + r_i)      flapper = mean of z_i
//! ```
//!
//! The mean never falls while `u` rises, and is made of straight pieces, so the duty that puts the flapper where it is
//! wanted is found to the last bit in as many steps as there are plays: Newton's method from the far side, where the
//! slope is the share of the plays that are engaged.

use model::mechanism::PLAYS;
use model::valve_path::mean_of_plays;

/// Changes of a wanted duty below this are rounding.
const ROUNDING: f64 = 1e-12;

/// The plays of one valve, with where each stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Plays {
    half_widths: [f64; PLAYS],
    mean_half_width: f64,
    /// z of each; `None` until a first duty is wanted.
    flappers: Option<[f64; PLAYS]>,
}

impl Plays {
    /// Plays of these half widths in duty, that have not moved yet.
    pub(crate) fn new(half_widths: [f64; PLAYS]) -> Self {
        Plays { half_widths, mean_half_width: mean_of_plays(&half_widths), flappers: None }
    }

    /// Mean of the half widths in duty: how far the duty is beside the flapper once all are engaged.
    pub(crate) fn mean_half_width(&self) -> f64 {
        self.mean_half_width
    }

    /// Forgets where they stand.
    pub(crate) fn restart(&mut self) {
        self.flappers = None;
    }

    /// The duty (not limited to 0 … 1) that moves the flapper to where it is wanted; `last`, the duty before, where it is there
    /// already. At first the flapper is taken to be there.
    ///
    /// # Real-time
    /// May run in the tick.
    pub(crate) fn undone(&mut self, wanted: f64, last: f64) -> f64 {
        let (half_widths, mean_half_width) = (self.half_widths, self.mean_half_width);
        let flappers = *self.flappers.get_or_insert_with(|| {
            // Each lies at the same share of its way.
            let share = (last - wanted) / mean_half_width.max(ROUNDING);
            half_widths.map(|half_width| last - share * half_width)
        });
        let missing = wanted - mean_of_plays(&flappers);
        if missing.abs() < ROUNDING {
            return last;
        }
        // Falling is rising upside down.
        let side = missing.signum();
        let widest = self.half_widths.iter().copied().fold(0.0, f64::max);
        let mut duty = side * wanted + widest;
        for _ in 0..PLAYS {
            let (mut sum, mut engaged) = (0.0, 0.0);
            for (flapper, half_width) in flappers.iter().zip(&self.half_widths) {
                let (stands, pulled) = (side * flapper, duty - half_width);
                sum += pulled.max(stands);
                engaged += f64::from(u8::from(pulled > stands));
            }
            let beyond = sum - PLAYS as f64 * side * wanted;
            if beyond <= 0.0 || engaged == 0.0 {
                break;
            }
            duty -= beyond / engaged;
        }
        self.pull(side * duty);
        side * duty
    }

    /// Moves the plays as a duty does that was sent.
    pub(crate) fn pull(&mut self, duty: f64) {
        let Some(flappers) = &mut self.flappers else { return };
        for (flapper, half_width) in flappers.iter_mut().zip(&self.half_widths) {
            *flapper = flapper.max(duty - half_width).min(duty + half_width);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCATTERED: [f64; PLAYS] = [0.0, 0.014, 0.03, 0.046, 0.062];

    /// The flapper as the model has it, beside the inverse: it is where it was wanted, through loops within loops.
    #[test]
    fn the_flapper_is_where_it_is_wanted() {
        for half_widths in [SCATTERED, [0.01, 0.02, 0.03, 0.04, 0.05], [0.03; PLAYS]] {
            let (mut inverse, mut duty, mut plant) = (Plays::new(half_widths), 0.5, [0.5_f64; PLAYS]);
            for tick in 0..2_000 {
                let time = 0.02 * f64::from(tick);
                let wanted = 0.5 + 0.08 * (0.7 * time).sin() + 0.03 * (3.1 * time).sin();
                duty = inverse.undone(wanted, duty);
                for (flapper, half_width) in plant.iter_mut().zip(half_widths) {
                    *flapper = flapper.clamp(duty - half_width, duty + half_width);
                }
                let found = mean_of_plays(&plant);
                assert!((found - wanted).abs() < 1e-12, "tick {tick}: {found} for {wanted}");
            }
        }
    }

    #[test]
    fn plays_of_one_width_are_a_single_play() {
        let mut plays = Plays::new([0.03; PLAYS]);
        let mut duty = plays.undone(0.5, 0.5);
        for (wanted, expected) in [(0.51, 0.54), (0.52, 0.55), (0.515, 0.485), (0.515, 0.485), (0.516, 0.546)] {
            duty = plays.undone(wanted, duty);
            assert!((duty - expected).abs() < 1e-12, "{duty} for {wanted}");
        }
    }

    /// Turning round costs the narrowest play at once and the others one by one, until all are crossed.
    #[test]
    fn a_turn_takes_the_narrow_plays_first() {
        let mut plays = Plays::new(SCATTERED);
        let top = plays.undone(0.5, 0.5);
        let top = plays.undone(0.7, top);
        let widest = SCATTERED.iter().sum::<f64>() / PLAYS as f64;
        assert!((top - 0.7 - widest).abs() < 1e-12, "all are engaged: {top}");
        // Back by a fifth of 0.028: only the play of no width has moved, by 0.028.
        let back = plays.undone(0.7 - 0.028 / 5.0, top);
        assert!((back - (top - 0.028)).abs() < 1e-12, "{back}");
        let far = plays.undone(0.4, back);
        assert!((far - 0.4 + widest).abs() < 1e-12, "all are engaged the other way: {far}");
    }
}

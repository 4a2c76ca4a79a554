//! A Kalman smoother for what a model leaves out.
//!
//! Near a simulated run the pressures' error `e` obeys the linearised balances, driven by what is missing:
//!
//! ```text
//! e_{k+1} = F_k e_k + h Σ_i b_i w_i            e: error of each chamber, kPa
//! r_k     = e_k + Σ_i c_i w_i + noise          r: recorded less simulated, kPa
//! ```
//!
//! Each missing thing `w_i` is a Gaussian process with a Matérn-3/2 covariance (two states, exactly discretised:
//! Hartikainen & Särkkä, *MLSP* 2010). `b` says into which balances it enters, `c` into which readings: a leak has a
//! `b`, a sensor's lag has a `c`. The filter gives the likelihood of a suspect (so that suspects can be compared, as
//! CTSM does with diffusion terms: Kristensen, Madsen & Jørgensen 2004), the Rauch-Tung-Striebel pass gives `w_i(t)`
//! with its uncertainty.

/// The most chambers.
pub const MOST_CHANNELS: usize = 4;
/// The most states: an error per chamber and two per process.
const MOST: usize = 12;

/// Something that may be missing.
#[derive(Debug, Clone, PartialEq)]
pub struct Latent {
    /// Share in the rate of each chamber's pressure, in kPa/s per unit.
    pub into_rate: [f64; MOST_CHANNELS],
    /// Share in each reading, in kPa per unit.
    pub into_reading: [f64; MOST_CHANNELS],
    /// Correlation length ℓ in s.
    pub length_s: f64,
    /// Standard deviation in its unit.
    pub sd: f64,
}

/// One gapless run of rows.
#[derive(Debug, Clone, Copy)]
pub struct Series<'a> {
    /// Number of chambers, each with a sensor.
    pub channels: usize,
    /// Recorded less simulated in kPa, `[row][channel]` flattened; NaN where there is no reading.
    pub residual_kpa: &'a [f64],
    /// `F_k` from row k to k + 1, `[row][to][from]` flattened.
    pub transition: &'a [f64],
    /// Time between rows in s.
    pub step_s: f64,
    /// Variance of the noise by channel, in kPa².
    pub noise_kpa2: [f64; MOST_CHANNELS],
    /// Variance of the error at the first row, in kPa².
    pub start_kpa2: f64,
}

/// Estimates of the missing things, row by row.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Smoothed {
    /// Mean of each process, `[process][row]`.
    pub mean: Vec<Vec<f64>>,
    /// Standard deviation of each process, `[process][row]`.
    pub sd: Vec<Vec<f64>>,
}

type Vector = [f64; MOST];
type Matrix = [[f64; MOST]; MOST];

const ZERO: Matrix = [[0.0; MOST]; MOST];

/// The state-space form of some missing things over one series.
struct StateSpace<'a> {
    series: Series<'a>,
    latents: &'a [Latent],
    /// States in use.
    n: usize,
    /// Transition and noise of each process.
    blocks: Vec<Block>,
}

/// A Matérn-3/2 process from row to row.
struct Block {
    a: [[f64; 2]; 2],
    q: [[f64; 2]; 2],
}

impl Block {
    fn new(latent: &Latent, step_s: f64) -> Self {
        let rate = 3.0_f64.sqrt() / latent.length_s.max(1e-3);
        let decay = (-rate * step_s).exp();
        let a = [
            [decay * (1.0 + rate * step_s), decay * step_s],
            [-decay * rate * rate * step_s, decay * (1.0 - rate * step_s)],
        ];
        let stationary = [latent.sd * latent.sd, (rate * latent.sd).powi(2)];
        // Q = P∞ − A P∞ Aᵀ keeps the process stationary.
        let mut q = [[0.0; 2]; 2];
        for (i, row) in q.iter_mut().enumerate() {
            for (j, slot) in row.iter_mut().enumerate() {
                let carried: f64 = (0..2).map(|k| a[i][k] * stationary[k] * a[j][k]).sum();
                *slot = if i == j { stationary[i] } else { 0.0 } - carried;
            }
        }
        Block { a, q }
    }
}

#[expect(clippy::needless_range_loop, reason = "matrix algebra reads best by its indices")]
impl<'a> StateSpace<'a> {
    fn new(series: Series<'a>, latents: &'a [Latent]) -> Option<Self> {
        let n = series.channels + 2 * latents.len();
        if n > MOST || series.channels > MOST_CHANNELS || series.channels == 0 {
            return None;
        }
        let blocks = latents.iter().map(|latent| Block::new(latent, series.step_s)).collect();
        Some(StateSpace { series, latents, n, blocks })
    }

    fn rows(&self) -> usize {
        self.series.residual_kpa.len() / self.series.channels
    }

    fn start(&self) -> (Vector, Matrix) {
        let mut p = ZERO;
        for c in 0..self.series.channels {
            p[c][c] = self.series.start_kpa2;
        }
        for (i, latent) in self.latents.iter().enumerate() {
            let at = self.series.channels + 2 * i;
            p[at][at] = latent.sd * latent.sd;
            p[at + 1][at + 1] = (3.0_f64.sqrt() / latent.length_s.max(1e-3) * latent.sd).powi(2);
        }
        ([0.0; MOST], p)
    }

    /// Transition from row `k` to the next.
    fn transition(&self, k: usize) -> Matrix {
        let c = self.series.channels;
        let mut a = ZERO;
        for to in 0..c {
            for from in 0..c {
                a[to][from] = self.series.transition.get((k * c + to) * c + from).copied().unwrap_or(0.0);
            }
            // What flows in during a row decays while it does: h (F − 1)/ln F instead of h.
            let kept = a[to][to].clamp(1e-3, 0.999_999);
            let h = self.series.step_s * (kept - 1.0) / kept.ln();
            for (i, latent) in self.latents.iter().enumerate() {
                a[to][c + 2 * i] = h * latent.into_rate[to];
            }
        }
        for (i, block) in self.blocks.iter().enumerate() {
            let at = c + 2 * i;
            for row in 0..2 {
                for column in 0..2 {
                    a[at + row][at + column] = block.a[row][column];
                }
            }
        }
        a
    }

    fn predict(&self, a: &Matrix, x: &Vector, p: &Matrix) -> (Vector, Matrix) {
        let n = self.n;
        let mut moved = [0.0; MOST];
        let mut ap = ZERO;
        for i in 0..n {
            for k in 0..n {
                let factor = a[i][k];
                if factor != 0.0 {
                    moved[i] += factor * x[k];
                    for j in 0..n {
                        ap[i][j] += factor * p[k][j];
                    }
                }
            }
        }
        let mut predicted = ZERO;
        for i in 0..n {
            for k in 0..n {
                for j in 0..n {
                    predicted[i][k] += ap[i][j] * a[k][j];
                }
            }
        }
        for (i, block) in self.blocks.iter().enumerate() {
            let at = self.series.channels + 2 * i;
            for row in 0..2 {
                for column in 0..2 {
                    predicted[at + row][at + column] += block.q[row][column];
                }
            }
        }
        (moved, predicted)
    }

    /// Takes in the readings of row `k`; the log-likelihood of them.
    fn update(&self, k: usize, x: &mut Vector, p: &mut Matrix) -> f64 {
        let (n, c) = (self.n, self.series.channels);
        let mut likelihood = 0.0;
        for channel in 0..c {
            let Some(reading) = self.series.residual_kpa.get(k * c + channel).copied() else { continue };
            if !reading.is_finite() {
                continue;
            }
            let mut h = [0.0; MOST];
            h[channel] = 1.0;
            for (i, latent) in self.latents.iter().enumerate() {
                h[c + 2 * i] = latent.into_reading[channel];
            }
            let mut ph = [0.0; MOST];
            for i in 0..n {
                for j in 0..n {
                    ph[i] += p[i][j] * h[j];
                }
            }
            let spread: f64 = (0..n).map(|i| h[i] * ph[i]).sum::<f64>() + self.series.noise_kpa2[channel];
            let surprise = reading - (0..n).map(|i| h[i] * x[i]).sum::<f64>();
            likelihood -= 0.5 * (surprise * surprise / spread + spread.ln() + std::f64::consts::TAU.ln());
            for i in 0..n {
                let gain = ph[i] / spread;
                x[i] += gain * surprise;
                for j in 0..n {
                    p[i][j] -= gain * ph[j];
                }
            }
        }
        likelihood
    }
}

/// The log-likelihood of a series with these things missing; `None` if there are too many of them.
pub fn log_likelihood(series: Series<'_>, latents: &[Latent]) -> Option<f64> {
    let space = StateSpace::new(series, latents)?;
    let (mut x, mut p) = space.start();
    let mut sum = 0.0;
    for k in 0..space.rows() {
        sum += space.update(k, &mut x, &mut p);
        (x, p) = space.predict(&space.transition(k), &x, &p);
    }
    sum.is_finite().then_some(sum)
}

/// The missing things given the whole series; `None` if there are too many of them.
pub fn smooth(series: Series<'_>, latents: &[Latent]) -> Option<Smoothed> {
    let space = StateSpace::new(series, latents)?;
    let (rows, n, c) = (space.rows(), space.n, series.channels);
    let (mut x, mut p) = space.start();
    let mut filtered = Vec::with_capacity(rows);
    let mut predicted = Vec::with_capacity(rows);
    for k in 0..rows {
        space.update(k, &mut x, &mut p);
        filtered.push((x, p));
        (x, p) = space.predict(&space.transition(k), &x, &p);
        predicted.push((x, p));
    }
    let mut out = Smoothed { mean: vec![vec![0.0; rows]; latents.len()], sd: vec![vec![0.0; rows]; latents.len()] };
    let mut after: Option<(Vector, Matrix)> = None;
    for k in (0..rows).rev() {
        let Some((x, p)) = filtered.get(k) else { continue };
        let here = match (&after, predicted.get(k)) {
            (Some((xs, ps)), Some((xp, pp))) => backward(&space.transition(k), n, (x, p), (xp, pp), (xs, ps)),
            _ => (*x, *p),
        };
        for i in 0..latents.len() {
            let at = c + 2 * i;
            if let (Some(mean), Some(sd)) = (out.mean[i].get_mut(k), out.sd[i].get_mut(k)) {
                *mean = here.0[at];
                *sd = here.1[at][at].max(0.0).sqrt();
            }
        }
        after = Some(here);
    }
    Some(out)
}

/// One step of the Rauch-Tung-Striebel pass.
#[expect(clippy::needless_range_loop, reason = "matrix algebra reads best by its indices")]
fn backward(
    a: &Matrix,
    n: usize,
    filtered: (&Vector, &Matrix),
    predicted: (&Vector, &Matrix),
    after: (&Vector, &Matrix),
) -> (Vector, Matrix) {
    // Gain G = P Aᵀ Pp⁻¹, by solving Pp Gᵀ = A P.
    let mut ap = ZERO;
    for i in 0..n {
        for k in 0..n {
            for j in 0..n {
                ap[i][j] += a[i][k] * filtered.1[k][j];
            }
        }
    }
    let transposed = solve(predicted.1, &ap, n);
    let (mut x, mut p) = (*filtered.0, *filtered.1);
    for i in 0..n {
        for k in 0..n {
            x[i] += transposed[k][i] * (after.0[k] - predicted.0[k]);
        }
    }
    let mut change = ZERO;
    for i in 0..n {
        for k in 0..n {
            let difference = after.1[i][k] - predicted.1[i][k];
            if difference != 0.0 {
                for j in 0..n {
                    change[i][j] += difference * transposed[k][j];
                }
            }
        }
    }
    for i in 0..n {
        for j in 0..n {
            for k in 0..n {
                p[i][j] += transposed[k][i] * change[k][j];
            }
        }
    }
    (x, p)
}

/// Solves `M X = B` for a symmetric positive definite `M` by Cholesky, with a floor that keeps tiny pivots sound.
fn solve(m: &Matrix, b: &Matrix, n: usize) -> Matrix {
    let mut l = ZERO;
    for i in 0..n {
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
            if i == j {
                l[i][i] = (m[i][i] - sum).max(1e-14 * m[i][i].abs().max(1e-12)).sqrt();
            } else {
                l[i][j] = (m[i][j] - sum) / l[j][j];
            }
        }
    }
    let mut x = ZERO;
    for column in 0..n {
        let mut y = [0.0; MOST];
        for i in 0..n {
            let sum: f64 = (0..i).map(|k| l[i][k] * y[k]).sum();
            y[i] = (b[i][column] - sum) / l[i][i];
        }
        for i in (0..n).rev() {
            let sum: f64 = (i + 1..n).map(|k| l[k][i] * x[k][column]).sum();
            x[i][column] = (y[i] - sum) / l[i][i];
        }
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    /// A chamber with a time constant of 0.4 s into which a known flow comes: it is found again, within what the
    /// smoother says of its own uncertainty, and the balance is told from the sensor.
    #[test]
    fn a_planted_flow_is_found_with_an_honest_uncertainty() {
        let (rows, step_s, sd) = (3000, 0.02, 0.1);
        let kept = (-step_s / 0.4_f64).exp();
        let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(3);
        let mut draw = || -> f64 { StandardNormal.sample(&mut random) };
        let flow = |k: usize| 2.0 * (k as f64 * step_s / 1.3).sin() * (k as f64 * step_s / 7.0).cos();
        let (mut error, mut residual) = (0.0, Vec::new());
        for k in 0..rows {
            residual.push(error + sd * draw());
            error = kept * error + step_s * (kept - 1.0) / kept.ln() * flow(k);
        }
        let transition = vec![kept; rows];
        let series = Series {
            channels: 1,
            residual_kpa: &residual,
            transition: &transition,
            step_s,
            noise_kpa2: [sd * sd; MOST_CHANNELS],
            start_kpa2: 0.01,
        };
        let latent = |rate: f64, reading: f64, sd: f64| Latent {
            into_rate: [rate; MOST_CHANNELS],
            into_reading: [reading; MOST_CHANNELS],
            length_s: 1.5,
            sd,
        };
        let found = smooth(series, &[latent(1.0, 0.0, 1.5)]).unwrap();
        let inner = 100..rows - 100;
        let mut normalised = 0.0;
        for k in inner.clone() {
            normalised += ((found.mean[0][k] - flow(k)) / found.sd[0][k]).powi(2);
        }
        let normalised = (normalised / inner.len() as f64).sqrt();
        // The truth is smoother than a Matérn process, so the stated uncertainty is an upper estimate.
        assert!((0.2..1.3).contains(&normalised), "{normalised}");
        let in_balance = log_likelihood(series, &[latent(1.0, 0.0, 1.5)]).unwrap();
        let nothing = log_likelihood(series, &[]).unwrap();
        assert!(in_balance > nothing + 500.0, "{in_balance} against {nothing}");
    }

    #[test]
    fn too_many_processes_are_refused() {
        let residual = [0.0; 4];
        let transition = [0.9; 4];
        let series = Series {
            channels: 1,
            residual_kpa: &residual,
            transition: &transition,
            step_s: 0.02,
            noise_kpa2: [0.01; MOST_CHANNELS],
            start_kpa2: 0.01,
        };
        let latent = Latent { into_rate: [1.0; 4], into_reading: [0.0; 4], length_s: 1.0, sd: 1.0 };
        assert!(log_likelihood(series, &vec![latent; 6]).is_none());
    }
}

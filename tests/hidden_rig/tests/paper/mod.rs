//! The paper's model, written once more from its equations, as what the hidden rig must be explainable by.
//!
//! Equations (1)–(7) as the project reads them: isothermal pistons and chambers, isentropic orifices, areas by (5), RK4
//! at 0.1 ms. Only for tests: nothing here is used by the rig.

#![allow(dead_code, unreachable_pub, clippy::many_single_char_names)] // each user takes its part; the paper's letters

use std::f64::consts::{PI, TAU};

const R: f64 = 287.0;
const KAPPA: f64 = 1.4;
const T_CHAMBER: f64 = 293.15;
const P_ATM: f64 = 101_325.0;
const NOZZLE_AREA: f64 = PI * 3.0e-3 * 3.0e-3 / 4.0;
const STEP_S: f64 = 1e-4;
const STEPS_PER_TICK: usize = 200;

/// The identifiable parameters of Table III, in SI units.
pub const NAMES: [&str; 13] = [
    "c_u_pos", "c_p_pos", "c_k_pos", "c_u_neg", "c_p_neg", "c_k_neg", "v_pos", "v_neg", "c_in", "c_out", "t_pis",
    "s_pis", "delta",
];

/// Their printed values.
pub const TABLE_III: [f64; 13] = [
    4.876e-6, 3.066e-6, 4.474e-6, 7.992e-6, 7.590e-6, 7.339e-6, 0.75e-3, 0.4e-3, 33.47e-6, 1.46e-6, 323.15, 38.485e-4,
    0.041,
];

/// The paper's simulator with these parameters.
#[derive(Clone)]
pub struct Paper {
    pub p: [f64; 13],
    /// Crank angle at time 0 (rad).
    pub angle: f64,
}

/// Isentropic flow number.
fn phi(up: f64, down: f64) -> f64 {
    let ratio = down / up;
    if ratio >= 1.0 {
        return 0.0;
    }
    if ratio <= 0.528_281_8 {
        return (KAPPA * (2.0 / (KAPPA + 1.0_f64)).powf((KAPPA + 1.0) / (KAPPA - 1.0))).sqrt();
    }
    let y = ratio.powf(1.0 / 7.0);
    let y10 = y.powi(10);
    (2.0 * KAPPA / (KAPPA - 1.0)).sqrt() * (y10 - y10 * y * y).max(0.0).sqrt()
}

fn flow(area: f64, up: f64, down: f64, t_up: f64) -> f64 {
    if up <= down { 0.0 } else { area * up / (R * t_up).sqrt() * phi(up, down) }
}

impl Paper {
    fn rates(&self, angle: f64, speed: f64, x: [f64; 4], u: [f64; 2]) -> [f64; 4] {
        let [cu_p, cp_p, ck_p, cu_n, cp_n, ck_n, v_pos, v_neg, c_in, c_out, t_pis, s_pis, delta] = self.p;
        let (r, l) = (0.02, 0.07);
        let [_, _, pos, neg] = x;
        let mut rates = [0.0; 4];
        let (mut into_pos, mut out_of_neg) = (0.0, 0.0);
        for i in 0..2 {
            let (sin, cos) = (angle + PI * i as f64).sin_cos();
            let root = (l * l - r * r * sin * sin).sqrt();
            let v = s_pis * (delta - r + l - r * cos - root);
            let v_dot = s_pis * speed * (r * sin + r * r * sin * cos / root);
            let m_in = flow(c_in, neg, x[i], T_CHAMBER);
            let m_out = flow(c_out, x[i], pos, t_pis);
            rates[i] = (-x[i] * v_dot + (m_in - m_out) * R * t_pis) / v;
            into_pos += m_out;
            out_of_neg += m_in;
        }
        let area = |cu: f64, cp: f64, ck: f64, u: f64, dp: f64| (cu * u + cp * NOZZLE_AREA * dp - ck).max(0.0);
        let vent_pos = flow(area(cu_p, cp_p, ck_p, u[0], pos - P_ATM), pos, P_ATM, T_CHAMBER);
        let vent_neg = flow(area(cu_n, cp_n, ck_n, u[1], P_ATM - neg), P_ATM, neg, T_CHAMBER);
        rates[2] = R * T_CHAMBER / v_pos * (into_pos - vent_pos);
        rates[3] = R * T_CHAMBER / v_neg * (vent_neg - out_of_neg);
        rates
    }

    fn tick(&self, angle: &mut f64, x: &mut [f64; 4], u: [f64; 2], pump_on: bool) {
        let speed = if pump_on { TAU * 50.0 } else { 0.0 };
        let h = STEP_S;
        for _ in 0..STEPS_PER_TICK {
            let add = |k: [f64; 4], f: f64| std::array::from_fn(|i| x[i] + f * k[i]);
            let k1 = self.rates(*angle, speed, *x, u);
            let middle = *angle + 0.5 * h * speed;
            let k2 = self.rates(middle, speed, add(k1, 0.5 * h), u);
            let k3 = self.rates(middle, speed, add(k2, 0.5 * h), u);
            let k4 = self.rates(*angle + h * speed, speed, add(k3, h), u);
            for i in 0..4 {
                x[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
            }
            *angle = (*angle + h * speed) % TAU;
        }
    }

    /// Chamber pressures (kPa gauge) at every row; the run starts from rest at the atmosphere.
    pub fn run_from_rest(&self, u: &[[f64; 2]]) -> Vec<[f64; 2]> {
        self.follow([P_ATM; 4], u)
    }

    /// Run from a settled start whose chambers have the first row's pressures (kPa gauge).
    pub fn run_from_pressures(&self, u: &[[f64; 2]], first_kpa: [f64; 2]) -> Vec<[f64; 2]> {
        let mut x = [P_ATM, P_ATM, P_ATM + 1e3 * first_kpa[0], P_ATM + 1e3 * first_kpa[1]];
        let mut angle = self.angle;
        // Ten turns settle the pistons; the chambers are put back after each.
        for _ in 0..10 {
            self.tick(&mut angle, &mut x, u[0], true);
            (x[2], x[3]) = (P_ATM + 1e3 * first_kpa[0], P_ATM + 1e3 * first_kpa[1]);
        }
        self.follow(x, u)
    }

    fn follow(&self, mut x: [f64; 4], u: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let mut angle = self.angle;
        u.iter()
            .map(|&u| {
                let row = [1e-3 * (x[2] - P_ATM), 1e-3 * (x[3] - P_ATM)];
                self.tick(&mut angle, &mut x, u, true);
                row
            })
            .collect()
    }
}

/// Root mean square of the difference, by channel.
pub fn rms(a: &[[f64; 2]], b: &[[f64; 2]]) -> [f64; 2] {
    std::array::from_fn(|c| (a.iter().zip(b).map(|(a, b)| (a[c] - b[c]).powi(2)).sum::<f64>() / a.len() as f64).sqrt())
}

/// Refits the paper's parameters to a trace by Levenberg–Marquardt in their logarithms, every row, both channels.
///
/// A weak prior of ±30 % keeps directions that the data do not show where they are.
pub fn refit(start: &Paper, u: &[[f64; 2]], trace: &[[f64; 2]], rounds: usize) -> (Paper, [f64; 2]) {
    const SCALE_KPA: f64 = 0.02;
    let threads = 2;
    let mut best = start.clone();
    let mut run = best.run_from_pressures(u, trace[0]);
    let prior = |model: &Paper| -> f64 { model.p.iter().zip(start.p).map(|(p, s)| ((p / s).ln() / 0.3).powi(2)).sum() };
    let cost = |run: &[[f64; 2]], model: &Paper| {
        run.iter()
            .zip(trace)
            .map(|(a, b)| (0..2).map(|c| ((a[c] - b[c]) / SCALE_KPA).powi(2)).sum::<f64>())
            .sum::<f64>()
            + prior(model)
    };
    let mut damping = 1e-3;
    let mut now = cost(&run, &best);
    for _ in 0..rounds {
        let jacobian: Vec<Vec<[f64; 2]>> = std::thread::scope(|scope| {
            let (best, run) = (&best, &run);
            let workers: Vec<_> = (0..threads)
                .map(|w| {
                    scope.spawn(move || {
                        (w..13)
                            .step_by(threads)
                            .map(|k| {
                                let mut other = best.clone();
                                other.p[k] *= 1.0 + 1e-4;
                                let moved = other.run_from_pressures(u, trace[0]);
                                let column: Vec<[f64; 2]> = moved
                                    .iter()
                                    .zip(run)
                                    .map(|(m, r)| [(m[0] - r[0]) / 1e-4 / SCALE_KPA, (m[1] - r[1]) / 1e-4 / SCALE_KPA])
                                    .collect();
                                (k, column)
                            })
                            .collect::<Vec<_>>()
                    })
                })
                .collect();
            let mut columns: Vec<_> = workers.into_iter().flat_map(|w| w.join().unwrap()).collect();
            columns.sort_by_key(|(k, _)| *k);
            columns.into_iter().map(|(_, column)| column).collect()
        });
        let residual: Vec<[f64; 2]> =
            run.iter().zip(trace).map(|(r, t)| [(t[0] - r[0]) / SCALE_KPA, (t[1] - r[1]) / SCALE_KPA]).collect();
        let dot = |a: &[[f64; 2]], b: &[[f64; 2]]| a.iter().zip(b).map(|(a, b)| a[0] * b[0] + a[1] * b[1]).sum::<f64>();
        let mut better = false;
        for _ in 0..6 {
            let mut normal: Vec<Vec<f64>> = (0..13)
                .map(|i| {
                    let mut row: Vec<f64> = (0..13).map(|j| dot(&jacobian[i], &jacobian[j])).collect();
                    row[i] = (row[i] + 1.0 / 0.09) * (1.0 + damping);
                    row.push(dot(&jacobian[i], &residual) - (best.p[i] / start.p[i]).ln() / 0.09);
                    row
                })
                .collect();
            let step = solve(&mut normal);
            let mut trial = best.clone();
            for (p, s) in trial.p.iter_mut().zip(&step) {
                *p *= s.clamp(-0.3, 0.3).exp();
            }
            let moved = trial.run_from_pressures(u, trace[0]);
            let then = cost(&moved, &trial);
            if then < now {
                better = then < now * (1.0 - 1e-3);
                (best, run, now) = (trial, moved, then);
                damping *= 0.1;
                break;
            }
            damping *= 10.0;
        }
        if !better {
            break;
        }
    }
    let distance = rms(&run, trace);
    (best, distance)
}

/// Gaussian elimination with pivoting on rows of coefficients and right-hand side.
fn solve(rows: &mut [Vec<f64>]) -> Vec<f64> {
    let n = rows.len();
    for k in 0..n {
        let pivot = (k..n).max_by(|a, b| rows[*a][k].abs().total_cmp(&rows[*b][k].abs())).unwrap();
        rows.swap(k, pivot);
        for i in k + 1..n {
            let f = rows[i][k] / rows[k][k];
            let pivot_row = rows[k].clone();
            for (cell, above) in rows[i][k..].iter_mut().zip(&pivot_row[k..]) {
                *cell -= f * above;
            }
        }
    }
    let mut x = vec![0.0; n];
    for k in (0..n).rev() {
        x[k] = (rows[k][n] - (k + 1..n).map(|j| rows[k][j] * x[j]).sum::<f64>()) / rows[k][k];
    }
    x
}

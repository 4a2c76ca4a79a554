//! Kernels against plain sums in f64, and against each other to the bit.

use super::*;
use crate::adam::{AdamStep, Learned};

/// Numbers in [-1, 1) that repeat from run to run.
fn numbers(count: usize, seed: u64) -> Vec<f32> {
    let random = crate::random::Random::new(seed);
    let draw = |at| random.uniforms(crate::random::Purpose::Weights, at as u32, 0);
    (0..count).step_by(WIDTH).flat_map(draw).take(count).map(|x| 2.0 * x - 1.0).collect()
}

/// `x[f][sample]` as a panel.
fn panel(x: &[f32]) -> Lines {
    let mut lines = zeroed((x.len() / WIDTH).next_multiple_of(LANES));
    for (at, &x) in x.iter().enumerate() {
        lines[at / WIDTH].0[at % WIDTH] = x;
    }
    lines
}

/// `w[n][k]` in panels of 16 inputs.
fn packed(w: &[f32], rows: usize, inputs: usize) -> Lines {
    let mut lines = zeroed(lines_for(inputs) * row_step(rows));
    for n in 0..rows {
        for k in 0..inputs {
            lines[k / WIDTH * row_step(rows) + n].0[k % WIDTH] = w[n * inputs + k];
        }
    }
    lines
}

fn bias(b: &[f32]) -> Lines {
    let mut lines = zeroed(lines_for(b.len()));
    b.iter().enumerate().for_each(|(n, &b)| lines[n / WIDTH].0[n % WIDTH] = b);
    lines
}

/// Rounding of a sum of `terms` products of numbers up to one: each step rounds to half a unit of the last place.
fn rounding(terms: usize) -> f64 {
    terms as f64 * terms as f64 * 6e-8 + 1e-7
}

/// Rows and inputs that meet every remainder of every tile.
const SHAPES: [(usize, usize); 8] = [(1, 1), (3, 16), (8, 17), (12, 84), (15, 33), (24, 40), (37, 96), (64, 132)];

#[test]
fn forward_is_the_sum() {
    for (rows, inputs) in SHAPES {
        let (w, b, x) = (numbers(rows * inputs, 1), numbers(rows, 2), numbers(inputs * LANES, 3));
        let (lines, bias, panel) = (packed(&w, rows, inputs), bias(&b), panel(&x));
        let weights = Weights { lines: &lines, bias: &bias, rows, inputs, step: row_step(rows) };
        let mut results = Vec::new();
        for (cpu, rectify) in Cpu::all().into_iter().flat_map(|cpu| [(cpu, false), (cpu, true)]) {
            let mut y = zeroed(2 * rows);
            let mut gates = vec![0; rows];
            cpu.run(Forward { weights, x: &panel, y: &mut y, gates: rectify.then_some(&mut gates) });
            for (n, s) in (0..rows).flat_map(|n| (0..LANES).map(move |s| (n, s))) {
                let product = |k: usize| f64::from(w[n * inputs + k]) * f64::from(x[k * LANES + s]);
                let mut expected = f64::from(b[n]) + (0..inputs).map(product).sum::<f64>();
                if rectify {
                    expected = expected.max(0.0);
                }
                let got = f64::from(y[2 * n + s / WIDTH].0[s % WIDTH]);
                assert!((got - expected).abs() < rounding(inputs), "{cpu:?} {rows} {inputs}: {got} {expected}");
                assert_eq!(gates[n] >> s & 1 == 1, rectify && got > 0.0, "{cpu:?} {rows} {inputs}: gate {s} of {n}");
            }
            results.push(y);
        }
        // Plain and rectified alternate; each must be the same bits on every instruction set.
        assert!(results.iter().step_by(2).all(|y| y == &results[0]));
        assert!(results.iter().skip(1).step_by(2).all(|y| y == &results[1]));
    }
}

#[test]
fn backward_is_the_sum_through_open_gates() {
    for (rows, inputs) in SHAPES {
        let (w, dy, gate) = (numbers(rows * inputs, 4), numbers(rows * LANES, 5), numbers(inputs * LANES, 6));
        // Cut in two parts at every place, as threads do; the sum must not notice.
        let mut results = Vec::new();
        for (cpu, cut) in Cpu::all().into_iter().flat_map(|cpu| [(cpu, 0), (cpu, rows / 2), (cpu, rows)]) {
            let (low, high) = w.split_at(cut * inputs);
            let (low, high) = (packed(low, cut, inputs), packed(high, rows - cut, inputs));
            let none = zeroed(lines_for(rows));
            let part = |lines, rows| Weights { lines, bias: &none, rows, inputs, step: row_step(rows) };
            let dy = panel(&dy);
            let open = |k: usize| (0..LANES).fold(0, |bits, s| bits | Gate::from(gate[k * LANES + s] > 0.0) << s);
            let gates: Vec<Gate> = (0..inputs).map(open).collect();
            let (first, second) = dy.split_at(2 * cut);
            let all = |weights: Weights<'_>| (0..weights.rows as u16).collect();
            let parts = [(part(&low, cut), first), (part(&high, rows - cut), second)].map(|(weights, dy)| Rows {
                weights,
                dy,
                live: all(weights),
            });
            let mut dx = zeroed(2 * inputs);
            cpu.run(Backward { parts: &parts, inputs, gates: Some(&gates), dx: &mut dx });
            results.push(dx);
        }
        for (k, s) in (0..inputs).flat_map(|k| (0..LANES).map(move |s| (k, s))) {
            let product = |n: usize| f64::from(w[n * inputs + k]) * f64::from(dy[n * LANES + s]);
            let open = gate[k * LANES + s] > 0.0;
            let expected = if open { (0..rows).map(product).sum::<f64>() } else { 0.0 };
            let got = f64::from(results[0][2 * k + s / WIDTH].0[s % WIDTH]);
            assert!((got - expected).abs() < rounding(rows), "{rows} {inputs}: {got} {expected}");
        }
        assert!(results.iter().all(|dx| dx == &results[0]), "{rows} {inputs}");
    }
}

#[test]
fn weight_step_is_adam_on_the_sum_over_samples() {
    // One panel, a round, and more than one round.
    for (panels, (rows, inputs)) in [1, 4, 9].into_iter().flat_map(|p| SHAPES.map(|shape| (p, shape))) {
        let samples = panels * LANES;
        let (x, dy, w) = (numbers(samples * inputs, 7), numbers(samples * rows, 8), numbers(rows * inputs, 9));
        let padded = inputs.next_multiple_of(WIDTH);
        let by_sample = |p: usize| {
            let mut lines = zeroed(padded * 2);
            for (k, s) in (0..inputs).flat_map(|k| (0..LANES).map(move |s| (k, s))) {
                lines[k / WIDTH * LANES + s].0[k % WIDTH] = x[(p * LANES + s) * inputs + k];
            }
            lines
        };
        let xs: Vec<_> = (0..panels).map(by_sample).collect();
        let dys: Vec<_> = (0..panels).map(|p| panel(&dy[p * LANES * rows..][..LANES * rows])).collect();
        let pairs: Vec<(&[Line], &[Line])> = xs.iter().zip(&dys).map(|(x, dy)| (&x[..], &dy[..])).collect();
        let mut results = Vec::new();
        for cpu in Cpu::all() {
            let mut weights = Learned::zeroed(lines_for(inputs) * row_step(rows), true);
            weights.value = packed(&w, rows, inputs);
            let (mut scratch, step) = (zeroed(2 * rows), AdamStep::new(1, 0.01, 0.25));
            let (scratch, weights_mut) = (&mut scratch, &mut weights);
            cpu.run(WeightStep {
                panels: &pairs,
                rows: &(0..rows as u16).collect::<Vec<_>>(),
                inputs,
                row_step: row_step(rows),
                scratch,
                weights: weights_mut,
                step,
            });
            results.push(weights);
        }
        for (n, k) in (0..rows).flat_map(|n| (0..inputs).map(move |k| (n, k))) {
            let dy = |s: usize| f64::from(dy[s / LANES * LANES * rows + n * LANES + s % LANES]);
            let gradient: f64 = (0..samples).map(|s| dy(s) * f64::from(x[s * inputs + k])).sum();
            let (line, float) = (k / WIDTH * row_step(rows) + n, k % WIDTH);
            let at = |lines: &[Line]| f64::from(lines[line].0[float]);
            let learned = &results[0];
            let off = (at(&learned.mean) / 0.1 - gradient).abs();
            assert!(off < rounding(samples), "{rows} {inputs} {panels}: {off}");
            // The first step of Adam is η towards lower loss, whatever the gradient's size; a quarter of it slowly.
            if gradient.abs() > 1e-2 {
                let moved = at(&learned.value) - f64::from(w[n * inputs + k]);
                assert!((moved + 0.01 * gradient.signum()).abs() < 1e-6, "{moved} for {gradient}");
                assert!((at(&learned.target) - 0.25 * at(&learned.value)).abs() < 1e-6);
            }
        }
        for other in &results[1..] {
            assert!(other.value == results[0].value && other.square == results[0].square, "{rows} {inputs} {panels}");
        }
    }
}

/// Every third row has no gradient at all. ForwardPass over or not, no bit differs on the way back, nor in a step from moments
/// that are not zero.
#[test]
fn rows_without_a_gradient_may_be_passed_over() {
    for (rows, inputs) in SHAPES {
        let (w, mut dy) = (numbers(rows * inputs, 12), numbers(rows * LANES, 13));
        let (silent, live): (Vec<u16>, Vec<u16>) = (0..rows as u16).partition(|n| n % 3 == 0);
        silent.iter().for_each(|&n| dy[usize::from(n) * LANES..][..LANES].fill(0.0));
        let (lines, dy) = (packed(&w, rows, inputs), panel(&dy));
        let none = zeroed(lines_for(rows));
        let weights = Weights { lines: &lines, bias: &none, rows, inputs, step: row_step(rows) };
        let all: Vec<u16> = (0..rows as u16).collect();
        let back = |cpu: Cpu, live: &[u16]| {
            let mut dx = zeroed(2 * inputs);
            let parts = [Rows { weights, dy: &dy, live: live.to_vec() }];
            cpu.run(Backward { parts: &parts, inputs, gates: None, dx: &mut dx });
            dx
        };
        let x = panel(&numbers(inputs.next_multiple_of(WIDTH) * LANES, 14));
        let of_live: Vec<Line> = live.iter().flat_map(|&n| dy[2 * usize::from(n)..][..2].to_vec()).collect();
        let stepped = |cpu: Cpu, rows_of: &[u16], dy: &[Line], coasting: &[u16]| {
            let mut learned = Learned::zeroed(lines.len(), true);
            learned.value.copy_from_slice(&lines);
            learned.mean.copy_from_slice(&lines);
            learned.square.iter_mut().zip(&*lines).for_each(|(to, w)| to.0 = w.0.map(|w| w * w));
            let (mut scratch, step) = (zeroed(2 * rows), AdamStep::new(3, 0.01, 0.25));
            let (weights, row_step) = (&mut learned, row_step(rows));
            let panels = [(&x[..], dy)];
            cpu.run(WeightStep {
                panels: &panels,
                rows: rows_of,
                inputs,
                row_step,
                scratch: &mut scratch,
                weights: &mut *weights,
                step,
            });
            cpu.run(MomentumStep { rows: coasting, inputs, row_step, weights, step });
            learned
        };
        for cpu in Cpu::all() {
            assert!(back(cpu, &live) == back(cpu, &all), "{cpu:?} {rows} {inputs}");
            let (whole, apart) = (stepped(cpu, &all, &dy, &[]), stepped(cpu, &live, &of_live, &silent));
            let same = [(&whole.value, &apart.value), (&whole.mean, &apart.mean), (&whole.square, &apart.square)];
            assert!(same.iter().all(|(a, b)| a == b) && whole.target == apart.target, "{cpu:?} {rows} {inputs}");
            assert!(whole.value != lines || rows == 0, "a step from moments moves weights");
        }
    }
}

#[test]
fn bias_step_is_adam_on_the_sum_over_samples() {
    for rows in [1, 12, 24, 40] {
        let dy = numbers(3 * LANES * rows, 10);
        let panels: Vec<_> = (0..3).map(|p| panel(&dy[p * LANES * rows..][..LANES * rows])).collect();
        let panels: Vec<&[Line]> = panels.iter().map(|lines| &**lines).collect();
        let step = AdamStep::new(1, 0.01, 0.0);
        let run = |cpu: Cpu| {
            let mut bias = Learned::zeroed(lines_for(rows), false);
            cpu.run(BiasStep { panels: &panels, rows, bias: &mut bias, step });
            bias.mean
        };
        let results: Vec<_> = Cpu::all().into_iter().map(run).collect();
        for n in 0..rows {
            let of_panel = |p: usize| (0..LANES).map(move |s| p * LANES * rows + n * LANES + s);
            let expected: f64 = (0..3).flat_map(of_panel).map(|at| f64::from(dy[at])).sum();
            let got = f64::from(results[0][n / WIDTH].0[n % WIDTH]) / 0.1;
            assert!((got - expected).abs() < rounding(96), "{got} {expected}");
        }
        assert!(results.iter().all(|mean| mean == &results[0]));
    }
}

#[test]
fn turning_a_panel_there_and_back() {
    for cpu in Cpu::all() {
        let features = panel(&numbers(48 * LANES, 11));
        let mut samples = zeroed(features.len());
        cpu.run(ToSamples { features: &features, samples: &mut samples });
        for (f, s) in (0..48).flat_map(|f| (0..LANES).map(move |s| (f, s))) {
            let there = samples[f / WIDTH * LANES + s].0[f % WIDTH];
            assert_eq!(there, features[2 * f + s / WIDTH].0[s % WIDTH]);
        }
        let mut back = zeroed(features.len());
        cpu.run(ToFeatures { samples: &samples, features: &mut back });
        assert!(back == features);
    }
}

#[test]
fn a_nan_passes_rectifiers() {
    let x = panel(&[f32::NAN; LANES]);
    let lines = packed(&[1.0], 1, 1);
    for cpu in Cpu::all() {
        let mut y = zeroed(2);
        let weights = Weights { lines: &lines, bias: &zeroed(1), rows: 1, inputs: 1, step: 1 };
        cpu.run(Forward { weights, x: &x, y: &mut y, gates: Some(&mut [0]) });
        assert!(y[0].0[0].is_nan(), "{cpu:?}");
    }
}

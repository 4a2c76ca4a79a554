//! Recordings of rigs whose truth is known: made by the detailed model, with noise and converter steps on top.

#![allow(dead_code, unreachable_pub, missing_docs)] // Each suite uses its part.

pub mod two_chambers;

use diagnose::bench::Bench;
use diagnose::judge::{Judgement, judge};
use diagnose::search::candidate::Candidate;
use diagnose::search::{Found, SearchSettings, search};
use fit::data::Records;
use fit::parameters::set_value;
use fit::simulate::{Fidelity, Simulator};
use model::rig::Rig;
use proto::recording::Recording;
use proto::recording::csv::{Column, ColumnData};
use rand::{RngExt as _, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

pub const SIGMA_KPA: f64 = 0.08;
pub const STEP_KPA: f64 = 0.03;

pub fn column(name: &str, numbers: Vec<f64>) -> Column {
    Column { name: name.to_owned(), data: ColumnData::Numbers(numbers) }
}

pub fn recording(source: &str, duty: &[Vec<f64>; 2], pressures: [Vec<f64>; 2]) -> Recording {
    let time_s = (0..duty[0].len()).map(|k| k as f64 * 0.02).collect();
    Recording::new(source, time_s, columns_of(duty, pressures)).unwrap()
}

fn columns_of(duty: &[Vec<f64>; 2], [pos, neg]: [Vec<f64>; 2]) -> Vec<Column> {
    vec![
        column("u_pos", duty[0].clone()),
        column("u_neg", duty[1].clone()),
        column("p_pos_kpa", pos),
        column("p_neg_kpa", neg),
    ]
}

/// Random holds, some with ramps to them, and a slow triangle in the last third.
pub fn duties(rows: usize, random: &mut Pcg64Mcg) -> [Vec<f64>; 2] {
    [0, 1].map(|valve| {
        let mut duty: Vec<f64> = Vec::new();
        let mut level = 0.8;
        while duty.len() < rows * 2 / 3 {
            let next = 0.66 + 0.3 * random.random::<f64>();
            let hold = random.random_range(20..110);
            let ramp = if random.random::<f64>() < 0.4 { hold } else { 1 };
            duty.extend((0..hold).map(|k| level + ((k + 1) as f64 / f64::from(ramp)).min(1.0) * (next - level)));
            level = next;
        }
        while duty.len() < rows {
            let phase = duty.len() as f64 / (300.0 + 130.0 * f64::from(valve));
            duty.push(0.8 + 0.14 * (2.0 * (phase - phase.floor()) - 1.0).abs());
        }
        duty.truncate(rows);
        duty.iter().map(|u| (u * 1e5).round() * 1e-5).collect()
    })
}

/// Recordings of a rig, 30 s each, the first 4 s before them not recorded.
pub fn made(rig: &Rig, count: usize, seed: u64) -> Vec<Recording> {
    made_after(200, 1500, rig, count, seed)
}

/// Recording with this number of rows, after others that were not recorded.
pub fn made_after(before: usize, recorded: usize, rig: &Rig, count: usize, seed: u64) -> Vec<Recording> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    (0..count)
        .map(|number| {
            let duty = duties(recorded + before, &mut random);
            flown(&format!("run{number}.csv"), before, rig, &duty, None, &mut random)
        })
        .collect()
}

/// Recording of a rig under these commands, after the first rows; with the pump's relay where that is switched.
pub fn flown(
    source: &str,
    before: usize,
    rig: &Rig,
    duty: &[Vec<f64>; 2],
    pump_on: Option<&[f64]>,
    random: &mut Pcg64Mcg,
) -> Recording {
    let rows = duty[0].len();
    let with_relay = |duty: &[Vec<f64>; 2], pressures: [Vec<f64>; 2], from: usize| {
        let mut columns = columns_of(duty, pressures);
        columns.extend(pump_on.map(|on| column("pump_on", on[from..].to_vec())));
        Recording::new(source, (0..duty[0].len()).map(|k| k as f64 * 0.02).collect(), columns).unwrap()
    };
    let blank = with_relay(duty, [vec![0.0; rows], vec![0.0; rows]], 0);
    let records = Records::new(rig, &[blank]).unwrap();
    let simulator = Simulator::new(&records, Fidelity::Coarse);
    let trace = simulator.free(std::slice::from_ref(rig)).pop().unwrap().unwrap();
    let mut read = |channel: usize| -> Vec<f64> {
        trace[records.layout().channel(0, channel)][before..]
            .iter()
            .map(|p| {
                let white: f64 = StandardNormal.sample(random);
                ((p + SIGMA_KPA * white) / STEP_KPA).round() * STEP_KPA
            })
            .collect()
    };
    let pressures = [read(0), read(1)];
    let duty = [&duty[0], &duty[1]].map(|d| d[before..].to_vec());
    with_relay(&duty, pressures, before)
}

/// The paper's rig, and one whose parameters are off by these factors.
pub fn moved(factors: &[(&str, f64)]) -> (Rig, Rig) {
    let rig = Rig::builtin("dual_pressure").unwrap();
    let mut other = rig.clone();
    for (path, factor) in factors {
        let value = fit::parameters::value(&rig, path).unwrap();
        set_value(&mut other, path, value * factor).unwrap();
    }
    (rig, other)
}

pub fn bench<'r>(rig: &'r Rig, records: &'r Records) -> Bench<'r> {
    let all = vec![1.0; records.layout().len()];
    Bench::new(rig, records, &all, Fidelity::Averaged)
}

/// A search for two kinds of terms at most that follows one candidate to the end: enough where what is there stands out.
pub fn for_what_stands_out() -> SearchSettings {
    let whole = SearchSettings::whole(false);
    SearchSettings {
        most_kinds: 2,
        polished: 1,
        polished_of_much: 1,
        glanced: 4,
        paired: 1,
        from_prior: false,
        ..whole
    }
}

pub fn judged(bench: &Bench<'_>, candidates: &[Candidate]) -> (Found, Judgement) {
    let settings = for_what_stands_out();
    let given = bench.free_run(bench.rig).unwrap();
    let found = search(bench, candidates, &vec![0.0; bench.nominal.len()], &settings, &mut |_, _| ()).unwrap();
    let judgement = judge(bench, candidates, &found, &given, &mut |_, _| ()).unwrap();
    (found, judgement)
}

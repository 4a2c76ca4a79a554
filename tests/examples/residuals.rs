//! Residuals of the plausibility monitor on rigs that its model does not know, without and with a sensor that drifts.
//!
//! `residuals SECONDS fallback|policy KPA_PER_S CHANNEL RIGS [LAG_MS] [VOLUME] [MODEL]`: rigs are drawn around `bench`, the last two are
//! `bench` and `dual_pressure`; their sensors lag by `LAG_MS` and their chambers are `VOLUME` times as large. From 20 s on the
//! sensor of `CHANNEL` drifts by `KPA_PER_S` (0: not at all). `MODEL` is `nominal` or `exact`. A line for each rig and reference.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use controller::config::Safety;
use controller::cycle::Cycle;
use evaluate::rigs_around;
use model::rig::Rig;
use proto::emulator::SensorFault;
use proto::reference::Reference;
use supervisor::Arming;
use tests::lockstep::Flight;
use tests::strange_rigs::{with_sensor_lag, with_volumes};

/// Ticks after which the sensor begins to drift.
const FROM: u64 = 1_000;
/// Steps that the rigs drawn around `bench` can follow.
const STEPS: &str = "time_s,ref_pos_kpa,ref_neg_kpa\n0,85,-72\n5,85,-72\n5.02,60,-55\n9,60,-55\n9.02,100,-75\n13,100,-75\n13.02,90,-40\n\
    16,90,-40\n18,95,-75\n20,95,-75\n22,40,-30\n25,40,-30\n25.02,85,-72\n600,85,-72\n";

fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get((values.len().saturating_sub(1) as f64 * share) as usize).copied().unwrap_or(f64::NAN)
}

fn main() {
    let word = |n: usize, otherwise: &str| std::env::args().nth(n).unwrap_or_else(|| otherwise.to_owned());
    let number = |n: usize, otherwise: &str| word(n, otherwise).parse::<f64>().unwrap();
    let (seconds, drift, channel) = (number(1, "60"), number(3, "0"), number(4, "0") as usize);
    let nominal = Rig::builtin("dual_pressure").unwrap();
    let bench = Rig::builtin("bench").unwrap();
    let mut rigs = rigs_around::rigs_around(&bench, number(5, "8") as usize, 1).unwrap();
    rigs.extend([bench, nominal.clone()]);
    for (n, rig) in rigs.iter().enumerate() {
        let late = if number(6, "0") > 0.0 { with_sensor_lag(rig, number(6, "0")) } else { rig.clone() };
        let rig = if number(7, "1") == 1.0 { late } else { with_volumes(&late, number(7, "1")) };
        let model = if word(8, "nominal") == "exact" { &rig } else { &nominal };
        for (name, reference) in
            [("paper", Reference::paper()), ("steps", Reference::parse("steps", STEPS.as_bytes()).unwrap())]
        {
            let policy = (word(2, "fallback") == "policy").then(|| controller::daemon::shipped_policy().unwrap().0);
            let cycle = Cycle::new(model, policy, reference, Safety::default(), Arming::Automatic).unwrap();
            let mut flight = Flight::new(&rig, cycle, n as u64 + 1);
            let mut sums: [Vec<f64>; 4] = Default::default();
            let (mut from, mut moved, mut said) = (0.0, 0.0f64, Vec::new());
            for tick in 0..(seconds * 50.0) as u64 {
                if drift != 0.0 && tick >= FROM {
                    if tick == FROM {
                        from = flight.true_kpa()[channel];
                    }
                    flight.faults[channel] = vec![SensorFault::Offset(drift * 0.02 * (tick - FROM) as f64)];
                }
                let flown = flight.step();
                if said.len() < 6 {
                    said.extend(flown.told.iter().map(|notice| format!("tick {tick} {notice:?}")));
                }
                if flight.cycle.state().is_controlling() {
                    let [figures, _] = flight.cycle.monitor().figures_kpa();
                    for (place, values) in sums.iter_mut().enumerate() {
                        values.push(figures[place / 2][2 * (place % 2)].abs());
                    }
                    if drift != 0.0 && tick >= FROM {
                        moved = moved.max((flight.true_kpa()[channel] - from).abs());
                    }
                }
            }
            print!("{:18} {name}", rig.name);
            for (values, what) in sums.iter_mut().zip(["pos S5", "pos S25", "neg S5", "neg S25"]) {
                print!(" | {what} p99 {:.1} max {:.1}", quantile(values, 0.99), quantile(values, 1.0));
            }
            if drift != 0.0 {
                print!(" | moved {moved:.1} kPa");
            }
            println!(" | {said:?}");
        }
    }
}

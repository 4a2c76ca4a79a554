//! Residuals of the plausibility monitor on randomised rigs, without and with faults of a sensor.
//!
//! `residuals SECONDS fallback|policy FAULT CHANNEL RIGS`: FAULT 0 lists false trips and the scatter of the sums, 100 freezes the
//! sensor, anything else drifts it by so many kPa/s from 20 s on; `LIMIT=1000` in the environment takes the limits off.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]
use controller::config::Safety;
use controller::cycle::Cycle;
use evaluate::rigs_around;
use model::rig::Rig;
use proto::emulator::{Crio, EmulatedPlant, Sensors, rig_and_crio};
use proto::recording::TickRecord;
use proto::reference::Reference;
use proto::wire::{Command, Hello};

fn q(v: &[f64], p: f64) -> f64 {
    let mut v = v.to_vec();
    v.sort_by(f64::total_cmp);
    v[((v.len() - 1) as f64 * p) as usize]
}

fn main() {
    let seconds: u32 = std::env::args().nth(1).map_or(60, |s| s.parse().unwrap());
    let policy = std::env::args().nth(2).is_some_and(|p| p == "policy");
    let fault: f64 = std::env::args().nth(3).map_or(0.0, |s| s.parse().unwrap());
    let channel: usize = std::env::args().nth(4).map_or(0, |s| s.parse().unwrap());
    let count: usize = std::env::args().nth(5).map_or(8, |s| s.parse().unwrap());
    let nominal = Rig::builtin("dual_pressure").unwrap();
    let mut rigs = rigs_around::rigs_around(&Rig::builtin("bench").unwrap(), count, 1).unwrap();
    rigs.push(Rig::builtin("bench").unwrap());
    rigs.push(nominal.clone());
    let f = std::env::temp_dir().join("steps.csv");
    std::fs::write(&f, "time_s,ref_pos_kpa,ref_neg_kpa\n0,85,-72\n5,85,-72\n5.02,60,-55\n9,60,-55\n9.02,100,-75\n13,100,-75\n13.02,90,-40\n16,90,-40\n18,95,-75\n20,95,-75\n22,40,-30\n25,40,-30\n25.02,85,-72\n600,85,-72\n").unwrap();
    for (n, rig) in rigs.iter().enumerate() {
        for reference in 0..2 {
            let r = if reference == 0 { Reference::paper() } else { Reference::read(&f).unwrap() };
            let p = policy.then(|| controller::daemon::shipped_policy().unwrap().0);
            let mut cycle = Cycle::new(&nominal, p, r, Safety::default(), true).unwrap();
            let (mut plant, config) = rig_and_crio(rig).unwrap();
            let mut sensors = Sensors::new(config.scales, Sensors::ADC_NOISE_V_RMS, n as u64 + 1);
            let mut crio = Crio::new(config);
            crio.hello(&Hello::new(1, 0, 7, "x"), 1, 0).unwrap();
            cycle.session_opened();
            if let Some(limit) = std::env::var("LIMIT").ok().and_then(|l| l.parse::<f64>().ok()) {
                cycle.monitor_mut().set_limits(monitor::model_residual::Limits {
                    jump_kpa: if limit > 100.0 { limit } else { 10.0 },
                    short_kpa: [limit; 2],
                    long_kpa: [limit; 2],
                });
            }
            let mut figures: [[Vec<f64>; 4]; 2] = Default::default();
            let (mut off, mut from, mut worst) = (0.0, 0.0, 0.0f64);
            let mut ended = None;
            for tick in 0..seconds * 50 {
                let true_kpa = plant.pressures_gauge_kpa();
                if fault != 0.0 && tick >= 1000 {
                    if tick == 1000 {
                        from = true_kpa[channel];
                    }
                    if fault.abs() < 50.0 {
                        off += fault * 0.02;
                    }
                }
                let mut kpa = true_kpa;
                kpa[channel] += off;
                let stuck: &[proto::emulator::SensorFault] =
                    if fault >= 50.0 && tick >= 1000 { &[proto::emulator::SensorFault::Stuck] } else { &[] };
                let mut faults: [&[proto::emulator::SensorFault]; 2] = [&[], &[]];
                faults[channel] = stuck;
                let volts = sensors.sample(kpa, faults);
                let sense = crio.edge(volts, tick + 1, u64::from(tick) * 20_000_000).unwrap();
                let mut record = TickRecord::default();
                let mut told = Vec::new();
                cycle.observe(&sense, &mut record, &mut |n| told.push(n));
                cycle.predict(&mut record);
                let answer = cycle.decide(&mut record, &mut |n| told.push(n));
                if tick > 25 && !told.is_empty() && ended.is_none() {
                    ended = Some(format!("tick {tick} {:?}", told));
                    if fault == 0.0 {
                        println!("  !! {} ref{reference} tick {tick} {told:?}", rig.name);
                    }
                }
                if fault != 0.0 && tick >= 1000 {
                    let moved = (true_kpa[channel] - from).abs();
                    for level in [3.0, 5.0, 8.0, 11.0, 14.0] {
                        if moved >= level && worst < level {
                            let f = cycle.monitor().figures_kpa()[channel];
                            print!(" [{level}: tick {tick} S5 {:.1} S25 {:.1}]", f[0], f[2]);
                        }
                    }
                }
                if fault != 0.0 && tick >= 1000 && !told.iter().any(|_| false) && cycle.state().is_controlling() {
                    worst = worst.max((true_kpa[channel] - from).abs());
                }
                cycle.sent(tick + 2);
                cycle.settle();
                if cycle.state().is_controlling() && tick > 30 {
                    let now = cycle.monitor().figures_kpa();
                    for c in 0..2 {
                        for k in 0..4 {
                            figures[c][k].push(now[c][k].abs());
                        }
                    }
                }
                crio.command(&Command {
                    sequence: tick + 2,
                    clock_ns: 0,
                    session: 7,
                    tick,
                    duty: answer.duty.map(|u| u as f32),
                    mode: answer.mode,
                    ttl_ticks: 2,
                    digital_outputs: u8::from(answer.pump_on),
                })
                .ok();
                let a = crio.actuation();
                EmulatedPlant::tick(&mut plant, a.duty.map(f64::from), a.pump_on);
            }
            if fault != 0.0 {
                println!("{:18} ref{reference} moved {worst:.1} kPa: {ended:?}", rig.name);
                continue;
            }
            print!("{:18} ref{reference}", rig.name);
            #[allow(clippy::needless_range_loop)] // both channels, as everywhere
            for c in 0..2 {
                let f = &figures[c];
                if f[0].is_empty() {
                    continue;
                }
                print!(
                    " | S5 p99 {:.1} p99.9 {:.1} max {:.1} (limit {:.1}) S25 p50 {:.1} p99 {:.1} p99.9 {:.1} max {:.1} (limit {:.1})",
                    q(&f[0], 0.99),
                    q(&f[0], 0.999),
                    q(&f[0], 1.0),
                    q(&f[1], 0.0),
                    q(&f[2], 0.5),
                    q(&f[2], 0.99),
                    q(&f[2], 0.999),
                    q(&f[2], 1.0),
                    q(&f[3], 0.5)
                );
            }
            println!();
        }
    }
}

//! Many rigs at once against one at a time: the same bits, on every instruction set.

use std::sync::Arc;

use model::mechanism::{CommandDelay, Mechanism, candidates};
use model::plant::{InstructionSet, Plant, Simulated, Simulation};
use model::real::{Lanes, Real};
use model::rig::{MechanismInstance, Numbers as _, Pump, Rig};
use proptest::prelude::*;

const LANES: usize = 8;
const FEW: usize = 4;
const TICKS: usize = 8;

/// Draws of the test: a factor for each number of each lane's rig, then duties and relay by tick and lane.
type Draw = (Vec<Vec<f64>>, Vec<Vec<[f64; 3]>>);

/// Factors to draw from; [`perturb`] goes round.
const FACTORS: usize = 32;

fn draws() -> impl Strategy<Value = Draw> {
    let factors = prop::collection::vec(prop::collection::vec(0.9..1.1f64, FACTORS), LANES);
    // Duties at and beyond the limits as well, and now and then the pump off.
    let duty = || prop_oneof![4 => 0.0..1.0f64, 1 => Just(0.0), 1 => Just(1.0)];
    let inputs = (duty(), duty(), prop_oneof![5 => Just(1.0), 1 => Just(0.0)]).prop_map(|(p, n, on)| [p, n, on]);
    (factors, prop::collection::vec(prop::collection::vec(inputs, LANES), TICKS))
}

/// The rig with most of its numbers multiplied.
fn perturb(rig: &Rig, factors: &[f64], lane: usize) -> Rig {
    let mut rig = rig.clone();
    let mut factors = factors.iter().cycle();
    let mut by = |number: &mut f64| *number *= factors.next().unwrap();
    by(&mut rig.atmosphere.pressure_kpa_abs);
    by(&mut rig.atmosphere.temperature_k);
    by(&mut rig.gas.heat_capacity_ratio);
    for volume in rig.volumes.values_mut() {
        by(&mut volume.volume_l);
        by(&mut volume.temperature_k);
    }
    for pump in rig.pumps.values_mut() {
        let Pump::Piston(pump) = pump else { continue };
        by(&mut pump.speed_rpm);
        by(&mut pump.rod_length_mm);
        by(&mut pump.head_area_cm2);
        by(&mut pump.inlet_check_area_mm2);
        by(&mut pump.outlet_check_area_mm2);
    }
    for valve in rig.valves.values_mut() {
        by(&mut valve.input_area_mm2);
        by(&mut valve.spring_area_mm2);
        by(&mut valve.nozzle_diameter_mm);
    }
    for attached in &mut rig.mechanisms {
        if let Mechanism::CommandDelay(m) = &mut attached.mechanism {
            // None, a part, one tick, more: lanes whose delays need different ways through the code.
            m.delay_ms = [20.0, 0.0, 7.0, 40.0, 33.0][lane % 5];
            if lane > 4 {
                by(&mut m.delay_ms);
            }
            continue;
        }
        for index in 0..attached.mechanism.numbers().len() {
            by(attached.mechanism.number_mut(index).unwrap());
        }
        if let Mechanism::ValveHysteresis(m) = &mut attached.mechanism
            && lane % 3 == 1
        {
            // One play beside lanes with several.
            m.spread_duty = 0.0;
        }
    }
    rig
}

/// Everything that `candidates` knows and more, in few rigs: what goes together on one component.
fn everything() -> Vec<Rig> {
    let mut full = Rig::builtin("bench").unwrap();
    for candidate in candidates(&full) {
        // Thermal chambers are states, of which there are twelve; the next rig has them.
        let strong: Vec<f64> = candidate.parameters.iter().map(|p| *p.starts.last().unwrap()).collect();
        let next = candidate.on(&full, &strong);
        if next.check().is_ok() {
            full = next;
        }
    }
    full.name = "full".to_owned();
    let mut tabled = Rig::builtin("dual_pressure").unwrap();
    tabled.name = "tabled".to_owned();
    let text = format!(
        "{}{}",
        tabled.to_toml().unwrap(),
        r#"
[[mechanisms]]
id = "residual_flow"
component = "positive"
shape = "cubic"
flow_mg_per_s = [0.0, 10.0, -20.0, 5.0, 7.0, 30.0]
axes = [
    { variable = "pressure", of = "negative", knots = [-80.0, -40.0, 0.0] },
    { variable = "duty", of = "valve_pos", time_constant_ms = 80.0, departure = true, knots = [-0.1, 0.1] },
]
[[mechanisms]]
id = "residual_flow"
component = "valve_neg"
area_mm2 = [0.1, 0.0, 0.2]
axes = [{ variable = "difference", of = "valve_neg", time_constant_ms = 50.0, knots = [0.0, 30.0, 90.0] }]
[[mechanisms]]
id = "actuator_load"
component = "positive"
vacuum = "negative"
payload_kg = 5.0
[[mechanisms]]
id = "valve_hysteresis"
component = "valve_pos"
half_width_duty = 0.03
spread_duty = 0.02
"#
    );
    tabled = Rig::from_toml(&text).unwrap();
    vec![full, tabled]
}

/// The built-in rigs, and one whose delayed duty reaches the valve with no lag to smooth it.
fn rigs() -> Vec<Rig> {
    let mut rigs: Vec<Rig> = Rig::BUILTIN.iter().map(|name| Rig::builtin(name).unwrap()).collect();
    let mut delayed = Rig::builtin("dual_pressure").unwrap();
    delayed.name = "delayed".to_owned();
    for valve in ["valve_pos", "valve_neg"] {
        let delay = Mechanism::CommandDelay(CommandDelay { delay_ms: 20.0 });
        delayed.mechanisms.push(MechanismInstance { component: valve.to_owned(), enabled: true, mechanism: delay });
    }
    rigs.push(delayed);
    rigs.extend(everything());
    rigs
}

fn seen<R: Simulated>(simulation: &Simulation<R>, lane: usize) -> [u64; 4] {
    let [a, b] = [0, 1].map(|i| simulation.pressure_pa(i).lane(lane).to_bits());
    let [c, d] = [0, 1].map(|i| simulation.reading_kpa(i).lane(lane).to_bits());
    [a, b, c, d]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_lane_has_the_bits_of_a_single_run((factors, inputs) in draws()) {
        for rig in rigs() {
            let rigs: Vec<Rig> = factors.iter().enumerate().map(|(lane, f)| perturb(&rig, f, lane)).collect();
            let mut many = Simulation::new(Arc::new(Plant::<Lanes<LANES>>::side_by_side(&rigs).unwrap()));
            let mut few = Simulation::new(Arc::new(Plant::<Lanes<FEW>>::side_by_side(&rigs[..FEW]).unwrap()));
            let mut singles: Vec<_> =
                rigs.iter().map(|rig| Simulation::new(Arc::new(Plant::<f64>::new(rig).unwrap()))).collect();
            for (tick, row) in inputs.iter().enumerate() {
                many.tick(&[0, 1, 2].map(|i| Lanes::from_lanes(|lane| row[lane][i])));
                few.tick(&[0, 1, 2].map(|i| Lanes::from_lanes(|lane| row[lane][i])));
                for (lane, single) in singles.iter_mut().enumerate() {
                    single.tick(&row[lane]);
                    prop_assert_eq!(seen(&many, lane), seen(single, 0), "{}, tick {}, lane {}", rig.name, tick, lane);
                    if lane < FEW {
                        prop_assert_eq!(seen(&few, lane), seen(single, 0), "{}, tick {}, of four {}", rig.name, tick, lane);
                    }
                }
            }
        }
    }
}

#[test]
fn instruction_sets_give_the_same_bits() {
    if InstructionSet::detect() == InstructionSet::Baseline {
        println!("skipped: this machine has one instruction set only");
        return;
    }
    fn run<R: Simulated>(rig: &Rig, set: InstructionSet) -> Vec<[u64; 4]> {
        let mut simulation =
            Simulation::on(Arc::new(Plant::<R>::side_by_side(std::slice::from_ref(rig)).unwrap()), set);
        // Without fused multiply-add in hardware each one is a call, so a few ticks only.
        [0.0, 0.9, 0.7, 1.0]
            .into_iter()
            .map(|duty| {
                simulation.tick(&[R::splat(duty), R::splat(1.0 - duty), R::splat(1.0)]);
                seen(&simulation, R::LANES - 1)
            })
            .collect()
    }
    for rig in rigs() {
        let name = &rig.name;
        let fast = run::<f64>(&rig, InstructionSet::Avx2);
        assert_eq!(fast, run::<f64>(&rig, InstructionSet::Baseline), "{name}");
        assert_eq!(fast, run::<Lanes<LANES>>(&rig, InstructionSet::Avx2), "{name} in lanes");
        assert_eq!(fast, run::<Lanes<LANES>>(&rig, InstructionSet::Baseline), "{name} in lanes");
        assert_eq!(fast, run::<Lanes<FEW>>(&rig, InstructionSet::Avx2), "{name} in few lanes");
        assert_eq!(fast, run::<Lanes<FEW>>(&rig, InstructionSet::Baseline), "{name} in few lanes");
    }
}

//! The steady map against simulations.

use super::*;

/// The full simulation, left alone for 40 s, settles where the map says.
#[test]
fn settled_pressures_agree_with_the_simulation() {
    let rig = Rig::builtin("dual_pressure").unwrap();
    let map = SteadyMap::new(&rig).unwrap();
    for duty in [[0.6, 0.7], [0.8, 0.8], [1.0, 0.9]] {
        let mut plant = crate::predict::DualPressureRig::new(&rig).unwrap();
        for _ in 0..2000 {
            plant.tick(duty, true);
        }
        let (settled, simulated) = (map.settled_kpa(duty).unwrap(), plant.readings_kpa());
        for c in 0..CHANNELS {
            // The map gives the mean over a revolution, a reading the instant at top dead centre; the
            // ripple is 0.53 kPa (positive) and 0.76 kPa (negative) from peak to peak.
            assert!((settled[c] - simulated[c]).abs() < 0.45, "{duty:?}: {settled:?} against {simulated:?}");
        }
    }
}

/// With the pump a little slower readings go through all crank angles, 0.33 times a second: their mean is what the map
/// gives, without the ripple. A feed-forward that is off by a tenth of a kPa shows in every reversal.
#[test]
fn mean_pressures_agree_with_the_simulation() {
    let mut rig = Rig::builtin("dual_pressure").unwrap();
    for pump in rig.pumps.values_mut() {
        if let crate::rig::Pump::Piston(pump) = pump {
            pump.speed_rpm = 2990.0;
        }
    }
    let map = SteadyMap::new(&rig).unwrap();
    for duty in [[0.6, 0.7], [0.8, 0.8], [1.0, 0.9]] {
        let mut plant = crate::predict::DualPressureRig::new(&rig).unwrap();
        let mut sums = [0.0; CHANNELS];
        for tick in 0..2300 {
            plant.tick(duty, true);
            if tick >= 2000 {
                for (sum, kpa) in sums.iter_mut().zip(plant.readings_kpa()) {
                    *sum += kpa / 300.0;
                }
            }
        }
        let settled = map.settled_kpa(duty).unwrap();
        for c in 0..CHANNELS {
            assert!((settled[c] - sums[c]).abs() < 0.02, "{duty:?}: {settled:?} against {sums:?}");
        }
    }
}

/// Gas that warms and cools: under the duties that the energy balance asks for, with temperatures moved along, the
/// simulation of the rig follows a swinging reference; under the isothermal ones it does not.
#[test]
fn warm_gas_is_in_the_feed_forward() {
    let mut rig = Rig::builtin("bench").unwrap();
    rig.mechanisms.retain(|m| matches!(m.mechanism, Mechanism::ChamberThermal(_)));
    let map = SteadyMap::new(&rig).unwrap();
    let reference = |t: f64| {
        let (s, c) = (std::f64::consts::TAU * t / 8.0).sin_cos();
        ([90.0 + 6.0 * s, -72.0], [6.0 * c * std::f64::consts::TAU / 8.0, 0.0])
    };
    let off = |warm: bool| {
        let mut plant = crate::predict::DualPressureRig::new(&rig).unwrap();
        plant.start_from([90.0, -72.0], map.duty_for([90.0, -72.0], [0.0; CHANNELS]));
        let (mut gas_k, mut worst) = (map.wall_k(), 0.0_f64);
        // Held first, with the little feedback that keeps both in place, until gas and walls have settled.
        for tick in 0..1400 {
            let t = f64::from(tick) * 0.02 - 12.0;
            let (p, rate) = if t < 0.0 { ([90.0, -72.0], [0.0; CHANNELS]) } else { reference(t + 0.01) };
            let duty = if warm { map.warm_duty_for(p, rate, gas_k) } else { map.duty_for(p, rate) };
            gas_k = map.warmed_k(p, rate, gas_k, 0.02);
            let (here, gain) = (plant.readings_kpa(), map.gain_kpa_per_s(p));
            let goal = if t < 0.0 { p } else { reference(t).0 };
            let duty = std::array::from_fn(|c| duty[c] + (goal[c] - here[c]) / gain[c]);
            plant.tick(duty, true);
            if t > 8.0 {
                worst = worst.max((goal[0] - here[0]).abs());
            }
        }
        worst
    };
    let (warm, cold) = (off(true), off(false));
    // What is left is the ripple's standing part, 0.25 kPa at most, which the map averages over.
    assert!(warm < 0.3 && cold > 2.0 * warm, "warm {warm}, cold {cold}");
}

#[test]
fn warm_duty_for_inverts_warm_rate() {
    let map = SteadyMap::new(&Rig::builtin("bench").unwrap()).unwrap();
    let (p, rates, gas_k) = ([90.0, -72.0], [4.0, -1.5], [305.0, 293.15]);
    let again = map.warm_rate_kpa_per_s(p, map.warm_duty_for(p, rates, gas_k), gas_k);
    for c in 0..CHANNELS {
        assert!((again[c] - rates[c]).abs() < 1e-9, "{again:?} against {rates:?}");
    }
}

/// Cylinders that are a part of the chambers: under the duties asked for, the simulation follows a swinging reference without
/// feedback to within what the ripple does; without their share the negative pressure swings by several times that.
#[test]
fn cylinders_follow_moving_pressures() {
    let rig = Rig::builtin("dual_pressure").unwrap();
    let map = SteadyMap::new(&rig).unwrap();
    let followed = map.pump.followed([90.0, -72.0]);
    let chamber = map.chambers[1].at(map.atmosphere_pa - 72.0e3);
    println!("{followed:?} beside {chamber}");
    let mut chambers_alone = map.clone();
    chambers_alone.pump.followed.iter_mut().for_each(|e| *e = [[0.0; CHANNELS]; CHANNELS]);
    let swing = |map: &SteadyMap| {
        let mut plant = crate::predict::DualPressureRig::new(&rig).unwrap();
        plant.start_from([90.0, -72.0], map.duty_for([90.0, -72.0], [0.0; CHANNELS]));
        let at = |t: f64| -72.0 + 2.0 * (std::f64::consts::TAU * t / 4.0).sin();
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for tick in 0..1000 {
            let t = f64::from(tick) * 0.02;
            let rate = (at(t + 0.02) - at(t)) / 0.02;
            plant.tick(map.duty_for([90.0, at(t + 0.01)], [0.0, rate]), true);
            let error = plant.readings_kpa()[1] - at(t + 0.02);
            if t > 12.0 {
                (low, high) = (low.min(error), high.max(error));
            }
        }
        high - low
    };
    let (with, without) = (swing(&map), swing(&chambers_alone));
    println!("{with} with, {without} without");
    assert!(with < 0.35 * without, "{with} with, {without} without");
}

/// Duties to send exceed those that act by what the supply loses of them.
#[test]
fn duties_for_a_sagging_supply_are_those_of_the_simulation() {
    let sag = "[[mechanisms]]\nid = \"supply_sag\"\ncomponent = \"rig\"\nloss_per_duty = 0.06\n";
    let rig = Rig::from_toml(&format!("{}\n{sag}", crate::rig::DUAL_PRESSURE)).unwrap();
    let [sagging, firm] = [&rig, &Rig::builtin("dual_pressure").unwrap()].map(|rig| SteadyMap::new(rig).unwrap());
    let p = [90.0, -72.0];
    let (sent, acting) = (sagging.duty_for(p, [0.0; CHANNELS]), firm.duty_for(p, [0.0; CHANNELS]));
    let left = 1.0 - 0.06 * (sent[0] + sent[1]);
    for c in 0..CHANNELS {
        assert!((sent[c] * left - acting[c]).abs() < 1e-9, "{sent:?} for {acting:?}");
    }
    // The simulation, which has the mechanism in its own way, stays where it is held.
    let mut plant = crate::predict::DualPressureRig::new(&rig).unwrap();
    plant.start_from(p, sent);
    (0..500).for_each(|_| plant.tick(sent, true));
    let held = plant.readings_kpa();
    // As far as an averaged map and a ripple are apart (`settled_pressures_agree_with_the_simulation`).
    assert!((held[0] - p[0]).abs() < 1.0 && (held[1] - p[1]).abs() < 0.5, "{held:?}");
}

/// The gain of a duty more at a valve is less by what the supply loses to it.
#[test]
fn the_gain_of_a_sent_duty_is_the_slope_of_the_rate() {
    let sag = "[[mechanisms]]\nid = \"supply_sag\"\ncomponent = \"rig\"\nloss_per_duty = 0.06\n";
    for further in ["", sag] {
        let rig = Rig::from_toml(&format!("{}\n{further}", crate::rig::DUAL_PRESSURE)).unwrap();
        let map = SteadyMap::new(&rig).unwrap();
        for p in [[90.0, -72.0], [100.0, -75.0]] {
            let (sent, by) = (map.duty_for(p, [0.0; CHANNELS]), 1e-4);
            let gain = map.sent_gain_kpa_per_s(p, sent);
            for c in 0..CHANNELS {
                let rate = |by: f64| {
                    let mut moved = sent;
                    moved[c] += by;
                    map.rate_kpa_per_s(p, moved)[c]
                };
                let slope = (rate(by) - rate(-by)) / (2.0 * by);
                // What the other valve loses reaches this chamber through the cylinders, 0.3 %; without the supply's slope it
                // would be 17 to 20 %.
                assert!((gain[c] / slope - 1.0).abs() < 0.01, "{p:?}: {gain:?} against {slope} of {c}");
            }
        }
    }
}

#[test]
fn duty_for_inverts_rate() {
    let map = SteadyMap::new(&Rig::builtin("dual_pressure").unwrap()).unwrap();
    for (p, rates) in [([90.0, -72.0], [0.0, 0.0]), ([100.0, -75.0], [5.0, -2.0]), ([80.0, -70.0], [-5.0, 2.0])] {
        let duty = map.duty_for(p, rates);
        let again = map.rate_kpa_per_s(p, duty);
        for c in 0..CHANNELS {
            assert!((again[c] - rates[c]).abs() < 1e-9, "{again:?} against {rates:?}");
        }
    }
}

/// Gas that the pump warms, valves whose play keeps them from opening to the end, and sensors that are off: the rig comes to rest
/// where its simulation does.
#[test]
fn a_rig_rests_where_its_simulation_does() {
    let mut rig = Rig::builtin("bench").unwrap();
    let name = rig.sensor_of(DualPressurePorts::READING[0]).unwrap().0.to_owned();
    rig.mechanisms.retain(|m| m.component != name);
    let bias = crate::mechanism::SensorBias { bias_kpa: 2.0 };
    rig.mechanisms.push(crate::rig::MechanismInstance {
        component: name,
        enabled: true,
        mechanism: Mechanism::SensorBias(bias),
    });
    let map = SteadyMap::new(&rig).unwrap();
    let open = [1.0; CHANNELS];
    let mut plant = crate::predict::DualPressureRig::new(&rig).unwrap();
    for _ in 0..2000 {
        plant.tick(open, true);
    }
    let (rests, simulated) = (map.readings_kpa(map.rests_at_kpa(open).unwrap()), plant.readings_kpa());
    for c in 0..CHANNELS {
        // Half of the ripple, as above; without the play it would be 1.6 and 1.5 kPa.
        assert!((rests[c] - simulated[c]).abs() < 0.45, "{rests:?} against {simulated:?}");
    }
}

/// Pressures that duties can hold are held; where none does, the valve that cannot is at its end.
#[test]
fn wanted_pressures_are_held_as_far_as_valves_can() {
    let map = SteadyMap::new(&Rig::builtin("dual_pressure").unwrap()).unwrap();
    let open = map.rests_at_kpa([1.0; CHANNELS]).unwrap();
    let near = |a: Pair, b: Pair| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 0.01);
    for held in [[90.0, -70.0], [150.0, -90.0], [40.0, -90.0]] {
        assert!(map.duty_for(held, [0.0; CHANNELS]).iter().all(|duty| (0.0..=1.0).contains(duty)), "{held:?}");
        let found = map.nearest_held_kpa(held).unwrap();
        assert!(near(found, held), "{held:?}: {found:?}");
    }
    assert!(near(map.nearest_held_kpa([20.0, -20.0]).unwrap(), open), "both too low: both wide open");
    // One too low: it stands where its valve is wide open and the other still holds.
    let [positive, negative] = map.nearest_held_kpa([12.0, -70.0]).unwrap();
    let duty = map.duty_for([positive, negative], [0.0; CHANNELS]);
    assert!((negative + 70.0).abs() < 0.01 && (duty[0] - 1.0).abs() < 1e-3, "{positive}/{negative}: {duty:?}");
    // Shut, a chamber goes as far as the pump goes: for this one to the edge of the map. What no pump brings about is not held,
    // although no duty is needed to keep it.
    assert_eq!(map.rests_at_kpa([0.0, 1.0]).unwrap()[0], 170.0);
    let mut weak = Rig::builtin("dual_pressure").unwrap();
    for pump in weak.pumps.values_mut() {
        if let crate::rig::Pump::Piston(pump) = pump {
            pump.effective_length_mm += 12.0;
        }
    }
    let weak = SteadyMap::new(&weak).unwrap();
    let deep = [60.0, -95.0];
    assert!(weak.duty_for(deep, [0.0; CHANNELS]).iter().all(|duty| (0.0..=1.0).contains(duty)));
    let kept = weak.nearest_held_kpa(deep).unwrap();
    assert!((-70.0..-60.0).contains(&kept[1]), "{kept:?}");
}

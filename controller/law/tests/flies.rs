//! The fallback in closed loop on the plants it was built for, with the converter's noise, against the
//! limits that the project set for it.

#![allow(clippy::unwrap_used)] // a test's own set-up; clippy knows tests only by their attribute

use std::sync::Arc;

use law::{ControlInput, Fallback, FallbackSettings, SoftStart, TICK_S};
use model::observation::{CHANNELS, Pair};
use model::predict::DualPressureRig;
use model::rig::Rig;
use model::steady::SteadyMap;
use proto::emulator::{PSE540A_R06, PSE541A_R06, Sensors};
use proto::reference::Reference;

/// RMSE of the measured pressures after `skip_s`, in kPa.
fn rmse(rig: &str, reference: &Reference, seconds: f64, skip_s: f64, seed: u64) -> Pair {
    let map = Arc::new(SteadyMap::new(&Rig::builtin("dual_pressure").unwrap()).unwrap());
    let mut plant = DualPressureRig::new(&Rig::builtin(rig).unwrap()).unwrap();
    let scales = [PSE540A_R06, PSE541A_R06];
    let mut sensors = Sensors::new(scales, Sensors::ADC_NOISE_V_RMS, seed);
    let mut law = Fallback::new(map, FallbackSettings::default());
    let mut approach = None;
    let (mut squares, mut count) = ([0.0; CHANNELS], 0.0);
    for tick in 0..(seconds / TICK_S) as usize {
        let volts = sensors.sample(plant.readings_kpa(), [&[], &[]]);
        let measured_kpa: Pair = std::array::from_fn(|c| scales[c].gauge_kpa(f64::from(volts[c])));
        let approach = *approach.get_or_insert_with(|| SoftStart::new(measured_kpa, reference.at(0.0)));
        let goals_kpa = std::array::from_fn(|j| {
            let time_s = (tick + j) as f64 * TICK_S;
            let (goal, offset) = (reference.at(time_s), approach.offset_kpa(time_s));
            std::array::from_fn(|c| goal[c] + offset[c])
        });
        let decision = law.decide(&ControlInput { measured_kpa, goals_kpa });
        law.applied(decision.duty());
        let time_s = tick as f64 * TICK_S;
        if time_s >= skip_s {
            let goal = reference.at(time_s);
            for c in 0..CHANNELS {
                squares[c] += (measured_kpa[c] - goal[c]).powi(2);
            }
            count += 1.0;
        }
        plant.tick(decision.duty(), true);
    }
    squares.map(|s: f64| (s / count).sqrt())
}

#[test]
fn tracks_the_papers_reference() {
    for seed in 1..=3 {
        let ideal = rmse("dual_pressure", &Reference::paper(), 60.0, 5.0, seed);
        let bench = rmse("bench", &Reference::paper(), 60.0, 5.0, seed);
        println!("seed {seed}: dual_pressure {ideal:.3?}, bench {bench:.3?} kPa");
        assert!(ideal[0] < 0.20 && ideal[1] < 0.15, "dual_pressure: {ideal:?}");
        assert!(bench[0] < 0.60 && bench[1] < 0.25, "bench: {bench:?}");
    }
}

/// Play and integral action may hunt; at rest nothing but the converter's noise (0.06 and 0.006 kPa) may be left.
#[test]
fn holds_without_a_limit_cycle() {
    for at in [[80.0, -70.0], [90.0, -72.0], [105.0, -76.0], [75.0, -70.0]] {
        let rest = rmse("bench", &Reference::constant(at[0], at[1]), 60.0, 40.0, 1);
        println!("holding {at:?}: {rest:.3?} kPa");
        assert!(rest[0] < 0.15 && rest[1] < 0.05, "holding {at:?}: {rest:?}");
    }
}

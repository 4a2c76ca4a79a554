//! Effects on and off: each changes what it should, more when it is stronger, and in its own way.

#![allow(clippy::unwrap_used)] // a test that cannot go on should say where

use hidden_rig::actuation::{Actuation, ActuationMemory, MagneticHysteresis};
use hidden_rig::build_sheet::BuildSheet;
use hidden_rig::effects::{Effect, Kind, Place, chambers, drive, sensing, vents};
use hidden_rig::rng::Draws;
use hidden_rig::run::{Precision, Rig, Run, TICKS_PER_S};
use hidden_rig::sizing::{Trace, difference, larger, rms, trace};
use hidden_rig::state::{CRANK, CURRENT};

/// Steps and holds of both valves within their open range (5 s).
fn holds() -> Vec<[f64; 2]> {
    (0..250).map(|k| [[0.72, 0.95, 0.80, 0.90][k / 40 % 4], [0.92, 0.68, 0.80][k / 55 % 3]]).collect()
}

fn with(effect: &Effect, place: Place) -> Rig {
    let mut rig = BuildSheet::paper().rig();
    effect.install(place, &mut rig);
    rig
}

fn quick(rig: &Rig) -> Trace {
    trace(rig, &holds(), Precision::Coarse)
}

/// Every kind, in every place: at a tenth of its range from the top it moves the pressures by more than the noise, at
/// the bottom hardly, and it survives its strongest.
#[test]
fn every_effect_shows_when_strong_and_vanishes_when_weak() {
    let nominal = quick(&BuildSheet::paper().rig());
    for kind in Kind::ALL {
        let mut effect = kind.draw(&mut Draws::new(9));
        if let Effect::VolumeChange(change) = &mut effect {
            change.time_s = Some(1.0);
        }
        let (low, high) = kind.strengths();
        let size = |strength: f64, place: Place| {
            let trace = quick(&with(&effect.at_strength(strength), place));
            assert!(trace.iter().flatten().all(|kpa| kpa.is_finite() && *kpa > -101.4 && *kpa < 500.0));
            larger(rms(&difference(&trace, &nominal)))
        };
        let strong: Vec<f64> = kind.places().iter().map(|place| size(high, *place)).collect();
        assert!(strong.iter().all(|strong| *strong > 0.1), "{}: {strong:?}", kind.name());
        let weak = size(low, kind.places()[0]);
        if kind.sized_by_strength() {
            // A motor that is off makes the ripple beat by 0.3 kPa, be it off by much or little.
            assert!(weak < 0.6, "{}: {weak}", kind.name());
        } else {
            // A snubber of a millisecond smooths the ripple that the readings of a steady crank stand on: 0.33 kPa.
            let least = if *kind == Kind::SensorLag { 0.4 } else { 0.13 };
            assert!(weak < least && weak < strong[0], "{}: {weak} {strong:?}", kind.name());
        }
    }
}

/// Largest split between the rising and the falling branch of a triangle between 0.6 and 0.9 with this period.
fn split(period_s: f64, mut follow: impl FnMut(f64) -> f64) -> f64 {
    let ticks = (period_s * TICKS_PER_S) as usize;
    let duty = |k: usize| 0.6 + 0.3 * (1.0 - (2.0 * (k % ticks) as f64 / ticks as f64 - 1.0).abs());
    let mut mean = [0.0; 2];
    for k in 0..3 * ticks {
        let value = follow(duty(k));
        // The middle of the last turn's branches.
        if k >= 2 * ticks && (duty(k) - 0.75).abs() < 0.03 {
            mean[usize::from(2 * (k % ticks) > ticks)] += value - duty(k);
        }
    }
    let rows = 0.2 * ticks as f64 / 2.0;
    (mean[1] - mean[0]) / rows
}

/// Hysteresis does not know how fast it goes; a lag knows nothing else.
#[test]
fn hysteresis_is_rate_independent_and_lag_is_not() {
    let relays = |period_s: f64| {
        let actuation = Actuation {
            hysteresis: [Some(MagneticHysteresis { half_width: 0.03, spread: 0.5 }), None],
            ..Actuation::default()
        };
        let mut memory = ActuationMemory::new(&actuation, [0.6, 0.8]);
        split(period_s, |duty| {
            memory.command(0, duty);
            memory.currents(&actuation, 0.0)[0]
        })
    };
    let (slow, fast) = (relays(40.0), relays(4.0));
    assert!((slow / 0.06 - 1.0).abs() < 0.02, "{slow}");
    // The tick's grid moves the turning points by up to 0.003 of duty at the fast rate.
    assert!((fast / slow - 1.0).abs() < 0.05, "{fast} {slow}");

    let lag = |period_s: f64| {
        let effect = Effect::ValveLag(drive::Lag { time_constant_s: 0.08, fall_over_rise: 1.0 });
        let rig = with(&effect, Place::Positive);
        let mut run = Run::from_rest(&rig, [0.6, 0.8], Precision::Coarse);
        split(period_s, |duty| {
            run.tick([duty, 0.8], true);
            run.state()[CURRENT]
        })
    };
    let (slow, fast) = (lag(16.0), lag(4.0));
    // A first-order lag trails a ramp by its time constant: a split of 2 τ times the slope, less the tick's hold.
    assert!((fast / slow / 4.0 - 1.0).abs() < 0.05, "{fast} {slow}");
}

/// Effects that sit in a sensor move no air: the chambers and the other channel know nothing of it.
#[test]
fn sensor_effects_leave_the_air_alone_and_valve_effects_do_not() {
    let nominal = quick(&BuildSheet::paper().rig());
    let sensor = Effect::SensorLag(sensing::Lag { time_constant_s: 0.2 });
    let change = rms(&difference(&quick(&with(&sensor, Place::Negative)), &nominal));
    assert!(change[1] > 0.5 && change[0] < 1e-9, "{change:?}");
    let valve = Effect::ValveLag(drive::Lag { time_constant_s: 0.2, fall_over_rise: 1.0 });
    let change = rms(&difference(&quick(&with(&valve, Place::Negative)), &nominal));
    assert!(change[1] > 0.5 && change[0] > 0.5, "through the pump: {change:?}");
}

#[test]
fn bias_and_gain_are_what_they_say() {
    let nominal = quick(&BuildSheet::paper().rig());
    let bias = quick(&with(&Effect::SensorBias(sensing::Bias { size_kpa: 1.5, sign: -1.0 }), Place::Positive));
    let gain = quick(&with(&Effect::SensorGain(sensing::Gain { relative: 0.02, sign: 1.0 }), Place::Negative));
    for ((row, bias), gain) in nominal.iter().zip(&bias).zip(&gain) {
        assert!((bias[0] - row[0] + 1.5).abs() < 1e-9 && bias[1] == row[1]);
        assert!((gain[1] - 1.02 * row[1]).abs() < 1e-9 && gain[0] == row[0]);
    }
}

/// Shut in with the pump off, a sound rig holds its pressure and a leaking one loses it by the laminar law:
/// d p/dt = −k R T/V (p² − p_a²), so p = p_a coth(…) in closed form.
#[test]
fn a_shut_in_tells_a_leak() {
    let shut_in = |rig: &Rig| {
        let mut run = Run::settled(rig, [0.8, 0.8], Precision::Fine);
        for _ in 0..50 {
            run.tick([0.0, 0.0], false);
        }
        let first = run.clean_kpa();
        for _ in 0..500 {
            run.tick([0.0, 0.0], false);
        }
        // The piston that stopped near the head stays joined to the chamber through its outlet: some millilitres.
        let volumes = rig.plant.pump.swept(run.state()[CRANK]).volume_m3;
        ([first, run.clean_kpa()], volumes[0].min(volumes[1]))
    };
    let ([first, last], _) = shut_in(&BuildSheet::paper().rig());
    assert!((last[0] - first[0]).abs() < 0.01 && (last[1] - first[1]).abs() < 0.01, "{first:?} {last:?}");

    let area_m2 = 1e-7;
    let leak = Effect::ChamberLeak(chambers::ToAtmosphere { area_m2, law: chambers::LeakLaw::Laminar });
    let ([first, last], joined_m3) = shut_in(&with(&leak, Place::Positive));
    let air = 101_325.0;
    let volume_m3 = 0.75e-3 + joined_m3 * 293.15 / 323.15;
    let rate = chambers::laminar_like(area_m2) * 287.05 * 293.15 / volume_m3;
    let start = 1e3 * first[0] + air;
    let phase = ((start + air) / (start - air)).ln() / 2.0 + rate * air * 10.0;
    let expected = air / phase.tanh();
    assert!(first[0] - last[0] > 10.0, "{first:?} {last:?}");
    // A thousandth of the fall: the air cools by some millikelvins while it expands.
    assert!((1e3 * last[0] + air - expected).abs() < first[0] - last[0], "{last:?} against {expected}");
    assert!((last[1] - first[1]).abs() < 0.01);
}

/// While the negative valve chokes, its critical ratio is nobody's business.
#[test]
fn a_critical_ratio_below_the_working_range_is_invisible() {
    let nominal = quick(&BuildSheet::paper().rig());
    let ratio = Effect::CriticalRatio(vents::Ratio { critical_ratio: 0.45 });
    assert!(larger(rms(&difference(&quick(&with(&ratio, Place::Negative)), &nominal))) < 1e-3);
    assert!(rms(&difference(&quick(&with(&ratio, Place::Positive)), &nominal))[0] > 0.1);
}

/// A delay shifts the answer: by four ticks, a rig delayed by 80 ms answers as a prompt one did.
#[test]
fn a_delay_is_a_shift_in_time() {
    let delayed = with(&Effect::CommandDelay(drive::Delay { delay_s: 0.08 }), Place::Both);
    let prompt = quick(&BuildSheet::paper().rig());
    let late = quick(&delayed);
    let shifted = difference(&late[4..], &prompt[..prompt.len() - 4]);
    assert!(larger(rms(&shifted)) < 0.01, "{:?}", rms(&shifted));
}

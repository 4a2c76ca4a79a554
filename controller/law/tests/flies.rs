//! The fallback in closed loop on the plants it was built for, with the converter's noise, against the
//! limits that the project set for it.

#![allow(clippy::unwrap_used)] // a test's own set-up; clippy knows tests only by their attribute

use std::sync::Arc;

use law::{ControlInput, Fallback, FallbackSettings, Repetition, SoftStart, TICK_S};
use model::observation::{CHANNELS, GOALS_AHEAD, MOST_CHANGE_DUTY, Pair};
use model::predict::DualPressureRig;
use model::rig::Rig;
use model::steady::SteadyMap;
use proto::emulator::{PSE540A_R06, PSE541A_R06, Sensors};
use proto::reference::Reference;

/// RMSE of the measured pressures after `skip_s`, in kPa.
fn rmse(rig: &str, reference: &Reference, seconds: f64, skip_s: f64, seed: u64) -> Pair {
    let nominal = SteadyMap::new(&Rig::builtin("dual_pressure").unwrap()).unwrap();
    let mut law = Fallback::new(Arc::new(nominal), FallbackSettings::default());
    flown(&Rig::builtin(rig).unwrap(), &mut law, reference, [seconds, skip_s], seed)
}

/// Errors of a law that may have flown before.
fn flown(rig: &Rig, law: &mut Fallback, reference: &Reference, seconds: [f64; 2], seed: u64) -> Pair {
    flown_again(rig, (law, None), reference, seconds, seed)
}

/// Errors with what earlier flights have taught.
fn flown_again(
    rig: &Rig,
    (law, mut repetition): (&mut Fallback, Option<&mut Repetition>),
    reference: &Reference,
    [seconds, skip_s]: [f64; 2],
    seed: u64,
) -> Pair {
    let mut plant = DualPressureRig::new(rig).unwrap();
    let scales = [PSE540A_R06, PSE541A_R06];
    let mut sensors = Sensors::new(scales, Sensors::ADC_NOISE_V_RMS, seed);
    law.restart();
    if let Some(repetition) = &mut repetition {
        repetition.begin(None);
    }
    let mut approach = None;
    let mut duty = [1.0; CHANNELS];
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
        let learned_duty = repetition.as_ref().and_then(|repetition| repetition.learned());
        let decision = law.decide(&ControlInput { learned_duty, ..ControlInput::of_measured(measured_kpa, goals_kpa) });
        if let Some(repetition) = &mut repetition {
            repetition.follow(&law.left());
        }
        // What stands behind every law limits how fast a command changes.
        let asked = decision.duty();
        duty = std::array::from_fn(|c| asked[c].clamp(duty[c] - MOST_CHANGE_DUTY, duty[c] + MOST_CHANGE_DUTY));
        law.applied(duty);
        let time_s = tick as f64 * TICK_S;
        if time_s >= skip_s {
            let goal = reference.at(time_s);
            for c in 0..CHANNELS {
                squares[c] += (measured_kpa[c] - goal[c]).powi(2);
            }
            count += 1.0;
        }
        plant.tick(duty, true);
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

/// Near the goal the integral moves on as fast as the proportional action bears: in `T_i` at a constant error it grows by the
/// proportional part, and by the paper's share, 0.01 duty/(kPa s). Far from it there is the paper's share alone.
#[test]
fn near_the_goal_the_integral_grows_by_the_proportional_part_in_a_reset_time() {
    let nominal = Arc::new(SteadyMap::new(&Rig::builtin("dual_pressure").unwrap()).unwrap());
    let settings = FallbackSettings::default();
    let ticks = (settings.reset_time_s / TICK_S).round() as usize;
    for (error_kpa, is_near) in [(0.3, true), (-0.3, true), (2.0, false)] {
        let mut law = Fallback::new(Arc::clone(&nominal), settings);
        let now = ControlInput::of_measured([90.0 - error_kpa, -72.0], [[90.0, -72.0]; GOALS_AHEAD + 1]);
        for _ in 0..ticks {
            let decision = law.decide(&now);
            law.applied(decision.duty());
        }
        let terms = law.decide(&now).parts[0];
        // The vent of the positive chamber closes where pressure is missing.
        let papers = -0.01 * error_kpa * settings.reset_time_s;
        let expected = papers + if is_near { terms.proportional } else { 0.0 };
        assert!((terms.integral - expected).abs() < 1e-9, "{error_kpa} kPa: {terms:?}");
    }
}

/// Feedback is sent and not what acts: under a supply that sags it has to be more, to move the pressure by as much.
#[test]
fn feedback_moves_the_pressure_at_its_bandwidth_whatever_the_supply_loses() {
    let sag = "[[mechanisms]]\nid = \"supply_sag\"\ncomponent = \"rig\"\nloss_per_duty = 0.06\n";
    let nominal = Rig::builtin_text("dual_pressure").unwrap();
    for further in ["", sag] {
        let map = Arc::new(SteadyMap::new(&Rig::from_toml(&format!("{nominal}\n{further}")).unwrap()).unwrap());
        let (goal, error_kpa) = ([90.0, -72.0], 0.05);
        let sent = map.duty_for(goal, [0.0; CHANNELS]);
        for c in 0..CHANNELS {
            let mut measured = goal;
            measured[c] -= error_kpa;
            let mut law = Fallback::new(Arc::clone(&map), FallbackSettings::default());
            let decision = law.decide(&ControlInput::of_measured(measured, [goal; GOALS_AHEAD + 1]));
            let mut moved = sent;
            moved[c] += decision.parts[c].proportional;
            let rate = map.rate_kpa_per_s(goal, moved)[c];
            let bandwidth_per_s = FallbackSettings::default().bandwidth_per_s;
            // A duty more loses a little itself: 1 % leaves room for that, and not for the 20 % that the supply loses.
            assert!((rate / (bandwidth_per_s * error_kpa) - 1.0).abs() < 0.01, "{rate} kPa/s of {c}, {further}");
        }
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

/// The paper's reference, half a minute's hold at its end, and the same again from its beginning, 20 kPa lower: neither the hold nor
/// the jump may leave anything behind in integral or play, so that the second time is tracked as the first (a quarter more is what two
/// noises differ by, and the jump's own end). The model is off by half a percent of a valve, as one that was found is: its hold
/// is off by more than the integral takes up before the play is crossed.
#[test]
fn neither_a_hold_nor_a_jump_leaves_anything_behind() {
    let bench = Rig::builtin("bench").unwrap();
    let paper = Reference::paper();
    let (length_s, hold_s) = (60.0, 30.0);
    let rows = |from_s: f64| -> String {
        let row = |n: usize| {
            let time_s = n as f64 * TICK_S;
            let [pos, neg] = paper.at(time_s);
            format!("{:.2},{pos},{neg}\n", from_s + time_s)
        };
        (0..=(length_s / TICK_S) as usize).map(row).collect()
    };
    let [pos, neg] = paper.at(length_s);
    let held = format!("{:.2},{pos},{neg}\n", length_s + hold_s - TICK_S);
    let twice = format!("time_s,ref_pos_kpa,ref_neg_kpa\n{}{held}{}", rows(0.0), rows(length_s + hold_s));
    let twice = Reference::parse("twice", twice.as_bytes()).unwrap();
    let mut found = bench.clone();
    found.valves.values_mut().for_each(|valve| valve.spring_area_mm2 *= 1.005);
    let model = Arc::new(SteadyMap::new(&found).unwrap());
    let fly = |reference: &Reference, [seconds, skip_s]: [f64; 2]| {
        let mut law = Fallback::new(Arc::clone(&model), FallbackSettings::default());
        flown(&bench, &mut law, reference, [seconds, skip_s], 1)
    };
    let (once, again) = (fly(&paper, [60.0, 5.0]), fly(&twice, [150.0, 95.0]));
    println!("{once:.3?} the first time, {again:.3?} behind hold and jump");
    assert!(again[0] < 1.25 * once[0] && again[1] < 1.25 * once[1], "{once:?} {again:?}");
}

/// On a hold the integral crosses the play that the valve has, since the model is off by half a percent and the flapper has to go the
/// other way; where the goal then moves on, the command crosses it back at once. A ramp of 4 and 2 kPa/s for three seconds behind 40 s of
/// hold: without that knowledge 0.377/0.345 kPa (RMSE); the bounds are halfway to the readings' noise, 0.064/0.007.
#[test]
fn a_hold_is_left_without_an_error() {
    let rig = bench_with(&[
        ("valve_hysteresis", "valve_pos", "half_width_duty = 0.038"),
        ("valve_hysteresis", "valve_neg", "half_width_duty = 0.038"),
    ]);
    let mut found = rig.clone();
    found.valves.values_mut().for_each(|valve| valve.spring_area_mm2 *= 0.995);
    let paper = Reference::paper();
    let (end_s, leaves_s, ramp_s) = (60.0, 100.0, 3.0);
    let [pos, neg] = paper.at(end_s);
    let rows: String = (0..=(end_s / TICK_S) as usize)
        .map(|n| (n as f64 * TICK_S, paper.at(n as f64 * TICK_S)))
        .chain([(leaves_s, [pos, neg]), (leaves_s + ramp_s, [pos + 4.0 * ramp_s, neg - 2.0 * ramp_s])])
        .map(|(time_s, [pos, neg])| format!("{time_s:.2},{pos},{neg}\n"))
        .collect();
    let reference = Reference::parse("held", format!("time_s,ref_pos_kpa,ref_neg_kpa\n{rows}").as_bytes()).unwrap();
    let mut law = Fallback::new(Arc::new(SteadyMap::new(&found).unwrap()), FallbackSettings::default());
    let left = flown(&rig, &mut law, &reference, [leaves_s + ramp_s, leaves_s], 1);
    println!("{left:.3?} kPa where the hold is left");
    assert!(left[0] < 0.22 && left[1] < 0.17, "{left:?}");
}

/// `bench` with other mechanisms.
fn bench_with(mechanisms: &[(&str, &str, &str)]) -> Rig {
    let mut bare = Rig::builtin("bench").unwrap();
    bare.mechanisms.clear();
    let own: String = mechanisms
        .iter()
        .map(|(id, component, number)| {
            format!("\n[[mechanisms]]\nid = \"{id}\"\ncomponent = \"{component}\"\n{number}\n")
        })
        .collect();
    Rig::from_toml(&(bare.to_toml().unwrap() + &own)).unwrap()
}

/// All that acts on the valves' path is in the rig file, and the fallback uses it: on rigs like the study's two (valve lag 80 ms,
/// play 0.03, warm gas; delay 60 ms, warm gas), and on rigs with one thing each, it leaves at least a third less than one that
/// is told the nominal rig, once the converter's noise is taken off.
#[test]
fn a_told_fallback_tracks_better() {
    let valves = |id, number| ["valve_pos", "valve_neg"].map(|valve| (id, valve, number));
    let [lag, play] =
        [valves("valve_lag", "time_constant_ms = 80.0"), valves("valve_hysteresis", "half_width_duty = 0.03")];
    let [delay, short] = [valves("command_delay", "delay_ms = 60.0"), valves("command_delay", "delay_ms = 40.0")];
    let scattered = valves("valve_hysteresis", "half_width_duty = 0.03\nspread_duty = 0.025");
    let warm = [("chamber_thermal", "positive", "wall_conductance_w_per_k = 0.8")];
    let rigs = [
        ("lag 80 ms, play 0.03, warm gas", [lag.as_slice(), &play, &warm].concat()),
        ("delay 60 ms, warm gas", [delay.as_slice(), &warm].concat()),
        ("delay 40 ms", short.to_vec()),
        ("lag 80 ms", lag.to_vec()),
        ("play 0.03", play.to_vec()),
        ("plays of 0.01 to 0.05 side by side", scattered.to_vec()),
    ];
    let nominal = Arc::new(SteadyMap::new(&Rig::builtin("dual_pressure").unwrap()).unwrap());
    // Of the emulated converter on both sensors, in kPa RMS: no controller can take it off the readings.
    let noise_kpa = [0.06, 0.006];
    for (name, mechanisms) in rigs {
        let rig = bench_with(&mechanisms);
        let own = Arc::new(SteadyMap::new(&rig).unwrap());
        let [untold, told] = [&nominal, &own].map(|map| {
            let mut law = Fallback::new(Arc::clone(map), FallbackSettings::default());
            flown(&rig, &mut law, &Reference::paper(), [60.0, 5.0], 1)
        });
        println!("{name}: told nominal {untold:.3?}, told its own file {told:.3?} kPa");
        let beyond = |rmse: Pair| -> Pair {
            std::array::from_fn(|c| (rmse[c] * rmse[c] - noise_kpa[c] * noise_kpa[c]).max(0.0).sqrt())
        };
        let (before, after) = (beyond(untold), beyond(told));
        assert!(after.iter().zip(before).all(|(a, b)| *a < b * 2.0 / 3.0), "{name}: {before:?} to {after:?}");
    }
}

/// The paper's reference flown ten times on `bench` by a fallback that is told it, and by one that is not: what is left is near
/// the clairvoyant optimum (0.079/0.017 kPa) for the one, and a third and more is taken off for the other.
#[test]
fn repetitions_take_off_what_repeats() {
    let bench = Rig::builtin("bench").unwrap();
    let fly = |model: &Rig| {
        let (map, settings) = (Arc::new(SteadyMap::new(model).unwrap()), FallbackSettings::default());
        let mut repetition = settings.repetition(&map);
        let mut law = Fallback::new(map, settings);
        let mut flight =
            |seed| flown_again(&bench, (&mut law, Some(&mut repetition)), &Reference::paper(), [60.0, 5.0], seed);
        let flights: Vec<Pair> = (1..=10).map(&mut flight).collect();
        println!("{}: first {:.3?}, last {:.3?} kPa", model.name, flights[0], flights[9]);
        (flights[0], flights[9])
    };
    let (_, told) = fly(&bench);
    assert!(told[0] < 1.4 * 0.079 && told[1] < 1.4 * 0.017, "{told:?}");
    let (first, last) = fly(&Rig::builtin("dual_pressure").unwrap());
    assert!(last[0] < 0.75 * first[0] && last[1] < 0.5 * first[1], "{first:?} {last:?}");
}

//! Chambers behind sensors that lag or swing: what MPObs make of them.

use model::observation::{AHEAD, CHANNELS, Pair};
use model::predict::{DualPressureRig, Predictor};
use model::real::{Lanes, Real};
use model::rig::Rig;
use model::steady::SteadyMap;

/// Noise of the readings in kPa RMS: the emulated converter's on the two sensors of the paper's rig.
const NOISE_KPA: Pair = [0.06, 0.006];

fn rig(name: &str, mechanisms: &[&str]) -> Rig {
    let own = mechanisms.iter().map(|m| format!("\n[[mechanisms]]\n{m}\n")).collect::<String>();
    let text = match name {
        "dual_pressure" => model::rig::DUAL_PRESSURE.to_owned(),
        name => Rig::builtin(name).unwrap().to_toml().unwrap(),
    };
    Rig::from_toml(&(text + &own)).unwrap()
}

fn lag(sensor: &str, ms: f64) -> String {
    format!("id = \"sensor_lag\"\ncomponent = \"{sensor}\"\ntime_constant_ms = {ms}")
}

fn ringing(sensor: &str) -> String {
    format!("id = \"residual_response\"\ncomponent = \"{sensor}\"\nnatural_frequency_hz = 3.0\ndamping_ratio = 0.2")
}

/// Gaussian noise that is the same on every machine.
struct Noise(u64);

impl Noise {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 11) as f64 + 0.5) / (1u64 << 53) as f64
    }

    fn next(&mut self) -> f64 {
        (-2.0 * self.uniform().ln()).sqrt() * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

/// Errors in kPa RMS over 30 s of swinging duties, the first 5 s left out.
#[derive(Debug)]
struct Errors {
    /// Readings predicted five ticks ahead, against what the sensors then show without noise.
    ahead: Pair,
    /// The estimated chambers, against what sensors without lag would show, about the mean: a late sensor shows the mean of the
    /// pump's ripple where one without lag shows its sample at the tick (`a_chamber_at_rest_is_where_its_sensor_shows_it`).
    chambers: Pair,
}

fn errors(plant: &Rig, plain: &Rig, model: &Rig, noise: Pair) -> Errors {
    let map = SteadyMap::new(&Rig::builtin("dual_pressure").unwrap()).unwrap();
    // The chambers themselves: the same rig with sensors that read what is there.
    let (mut plant, mut beside) = (DualPressureRig::new(plant).unwrap(), DualPressureRig::new(plain).unwrap());
    let mut predictor = Predictor::new(model).unwrap();
    let duty = |tick: usize| {
        let at = |t: f64| [80.0 + t / 3.0 + 6.0 * (0.785 * t).sin(), -70.0 - t / 12.0 + 3.0 * (0.628 * t).sin()];
        let t = tick as f64 * 0.02;
        let rate: Pair = std::array::from_fn(|c| (at(t + 0.02)[c] - at(t)[c]) / 0.02);
        map.duty_for(at(t + 0.01), rate)
    };
    let (mut random, mut predicted) = (Noise(7), Vec::new());
    let (mut ahead, mut chambers, mut mean, mut count) = ([0.0; CHANNELS], [0.0; CHANNELS], [0.0; CHANNELS], 0.0);
    plant.start_from([80.0, -70.0], duty(0));
    beside.start_from([80.0, -70.0], duty(0));
    predictor.restart([80.0, -70.0], duty(0));
    for tick in 0..1500 {
        let clean = plant.readings_kpa();
        let measured: Pair = std::array::from_fn(|c| clean[c] + noise[c] * random.next());
        let undelayed = predictor.observe(measured);
        if tick >= 250 {
            let before: [Pair; AHEAD] = predicted[tick - AHEAD];
            for c in 0..CHANNELS {
                ahead[c] += (before[AHEAD - 1][c] - clean[c]).powi(2);
                let off = undelayed[c] - beside.readings_kpa()[c];
                chambers[c] += off.powi(2);
                mean[c] += off;
            }
            count += 1.0;
        }
        predicted.push(predictor.predict(&std::array::from_fn(|j| duty(tick + j)), true));
        plant.tick(duty(tick), true);
        beside.tick(duty(tick), true);
        predictor.advance(duty(tick), true);
    }
    let rms = |squares: Pair| squares.map(|s| (s / count).sqrt());
    let about_mean = std::array::from_fn(|c| chambers[c] - mean[c] * mean[c] / count);
    Errors { ahead: rms(ahead), chambers: rms(about_mean) }
}

/// The lag that is known: predictions err by what noise leaves, and the chambers are known as well.
#[test]
fn a_lag_of_160_ms_is_undone() {
    for (name, mechanism) in [("positive", lag("sensor_pos", 160.0)), ("negative", lag("sensor_neg", 160.0))] {
        let c = usize::from(name == "negative");
        let (plain, lagging) = (rig("dual_pressure", &[]), rig("dual_pressure", &[&mechanism]));
        let (known, unknown) =
            (errors(&lagging, &plain, &lagging, NOISE_KPA), errors(&lagging, &plain, &plain, NOISE_KPA));
        println!("{name}: lag known {known:.3?}, not known {unknown:.3?}");
        // The positive reading's noise is ten times the negative's, and a steady filter of these gains leaves 0.036 and 0.010.
        assert!(known.ahead[c] < [0.05, 0.015][c], "{name}: {known:?}");
        assert!(known.ahead[c] < [0.5, 0.2][c] * unknown.ahead[c], "{name}: {known:?} {unknown:?}");
        assert!(known.chambers[c] < [0.06, 0.018][c] && known.chambers[c] < 0.2 * unknown.chambers[c], "{known:?}");
    }
}

/// A chamber that is held is where its sensor shows it, so that who puts it on a reference puts the reading there: neither the
/// ripple of the pump (0.19 kPa behind 160 ms) nor what the model errs by stays between them.
#[test]
fn a_chamber_at_rest_is_where_its_sensor_shows_it() {
    let swings = ["sensor_pos", "sensor_neg"].map(ringing);
    for ms in [5.0, 20.0, 160.0, 0.0] {
        let own = if ms > 0.0 { ["sensor_pos", "sensor_neg"].map(|sensor| lag(sensor, ms)) } else { swings.clone() };
        let own = own.each_ref().map(String::as_str);
        for plant in ["dual_pressure", "bench"] {
            let mut plant = DualPressureRig::new(&rig(plant, &own)).unwrap();
            let mut predictor = Predictor::new(&rig("dual_pressure", &own)).unwrap();
            let (duty, mut undelayed) = ([0.88, 0.85], [f64::NAN; CHANNELS]);
            // Behind 80 s nothing of `bench` moves by a thousandth of a kPa in a tick.
            for tick in 0..4000 {
                undelayed = predictor.observe(plant.readings_kpa());
                if tick < 3999 {
                    plant.tick(duty, true);
                    predictor.advance(duty, true);
                }
            }
            let shown = plant.readings_kpa();
            println!("lag {ms} ms: {undelayed:.3?} for {shown:.3?}");
            for c in 0..CHANNELS {
                assert!((undelayed[c] - shown[c]).abs() < 0.01, "lag {ms} ms: {undelayed:?} for {shown:?}");
            }
        }
    }
}

#[test]
fn a_swinging_line_is_better_known_than_not() {
    for (c, sensor) in ["sensor_pos", "sensor_neg"].into_iter().enumerate() {
        let (plain, ringing) = (rig("dual_pressure", &[]), rig("dual_pressure", &[&ringing(sensor)]));
        let (known, unknown) =
            (errors(&ringing, &plain, &ringing, NOISE_KPA), errors(&ringing, &plain, &plain, NOISE_KPA));
        println!("{sensor}: swing known {known:.3?}, not known {unknown:.3?}");
        // Noise that passes the gains is most of what is left of the positive one.
        assert!(known.ahead[c] < [0.8, 0.5][c] * unknown.ahead[c], "{known:?} {unknown:?}");
        assert!(known.chambers[c] < 0.5 * unknown.chambers[c], "{known:?} {unknown:?}");
    }
}

/// Where only the lag is right and the rest of the model is off, it is still better to know of it, and no offset is left.
#[test]
fn with_a_model_that_is_off_a_known_lag_still_helps() {
    let mechanisms = [lag("sensor_pos", 160.0), lag("sensor_neg", 160.0)];
    let both: Vec<&str> = mechanisms.iter().map(String::as_str).collect();
    let (plant, plain) = (rig("bench", &both), rig("bench", &[]));
    let (lag_known, nothing) = (rig("dual_pressure", &both), rig("dual_pressure", &[]));
    let (known, unknown) = (errors(&plant, &plain, &lag_known, NOISE_KPA), errors(&plant, &plain, &nothing, NOISE_KPA));
    println!("bench: lag known {known:.3?}, nothing known {unknown:.3?}");
    for c in 0..CHANNELS {
        assert!(known.ahead[c] < 0.9 * unknown.ahead[c], "{known:?} {unknown:?}");
        assert!(known.chambers[c] < 0.8 * unknown.chambers[c], "{known:?} {unknown:?}");
    }
}

/// Noise ten times that of the converter: the gains fall with it, and predictions stay below it.
#[test]
fn noise_is_found_and_smoothed() {
    let mechanism = lag("sensor_neg", 160.0);
    let (plain, lagging) = (rig("dual_pressure", &[]), rig("dual_pressure", &[&mechanism]));
    let noisy = errors(&lagging, &plain, &lagging, [0.06, 0.06]);
    println!("{noisy:.3?}");
    assert!(noisy.ahead[1] < 0.04 && noisy.chambers[1] < 0.09, "{noisy:?}");
}

/// A gain, a bias and a drift with a lag behind them: the observer works on what the sensor says of the chamber.
#[test]
fn a_perfect_model_predicts_what_comes_behind_any_sensor() {
    let mechanisms = [
        lag("sensor_pos", 90.0) + "\nsecond_time_constant_ms = 12.0",
        ringing("sensor_pos") + "\nshare = 0.6",
        "id = \"sensor_gain\"\ncomponent = \"sensor_pos\"\ngain = 1.03".to_owned(),
        "id = \"sensor_bias\"\ncomponent = \"sensor_pos\"\nbias_kpa = -0.7".to_owned(),
        lag("sensor_neg", 25.0),
    ];
    let rig = rig("dual_pressure", &mechanisms.each_ref().map(String::as_str));
    let perfect = errors(&rig, &rig, &rig, [0.0; CHANNELS]);
    // Rounding through kPa and back, with gains of up to some tens.
    assert!(perfect.ahead.iter().all(|e| *e < 1e-8), "{perfect:?}");
}

/// Lane by lane the observer does what it does alone, to the last bit, and a lane that is started anew leaves the others alone.
#[test]
fn lanes_have_the_bits_of_one_alone() {
    let rigs: [Rig; 8] =
        std::array::from_fn(|lane| rig("dual_pressure", &[&lag("sensor_pos", 20.0 * (lane + 1) as f64)]));
    let mut together = Predictor::with(DualPressureRig::side_by_side(&rigs).unwrap());
    let mut alone: Vec<Predictor> = rigs.iter().map(|rig| Predictor::new(rig).unwrap()).collect();
    let (start, duty) = ([80.0, -70.0], [0.8, 0.85]);
    together.restart(start.map(Lanes::splat), duty.map(Lanes::splat));
    alone.iter_mut().for_each(|one| one.restart(start, duty));
    let mut random = Noise(3);
    for tick in 0..60 {
        if tick == 30 {
            together.restart_lane(2, [75.0, -71.0], duty);
            alone[2].restart([75.0, -71.0], duty);
        }
        let measured: Pair = [80.0 + 0.02 * f64::from(tick) + 0.06 * random.next(), -70.0 + 0.006 * random.next()];
        let seen = together.observe(measured.map(Lanes::splat));
        let ahead = together.predict(&[duty.map(Lanes::splat); AHEAD], true);
        together.advance(duty.map(Lanes::splat), true);
        for (lane, one) in alone.iter_mut().enumerate() {
            assert_eq!(seen.map(|p| p.lane(lane)), one.observe(measured), "tick {tick}, lane {lane}");
            assert_eq!(ahead.map(|pair| pair.map(|p| p.lane(lane))), one.predict(&[duty; AHEAD], true));
            one.advance(duty, true);
        }
    }
}

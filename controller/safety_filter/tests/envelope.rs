//! Controllers that mean harm, on rigs that the model is not, and controllers that mean well.
//!
//! The plants are detailed rigs drawn around `bench` (play, lag, delay, warm gas, parameters some percent off); the
//! filter knows `dual_pressure`. The sensors' noise is the converter's.
#![allow(clippy::unwrap_used)] // a test's own set-up; clippy knows tests only by their attribute

use std::sync::Arc;

use law::{ControlInput, Fallback, FallbackSettings, SoftStart, TICK_S};
use model::mechanism::Mechanism;
use model::observation::{CHANNELS, Pair};
use model::predict::DualPressureRig;
use model::rig::Rig;
use model::steady::SteadyMap;
use proto::emulator::{PSE540A_R06, PSE541A_R06, Sensors};
use proto::reference::Reference;
use proto::split_mix::SplitMix64;
use safety_filter::{Envelope, Intervention, SafetyFilter, SlewLimit};

/// Duties of a tick from its number and the readings in kPa gauge.
type Decide<'a> = &'a mut dyn FnMut(u32, Pair) -> Pair;

const ENVELOPE: Envelope = Envelope { max_pos_kpa: 160.0, min_neg_kpa: -95.0 };
/// Scatter of readings, five standard deviations of the converter's noise: 0.06 and 0.006 kPa each.
const SCATTER_KPA: Pair = [0.3, 0.03];

/// Puts a value somewhere within a share of itself.
fn vary(value: &mut f64, share: f64, draw: &mut SplitMix64) {
    *value *= 1.0 + share * (2.0 * draw.unit() - 1.0);
}

/// Number `number` of the rigs around `bench`: volumes and flows by 10 %, mechanisms from nothing to 1.5 times.
fn drawn(number: u64) -> Rig {
    let mut draw = SplitMix64::new(number);
    let mut rig = Rig::builtin("bench").unwrap();
    for volume in rig.volumes.values_mut() {
        vary(&mut volume.volume_l, 0.1, &mut draw);
    }
    for valve in rig.valves.values_mut() {
        let mut scale = 1.0;
        vary(&mut scale, 0.1, &mut draw);
        valve.input_area_mm2 *= scale;
        valve.pressure_area_mm2_per_n *= scale;
        valve.spring_area_mm2 *= scale;
    }
    for attached in &mut rig.mechanisms {
        let share = 1.5 * draw.unit();
        match &mut attached.mechanism {
            Mechanism::ValveHysteresis(m) => m.half_width_duty *= share,
            Mechanism::ValveLag(m) => m.time_constant_ms = (m.time_constant_ms * share).max(1.0),
            Mechanism::CommandDelay(m) => m.delay_ms *= share,
            Mechanism::ChamberThermal(m) => m.wall_conductance_w_per_k *= share.max(0.1),
            _ => {}
        }
    }
    rig.check().unwrap();
    rig
}

/// The farthest true pressures and the largest change of a duty, in `seconds` under `controller(tick, measured)`.
fn fly(rig: &Rig, seconds: f64, controller: &mut dyn FnMut(u32, Pair) -> Pair) -> (Pair, f64, u64) {
    let mut filter = SafetyFilter::new(&Rig::builtin("dual_pressure").unwrap(), ENVELOPE, SlewLimit::DEFAULT).unwrap();
    let mut plant = DualPressureRig::new(rig).unwrap();
    let scales = [PSE540A_R06, PSE541A_R06];
    let mut sensors = Sensors::new(scales, Sensors::ADC_NOISE_V_RMS, 7);
    let (mut farthest, mut steepest, mut last) = ([0.0_f64; CHANNELS], 0.0_f64, [1.0; CHANNELS]);
    for tick in 0..(seconds / TICK_S) as u32 {
        let truth = plant.readings_kpa();
        farthest = [farthest[0].max(truth[0]), farthest[1].min(truth[1])];
        let volts = sensors.sample(truth, [&[], &[]]);
        let measured: Pair = std::array::from_fn(|c| scales[c].gauge_kpa(f64::from(volts[c])));
        filter.observe(measured);
        let asked = controller(tick, measured);
        let sent = filter.limit(asked);
        if sent.intervention == Intervention::None {
            assert_eq!(sent.duty, asked.map(|u| u.clamp(0.0, 1.0)));
        }
        if sent.intervention == Intervention::Slew {
            steepest = (0..CHANNELS).fold(steepest, |s, c| s.max((sent.duty[c] - last[c]).abs()));
        }
        filter.sent(sent.duty);
        plant.tick(sent.duty, true);
        last = sent.duty;
    }
    (farthest, steepest, filter.interventions())
}

#[test]
fn no_controller_leaves_the_envelope_on_rigs_around_the_bench() {
    no_controller_leaves_the_envelope(0..5);
}

fn no_controller_leaves_the_envelope(rigs: std::ops::Range<u64>) {
    for number in rigs {
        let rig = drawn(number);
        let map = SteadyMap::new(&Rig::builtin("dual_pressure").unwrap()).unwrap();
        let wrong_sign = |measured: Pair| -> Pair {
            let duty = map.duty_for([90.0, -72.0], [0.0; CHANNELS]);
            [duty[0] - 0.05 * (measured[0] - 90.0), duty[1] - 0.05 * (measured[1] + 72.0)]
        };
        let mut draw = SplitMix64::new(1_000 + number);
        let mut held: Pair = [0.0; CHANNELS];
        let controllers: [(&str, Decide<'_>); 6] = [
            ("always 0", &mut |_, _| [0.0; CHANNELS]),
            ("positive shut, negative open", &mut |_, _| [0.0, 1.0]),
            ("bang-bang, 10 Hz", &mut |tick, _| [f64::from(tick / 5 % 2); CHANNELS]),
            ("bang-bang against the reference, shut below it", &mut |_, p| {
                [f64::from(u8::from(p[0] > 155.0)), f64::from(u8::from(p[1] < -93.0))]
            }),
            ("wrong sign", &mut |_, p| wrong_sign(p)),
            ("random holds", &mut |tick, _| {
                if tick % 17 == 0 {
                    held = [0.8 * draw.unit(), 0.8 * draw.unit()];
                }
                held
            }),
        ];
        for (name, controller) in controllers {
            let (farthest, steepest, interventions) = fly(&rig, 8.0, controller);
            println!("rig {number}, {name}: farthest {farthest:.1?} kPa, {interventions} interventions");
            assert!(farthest[0] <= ENVELOPE.max_pos_kpa + SCATTER_KPA[0], "rig {number}, {name}: {farthest:?}");
            assert!(farthest[1] >= ENVELOPE.min_neg_kpa - SCATTER_KPA[1], "rig {number}, {name}: {farthest:?}");
            assert!(steepest <= 0.1 + 1e-12, "rig {number}, {name}: {steepest}");
        }
    }
}

/// Without the filter the first of them does leave it: the test above can fail.
#[test]
fn without_the_filter_the_envelope_is_left() {
    let mut plant = DualPressureRig::new(&drawn(0)).unwrap();
    for _ in 0..400 {
        plant.tick([0.0, 1.0], true);
    }
    assert!(plant.readings_kpa()[0] > 165.0, "{:?}", plant.readings_kpa());
}

/// A model may be put in at any tick, so the envelope is kept also where one is in every tick: what is put in knows where valves and gas
/// stand by the last commands. This model has a delay, a coil's lag, play and warm gas of its own.
#[test]
fn a_filter_that_goes_on_for_another_keeps_the_envelope() {
    let rig = Rig::builtin("bench").unwrap();
    let mut filters = [0, 1].map(|_| SafetyFilter::new(&rig, ENVELOPE, SlewLimit::DEFAULT).unwrap());
    let mut plant = DualPressureRig::new(&rig).unwrap();
    let mut farthest = [0.0_f64; CHANNELS];
    for _ in 0..400 {
        let [before, filter] = &mut filters;
        filter.continue_from(before);
        let measured = plant.readings_kpa();
        farthest = [farthest[0].max(measured[0]), farthest[1].min(measured[1])];
        filter.observe(measured);
        let sent = filter.limit([0.0; CHANNELS]);
        filter.sent(sent.duty);
        plant.tick(sent.duty, true);
        filters.reverse();
    }
    assert!(filters[0].interventions() > 0);
    assert!(farthest[0] <= ENVELOPE.max_pos_kpa && farthest[1] >= ENVELOPE.min_neg_kpa, "{farthest:?}");
}

/// The fallback on the paper's reference is never touched: on the built-in rigs and on ten around `bench`.
#[test]
fn a_controller_that_means_well_is_left_alone() {
    let map = Arc::new(SteadyMap::new(&Rig::builtin("dual_pressure").unwrap()).unwrap());
    let reference = Reference::paper();
    let rigs = ["dual_pressure", "bench"].map(|name| Rig::builtin(name).unwrap());
    for (number, rig) in rigs.into_iter().chain((0..10).map(drawn)).enumerate() {
        let mut law = Fallback::new(Arc::clone(&map), FallbackSettings::default());
        let mut approach = None;
        let mut steepest = 0.0_f64;
        let mut before: Pair = [1.0; CHANNELS];
        let (_, _, interventions) = fly(&rig, 60.0, &mut |tick, measured_kpa| {
            let approach = *approach.get_or_insert_with(|| SoftStart::new(measured_kpa, reference.at(0.0)));
            let goals_kpa = std::array::from_fn(|j| {
                let time_s = f64::from(tick + j as u32) * TICK_S;
                let (goal, offset) = (reference.at(time_s), approach.offset_kpa(time_s));
                std::array::from_fn(|c| goal[c] + offset[c])
            });
            let duty = law.decide(&ControlInput::of_measured(measured_kpa, goals_kpa)).duty();
            law.applied(duty);
            steepest = (0..CHANNELS).fold(steepest, |s, c| s.max((duty[c] - before[c]).abs()));
            before = duty;
            duty
        });
        println!("rig {number}: steepest {steepest:.3} of duty a tick, {interventions} interventions");
        assert_eq!(interventions, 0, "rig {number}");
    }
}

/// Tests of the thorough tier (docs/testing.md).
mod thorough {
    use super::*;

    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn no_controller_leaves_the_envelope_on_twenty_rigs() {
        no_controller_leaves_the_envelope(0..20);
    }
}

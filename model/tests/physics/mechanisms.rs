//! Each mechanism, off and on.
//!
//! Off (absent, or there but not enabled) the bits are those of a rig without it. On, what it does is measured
//! from outside: a tank of 100 L that fills through a choked valve is a flow meter, its rise over a tick is the
//! mean duty that acted.

use model::rig::Rig;

use crate::small_rigs::{
    ATMOSPHERE, KAPPA, R, T, TICK_S, chamber, choked, mechanism, plain_valve, rig, simulation, source,
};

/// Each with numbers that show, for the paper's rig.
pub(crate) const ALL: [(&str, &str, &str); 30] = [
    ("valve_hysteresis", "valve_pos", "half_width_duty = 0.03\nspread_duty = 0.01"),
    ("valve_stiction", "valve_neg", "band_duty = 0.05\nshort_of_it = 0.2"),
    ("valve_stiction", "valve_pos", "band_duty = 0.05\nshort_of_it = 0.2\nrubs = \"flapper\""),
    ("valve_lag", "valve_neg", "time_constant_ms = 50.0"),
    ("valve_force_curve", "valve_pos", "duty_curvature = 0.2\npressure_curvature_mm2_per_n2 = 0.4"),
    ("valve_force_curve", "valve_neg", "inverse_full_area_per_mm2 = 0.9"),
    ("coil_heating", "valve_pos", "resistance_rise = 0.1\ntime_constant_s = 2.0"),
    ("supply_sag", "rig", "loss_per_duty = 0.05"),
    ("command_delay", "valve_pos", "delay_ms = 30.0"),
    ("chamber_leak", "negative", "conductance_kg_per_s_pa2 = 1e-14"),
    ("cross_leak", "positive", "to = \"negative\"\nconductance_kg_per_s_pa2 = 1e-15"),
    ("piston_blowby", "pump", "conductance_kg_per_s_pa2 = 1e-14"),
    ("chamber_thermal", "positive", "wall_conductance_w_per_k = 1.0"),
    ("volume_compliance", "negative", "compliance_ml_per_kpa = 0.5"),
    ("volume_change", "positive", "extra_volume_l = 0.05"),
    ("volume_change", "negative", "extra_volume_l = 0.05\nbegins_s = 0.5"),
    ("line_resistance", "valve_pos", "area_mm2 = 2.0"),
    ("line_resistance", "pump", "port = \"outlet\"\narea_mm2 = 3.0"),
    ("exhaust_restriction", "valve_neg", "area_mm2 = 2.0"),
    ("critical_ratio", "valve_pos", "ratio = 0.2"),
    ("check_valve_cracking", "pump", "inlet_kpa = 2.0\noutlet_kpa = 1.0"),
    ("pump_droop", "pump", "speed_loss_per_bar = 0.05"),
    ("pump_speed", "pump", "change_percent = -2.0"),
    ("sensor_lag", "sensor_neg", "time_constant_ms = 30.0"),
    ("sensor_drift", "sensor_pos", "rate_kpa_per_min = 1.0\ntime_constant_s = 30.0"),
    ("sensor_bias", "sensor_neg", "bias_kpa = 0.5"),
    ("sensor_gain", "sensor_pos", "gain = 1.02"),
    ("residual_response", "sensor_neg", "natural_frequency_hz = 3.0\ndamping_ratio = 0.2"),
    ("actuator_load", "positive", "vacuum = \"negative\"\npayload_kg = 5.0"),
    (
        "residual_flow",
        "positive",
        "flow_mg_per_s = [0.0, 40.0]\naxes = [{ variable = \"duty\", of = \"valve_neg\", knots = [0.5, 1.0] }]",
    ),
];

pub(crate) fn paper_with(mechanisms: &str) -> Rig {
    Rig::from_toml(&format!("{}\n{mechanisms}", model::rig::DUAL_PRESSURE)).unwrap_or_else(|e| panic!("{e}"))
}

/// Duties that go up and down, in steps and in ramps.
fn duties(tick: i32) -> [f64; 2] {
    let saw = f64::from(tick % 23) / 23.0;
    [if tick % 40 < 20 { 0.9 } else { 0.55 }, 0.5 + 0.5 * saw]
}

/// Readings and true pressures, bit for bit.
fn bits(rig: &Rig) -> Vec<u64> {
    let mut simulation = simulation(rig);
    let mut seen = Vec::new();
    for tick in 0..100 {
        let [u_pos, u_neg] = duties(tick);
        simulation.tick(&[u_pos, u_neg, if tick < 80 { 1.0 } else { 0.0 }]);
        seen.extend(simulation.readings_kpa().map(f64::to_bits));
        seen.extend([0, 1].map(|i| simulation.pressure_pa(i).to_bits()));
    }
    seen
}

#[test]
fn off_is_bit_identical_to_absent_and_on_is_not() {
    let plain = bits(&Rig::builtin("dual_pressure").unwrap());
    let mut all = String::new();
    for (id, component, parameter) in ALL {
        let on = mechanism(id, component, parameter);
        let off = format!("{on}enabled = false\n");
        assert!(bits(&paper_with(&off)) == plain, "{id} acts although it is off");
        assert!(bits(&paper_with(&on)) != plain, "{id} does nothing although it is on");
        all += &off;
    }
    assert!(bits(&paper_with(&all)) == plain, "all of them together act although they are off");
    let bench = Rig::builtin("bench").unwrap();
    let mut switched_off = bench.clone();
    switched_off.mechanisms.iter_mut().for_each(|m| m.enabled = false);
    assert!(bits(&switched_off) == bits(&bench.without_mechanisms()));
    assert!(bits(&switched_off) != bits(&bench));
}

/// The mean duty that acts in each tick when `sent` are commanded, by the flow meter.
pub(crate) fn acting(mechanisms: &str, sent: &[f64]) -> Vec<f64> {
    let (supply, volume) = (2_000_000.0, 0.1);
    let rig = rig(&(chamber("meter", 100.0)
        + &source("supply", supply, T)
        + &plain_valve("valve", "supply", "meter")
        + mechanisms));
    let full = R * T / volume * 1e-6 * supply / (R * T).sqrt() * choked(KAPPA) * TICK_S;
    let mut simulation = simulation(&rig);
    sent.iter()
        .map(|duty| {
            let before = simulation.pressure_pa(0);
            simulation.tick(&[*duty]);
            assert!(simulation.pressure_pa(0) < 0.5 * supply, "the meter must stay choked");
            (simulation.pressure_pa(0) - before) / full
        })
        .collect()
}

/// Rounding of 200 steps on 1 MPa against a rise of 80 Pa, and the 1e-10 of the polynomial for Φ.
pub(crate) const METER: f64 = 1e-9;

#[test]
fn flow_meter_reads_the_duty() {
    for (sent, acted) in [0.0, 0.2, 1.0, 0.7].into_iter().zip(acting("", &[0.0, 0.2, 1.0, 0.7])) {
        assert!((sent - acted).abs() < METER, "{sent} reads {acted}");
    }
}

#[test]
fn hysteresis_draws_a_loop_of_twice_its_half_width() {
    let width = 0.03;
    let play = mechanism("valve_hysteresis", "valve", &format!("half_width_duty = {width}"));
    // Up, down to a turning point inside, up again, down to zero, in steps of 0.01.
    let turns = [0.0f64, 0.9, 0.3, 0.6, 0.0];
    let sent: Vec<f64> = turns
        .windows(2)
        .flat_map(|w| {
            let n = ((w[1] - w[0]).abs() / 0.01).round() as i32;
            (1..=n).map(move |i| w[0] + (w[1] - w[0]) * f64::from(i) / f64::from(n))
        })
        .collect();
    let acted = acting(&play, &sent);
    let mut state = 0.0f64;
    for (k, (u, y)) in sent.iter().zip(&acted).enumerate() {
        state = state.clamp(u - width, u + width);
        assert!((y - state).abs() < METER, "tick {k}: duty {u} acts as {y}, play says {state}");
    }
    // The branches themselves, not only the recursion: at duty 0.5 on the way up and on the way down.
    let at = |duty: f64, from: usize| from + sent.iter().skip(from).position(|u| (u - duty).abs() < 1e-9).unwrap();
    let (up, down) = (acted[at(0.5, 0)], acted[at(0.5, 90)]);
    assert!((up - 0.47).abs() < METER && (down - 0.53).abs() < METER, "{up} rising, {down} falling");
    // Rate independent: the same duties in coarser steps end at the same openings.
    let coarse: Vec<f64> = sent.iter().copied().skip(4).step_by(5).collect();
    for (fast, slow) in acting(&play, &coarse).iter().zip(acted.iter().skip(4).step_by(5)) {
        assert!((fast - slow).abs() < 2.0 * METER);
    }
}

/// Duties along straight lines between turning points, in steps of `step`, which divides each line.
fn along(turns: &[f64], step: f64) -> Vec<f64> {
    let line = |w: &[f64]| {
        let (from, to, n) = (w[0], w[1], ((w[1] - w[0]).abs() / step).round() as i32);
        (1..=n).map(move |i| from + (to - from) * f64::from(i) / f64::from(n)).collect::<Vec<_>>()
    };
    turns.windows(2).flat_map(line).collect()
}

#[test]
fn spread_plays_draw_round_loops_that_thin_out() {
    let (width, spread, step) = (0.03, 0.02, 0.002);
    let play = mechanism("valve_hysteresis", "valve", &format!("half_width_duty = {width}\nspread_duty = {spread}"));
    // By how much the mean of five plays lags `x` after a turning point: each follows once its own play is used up.
    let widths = [0.014, 0.022, 0.030, 0.038, 0.046];
    let lag = |x: f64| widths.iter().map(|w| x.min(2.0 * w)).sum::<f64>() / 5.0;
    // From far up down to the bottom of a loop of range `a`, up and down again.
    for range in [0.02f64, 0.04, 0.06, 0.1, 0.4] {
        let sent = along(&[0.0, 0.9, 0.3, 0.3 + range, 0.3], step);
        let acted = acting(&play, &sent);
        let n = (range / step).round() as usize;
        let loop_from = sent.len() - 2 * n;
        // The falling branch lies above the duty by the half widths.
        let bottom = acted[loop_from - 1];
        assert!((bottom - 0.3 - width).abs() < METER, "{bottom}");
        let (rising, falling) = acted[loop_from..].split_at(n);
        for (k, y) in rising.iter().enumerate() {
            let x = step * (k + 1) as f64;
            // Round: the slope grows from nothing to one as one play after the other is used up.
            assert!((y - (bottom + x - lag(x))).abs() < METER, "{x} above the bottom of a loop of {range}: {y}");
        }
        let top = rising[n - 1];
        for (k, y) in falling.iter().enumerate() {
            let x = step * (k + 1) as f64;
            assert!((y - (top - x + lag(x))).abs() < METER, "{x} below the top of a loop of {range}: {y}");
        }
        // Area: each play wider than half the range stands still, the others enclose 2 w (a − 2 w).
        let enclosed: f64 = (1..=n)
            .map(|k| {
                let at_top_side = |i: usize| if i == 0 { top } else { falling[i - 1] };
                let at_bottom_side = |i: usize| if i == 0 { bottom } else { rising[i - 1] };
                let gap = |k: usize| at_top_side(n - k) - at_bottom_side(k);
                0.5 * (gap(k - 1) + gap(k)) * step
            })
            .sum();
        let exact = widths.iter().map(|w| 2.0 * w * (range - 2.0 * w).max(0.0)).sum::<f64>() / 5.0;
        // All corners lie on the grid of duties, so that trapezoids are exact.
        assert!((enclosed - exact).abs() < 10.0 * METER * range, "a loop of {range} encloses {enclosed}, not {exact}");
    }
}

#[test]
fn plays_of_one_width_are_one_play() {
    let sent = along(&[0.0, 0.9, 0.35, 0.6, 0.0], 0.05);
    let play = |more: &str| mechanism("valve_hysteresis", "valve", &format!("half_width_duty = 0.03{more}"));
    let [one, stated, narrow] =
        ["", "\nspread_duty = 0.0", "\nspread_duty = 1e-12"].map(|more| acting(&play(more), &sent));
    let bits = |seen: &[f64]| seen.iter().map(|y| y.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&one), bits(&stated));
    for (one, narrow) in one.iter().zip(&narrow) {
        assert!((one - narrow).abs() < METER, "{one} {narrow}");
    }
}

#[test]
fn lag_follows_exponentially() {
    for tau in [0.005, 0.05, 0.2] {
        let lag = mechanism("valve_lag", "valve", &format!("time_constant_ms = {}", tau * 1e3));
        let sent: Vec<f64> = (0..30).map(|k| if k < 20 { 0.8 } else { 0.3 }).collect();
        // Mean over a tick of a first-order approach from y to u, and where it stands after.
        let mut y = 0.0;
        for (k, (u, mean)) in sent.iter().zip(acting(&lag, &sent)).enumerate() {
            let left = (-TICK_S / tau).exp();
            let exact = u + (y - u) * tau / TICK_S * (1.0 - left);
            y = u + (y - u) * left;
            // Simpson's rule over a step of 0.1 ms: (h/τ)⁴/2880 is 6e-11 at 5 ms.
            assert!((mean - exact).abs() < METER, "τ {tau}, tick {k}: {mean} against {exact}");
        }
    }
}

/// A current that falls at another pace than it rises: each step goes its own way, and what goes up and comes down in the
/// same time moves the mean by the difference.
#[test]
fn a_lag_may_fall_at_another_pace_than_it_rises() {
    let (rising, ratio) = (0.06, 1.7);
    let lag =
        mechanism("valve_lag", "valve", &format!("time_constant_ms = {}\nfalling_over_rising = {ratio}", rising * 1e3));
    let sent: Vec<f64> = (0..40).map(|k| if k % 20 < 10 { 0.8 } else { 0.3 }).collect();
    let mut y = 0.0;
    for (k, (u, mean)) in sent.iter().zip(acting(&lag, &sent)).enumerate() {
        let tau = if *u > y { rising } else { ratio * rising };
        let left = (-TICK_S / tau).exp();
        let exact = u + (y - u) * tau / TICK_S * (1.0 - left);
        y = u + (y - u) * left;
        assert!((mean - exact).abs() < METER, "tick {k}: {mean} against {exact}");
    }
    // Written as it is read, and left out where it says nothing.
    let alike = mechanism("valve_lag", "valve", "time_constant_ms = 60.0");
    let stated = mechanism("valve_lag", "valve", "time_constant_ms = 60.0\nfalling_over_rising = 1.0");
    let bits = |rig: &str| acting(rig, &sent).iter().map(|y| y.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&alike), bits(&stated));
}

#[test]
fn whole_ticks_of_delay_shift_the_commands_and_nothing_else() {
    let plain = Rig::builtin("dual_pressure").unwrap();
    for ticks in [0, 1, 2, 8] {
        let delay = format!("delay_ms = {}.0", 20 * ticks);
        let delayed = paper_with(
            &(mechanism("command_delay", "valve_pos", &delay) + &mechanism("command_delay", "valve_neg", &delay)),
        );
        let (mut one, mut other) = (simulation(&delayed), simulation(&plain));
        for tick in 0..60 {
            let [a, b] = duties(tick);
            one.tick(&[a, b, 1.0]);
            let [a, b] = if tick < ticks { [0.0, 0.0] } else { duties(tick - ticks) };
            other.tick(&[a, b, 1.0]);
            let same = [0, 1].map(|i| one.pressure_pa(i).to_bits() == other.pressure_pa(i).to_bits());
            assert_eq!(same, [true, true], "{ticks} ticks of delay, tick {tick}");
        }
    }
}

#[test]
fn a_part_of_a_tick_of_delay_acts_in_that_part() {
    let sent = [0.2, 0.2, 0.2, 0.8, 0.8, 0.4, 0.4, 0.4, 0.9, 0.1, 0.5];
    for (delay_ms, whole, part) in [(30.0, 1, 0.5), (5.0, 0, 0.25), (47.3, 2, 0.365), (150.0, 7, 0.5)] {
        let acted = acting(&mechanism("command_delay", "valve", &format!("delay_ms = {delay_ms}")), &sent);
        for (k, mean) in acted.iter().enumerate() {
            let duty = |ago: usize| if ago > k { 0.0 } else { sent[k - ago] };
            let exact = part * duty(whole + 1) + (1.0 - part) * duty(whole);
            // The switch is resolved to a half step of 0.05 ms, 0.0025 of a tick, and duties jump by up to 0.8.
            assert!((mean - exact).abs() < 0.0025, "{delay_ms} ms, tick {k}: {mean} against {exact}");
        }
    }
    // 30 ms lies between 20 and 40.
    let [early, middle, late] = [20, 30, 40].map(|ms| {
        acting(&mechanism("command_delay", "valve", &format!("delay_ms = {ms}.0")), &[0.0, 0.6, 0.6, 0.6])[2]
    });
    assert!(early > middle && middle > late, "{early}, {middle}, {late}");
}

#[test]
fn the_path_is_delay_then_lag_then_play() {
    let (tau, width) = (0.05, 0.03);
    let path = mechanism("valve_hysteresis", "valve", "half_width_duty = 0.03")
        + &mechanism("valve_lag", "valve", "time_constant_ms = 50.0")
        + &mechanism("command_delay", "valve", "delay_ms = 20.0");
    let sent: Vec<f64> = (0..60).map(|k| if k < 25 { 0.8 } else { 0.3 }).collect();
    let acted = acting(&path, &sent);
    // The same path cut into 4000 pieces per tick.
    let (pieces, mut lagged, mut opening) = (4000, 0.0, 0.0f64);
    for (k, mean) in acted.iter().enumerate() {
        let duty = if k == 0 { 0.0 } else { sent[k - 1] };
        let mut sum = 0.0;
        for _ in 0..pieces {
            lagged += (duty - lagged) * -(-TICK_S / f64::from(pieces) / tau).exp_m1();
            opening = opening.clamp(lagged - width, lagged + width);
            sum += opening;
        }
        // The sum reads each piece at its end: off by half a piece of the fastest rise, 0.8·20 ms/50 ms/8000.
        assert!((mean - sum / f64::from(pieces)).abs() < 1e-4, "tick {k}: {mean} against {}", sum / f64::from(pieces));
    }
}

#[test]
fn a_late_armature_follows_what_the_play_leaves() {
    let (tau, width) = (0.05, 0.03);
    let path = mechanism("valve_lag", "valve", "time_constant_ms = 50.0\nlags = \"armature\"")
        + &mechanism("valve_hysteresis", "valve", "half_width_duty = 0.03");
    let sent: Vec<f64> = (0..60).map(|k| if k < 25 { 0.8 } else { 0.3 }).collect();
    let (mut opening, mut y) = (0.0f64, 0.0);
    for (k, (duty, mean)) in sent.iter().zip(acting(&path, &sent)).enumerate() {
        // The play stands still within a tick, so the approach to it is an exponential.
        opening = opening.clamp(duty - width, duty + width);
        let left = (-TICK_S / tau).exp();
        let exact = opening + (y - opening) * tau / TICK_S * (1.0 - left);
        y = opening + (y - opening) * left;
        assert!((mean - exact).abs() < METER, "tick {k}: {mean} against {exact}");
    }
    // The coil in front of the play waits out its width first.
    let coil = acting(&path.replace("\nlags = \"armature\"", ""), &sent);
    let armature = acting(&path, &sent);
    assert!(armature[25] < coil[25] - 0.01, "{} {}", armature[25], coil[25]);
}

#[test]
fn settled_commands_have_no_transient() {
    let mut with = simulation(&paper_with(
        &(mechanism("command_delay", "valve_pos", "delay_ms = 50.0")
            + &mechanism("valve_lag", "valve_pos", "time_constant_ms = 80.0")),
    ));
    let mut without = simulation(&Rig::builtin("dual_pressure").unwrap());
    with.settle_commands(&[0.7, 0.8, 1.0]);
    for _ in 0..20 {
        with.tick(&[0.7, 0.8, 1.0]);
        without.tick(&[0.7, 0.8, 1.0]);
        assert_eq!(with.pressure_pa(0), without.pressure_pa(0));
    }
}

#[test]
fn a_lagging_sensor_reads_exponentially_and_changes_no_pressure() {
    let tau = 0.03;
    let lag = mechanism("sensor_lag", "sensor_tank", "time_constant_ms = 30.0");
    // Shut in: a step of the true pressure.
    let mut still = simulation(&rig(&(chamber("tank", 1.0) + &lag)));
    still.set_pressure_pa(0, ATMOSPHERE + 50_000.0);
    for tick in 1..=20 {
        still.tick(&[]);
        let exact = 50.0 * (1.0 - (-f64::from(tick) * TICK_S / tau).exp());
        assert!((still.reading_kpa(0) - exact).abs() < 1e-9, "tick {tick}: {} against {exact}", still.reading_kpa(0));
        assert_eq!(still.pressure_pa(0), ATMOSPHERE + 50_000.0);
    }
    // A choked ramp: the reading trails by τ times its slope.
    let feed = source("supply", 900_000.0, T) + &plain_valve("valve", "supply", "tank");
    let mut ramp = simulation(&rig(&(chamber("tank", 10.0) + &feed + &lag)));
    let mut bare = simulation(&rig(&(chamber("tank", 10.0) + &feed)));
    let slope_kpa = R * T / 0.01 * 1e-6 * 900_000.0 / (R * T).sqrt() * choked(KAPPA) * 1e-3;
    for tick in 1..=50 {
        ramp.tick(&[1.0]);
        bare.tick(&[1.0]);
        let time = f64::from(tick) * TICK_S;
        let exact = slope_kpa * (time - tau * (1.0 - (-time / tau).exp()));
        // The lag takes the mean pressure of each step: slope·h·(h/τ)/12 is 5e-7 kPa.
        assert!((ramp.reading_kpa(0) - exact).abs() < 1e-6, "tick {tick}: {} against {exact}", ramp.reading_kpa(0));
        assert_eq!(ramp.pressure_pa(0), bare.pressure_pa(0));
        assert_eq!(bare.reading_kpa(0), bare.pressure_kpa(0));
    }
}

#[test]
fn a_sensor_with_two_lags_answers_a_step_as_both_in_series_do() {
    for (first, second) in [(0.08, 0.008), (0.008, 0.08), (0.03, 0.0299)] {
        let lag = mechanism(
            "sensor_lag",
            "sensor_tank",
            &format!("time_constant_ms = {}\nsecond_time_constant_ms = {}", first * 1e3, second * 1e3),
        );
        let mut still = simulation(&rig(&(chamber("tank", 1.0) + &lag)));
        still.set_pressure_pa(0, ATMOSPHERE + 50_000.0);
        for tick in 1..=20 {
            still.tick(&[]);
            let time = f64::from(tick) * TICK_S;
            let left = (first * (-time / first).exp() - second * (-time / second).exp()) / (first - second);
            let exact = 50.0 * (1.0 - left);
            // The second lag takes the mean of the first in each step of a millisecond: (h/τ)²/12 of what is under way.
            assert!((still.reading_kpa(0) - exact).abs() < 0.05, "tick {tick}: {} for {exact}", still.reading_kpa(0));
        }
    }
}

#[test]
fn only_a_leak_lets_a_shut_chamber_go() {
    let hold = |mechanisms: &str| {
        let mut simulation = simulation(&paper_with(mechanisms));
        simulation.set_pressure_pa(0, ATMOSPHERE + 80_000.0);
        simulation.set_pressure_pa(1, ATMOSPHERE - 60_000.0);
        for _ in 0..50 {
            simulation.tick(&[0.0, 0.0, 0.0]);
        }
        [simulation.pressure_kpa(0), simulation.pressure_kpa(1)]
    };
    let tight = hold("");
    assert!((tight[0] - 80.0).abs() < 1e-9 && (tight[1] + 60.0).abs() < 1e-9, "{tight:?}");
    // k (P² − P_atm²) R T/V for one second at the start, in kPa, decaying by a few percent.
    let leaking = hold(&mechanism("chamber_leak", "negative", "conductance_kg_per_s_pa2 = 1e-15"));
    let first_order = 1e-15 * (ATMOSPHERE.powi(2) - 41_325f64.powi(2)) * R * T / 0.4e-3 * 1e-3;
    let gained = leaking[1] + 60.0;
    assert!(gained < first_order && gained > 0.95 * first_order, "{gained} of {first_order} kPa");
    assert_eq!(leaking[0], tight[0], "the other chamber knows nothing of it");
}

#[test]
fn a_warm_chamber_overshoots_and_relaxes() {
    let step = |mechanisms: &str| {
        let parts = chamber("tank", 0.75) + &source("supply", 900_000.0, T) + &plain_valve("valve", "supply", "tank");
        let mut simulation = simulation(&rig(&(parts + mechanisms)));
        let mut trace = Vec::new();
        for tick in 0..500 {
            simulation.tick(&[if tick < 10 { 1.0 } else { 0.0 }]);
            trace.push(simulation.pressure_kpa(0));
        }
        trace
    };
    let warm = step(&mechanism("chamber_thermal", "tank", "wall_conductance_w_per_k = 1.0"));
    let cold = step("");
    assert!(warm[9] > 1.2 * cold[9], "{} against {} kPa when the valve shuts", warm[9], cold[9]);
    assert!(warm.windows(2).skip(9).all(|w| w[1] <= w[0]), "it only falls once shut in");
    assert!((warm[499] - cold[499]).abs() < 0.01, "{} against {} kPa at the end", warm[499], cold[499]);
}

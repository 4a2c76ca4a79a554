//! Refusals of rig files with a wrong mechanism: line, key, and the mend.

use model::rig::{DUAL_PRESSURE, Rig};

/// Each entry, and words that the one line about it must hold.
const WRONG: [(&str, &[&str]); 35] = [
    (
        "id = \"valve_hysteresis\"\ncomponent = \"valve_pos\"\nhalf_width_duty = 0.02\nspread_duty = 5.0",
        &["spread_duty", "0 … 0.5", "one play"],
    ),
    (
        "id = \"valve_stiction\"\ncomponent = \"valve_pos\"\nband_duty = 0.6",
        &["mechanisms.1.band_duty", "0.6 duty", "0 … 0.5"],
    ),
    (
        "id = \"valve_stiction\"\ncomponent = \"positive\"\nband_duty = 0.1",
        &["mechanisms.1.component", "a valve", "valve_pos"],
    ),
    ("id = \"valve_force_curve\"\ncomponent = \"valve_pos\"\nduty_curvature = 2.0", &["duty_curvature", "-1 … 1"]),
    ("id = \"coil_heating\"\ncomponent = \"valve_pos\"\nresistance_rise = 0.1", &["time_constant_s", "missing"]),
    (
        "id = \"coil_heating\"\ncomponent = \"valve_pos\"\nresistance_rise = 20.0\ntime_constant_s = 60.0",
        &["resistance_rise", "20", "share"],
    ),
    (
        "id = \"supply_sag\"\ncomponent = \"valve_pos\"\nloss_per_duty = 0.1",
        &["mechanisms.1.component", "whole rig", "`rig`"],
    ),
    ("id = \"supply_sag\"\ncomponent = \"rig\"\nloss_per_duty = 5.0", &["loss_per_duty", "1/duty"]),
    ("id = \"command_delay\"\ncomponent = \"valve_pos\"\ndelay_ms = 400.0", &["delay_ms", "400 ms", "sixteen ticks"]),
    ("id = \"command_delay\"\ncomponent = \"pump\"\ndelay_ms = 20.0", &["mechanisms.1.component", "only switched"]),
    (
        "id = \"cross_leak\"\ncomponent = \"positive\"\nto = \"positive\"\nconductance_kg_per_s_pa2 = 1e-15",
        &["mechanisms.1.to", "negative"],
    ),
    (
        "id = \"cross_leak\"\ncomponent = \"positive\"\nto = \"elsewhere\"\nconductance_kg_per_s_pa2 = 1e-15",
        &["elsewhere", "negative"],
    ),
    (
        "id = \"chamber_leak\"\ncomponent = \"positive\"\nconductance_kg_per_s_pa2 = 1e-3",
        &["conductance", "kg/(s Pa²)", "small leak"],
    ),
    ("id = \"piston_blowby\"\ncomponent = \"valve_pos\"\nconductance_kg_per_s_pa2 = 1e-15", &["a pump", "`pump`"]),
    (
        "id = \"volume_compliance\"\ncomponent = \"negative\"\ncompliance_ml_per_kpa = 4.0",
        &["compliance_ml_per_kpa", "400 mL", "3.948"],
    ),
    ("id = \"volume_change\"\ncomponent = \"negative\"\nextra_volume_l = -0.4", &["extra_volume_l", "nothing", "0.4"]),
    ("id = \"volume_change\"\ncomponent = \"negative\"\nextra_volume_l = 400.0", &["extra_volume_l", "mL?"]),
    ("id = \"line_resistance\"\ncomponent = \"pump\"\narea_mm2 = 3.0", &["mechanisms.1.port", "inlet", "outlet"]),
    (
        "id = \"line_resistance\"\ncomponent = \"valve_pos\"\nport = \"inlet\"\narea_mm2 = 3.0",
        &["mechanisms.1.port", "no pump"],
    ),
    ("id = \"line_resistance\"\ncomponent = \"valve_pos\"\narea_mm2 = 0.0", &["area_mm2", "0 mm²"]),
    ("id = \"line_resistance\"\ncomponent = \"pump\"\nport = \"side\"\narea_mm2 = 3.0", &["side", "inlet"]),
    ("id = \"critical_ratio\"\ncomponent = \"valve_pos\"\nratio = 1.2", &["ratio", "1.2", "0.528"]),
    ("id = \"check_valve_cracking\"\ncomponent = \"pump\"\ninlet_kpa = -1.0", &["inlet_kpa", "-1 kPa", "difference"]),
    ("id = \"pump_droop\"\ncomponent = \"pump\"\nspeed_loss_per_bar = -0.1", &["speed_loss_per_bar", "-0.1"]),
    ("id = \"pump_speed\"\ncomponent = \"pump\"\nchange_percent = -100.0", &["change_percent", "percent"]),
    ("id = \"pump_speed\"\ncomponent = \"pump\"\nchange_percent = 1.0\ntime_constant_s = -1.0", &["time_constant_s"]),
    ("id = \"sensor_gain\"\ncomponent = \"sensor_pos\"\ngain = 0.0", &["gain", "reads right"]),
    ("id = \"sensor_bias\"\ncomponent = \"valve_pos\"\nbias_kpa = 1.0", &["a sensor", "sensor_pos"]),
    ("id = \"sensor_drift\"\ncomponent = \"sensor_pos\"\nrate_kpa_per_min = nan", &["rate_kpa_per_min", "NaN"]),
    (
        "id = \"actuator_load\"\ncomponent = \"positive\"\nvacuum = \"positive\"\npayload_kg = 5.0",
        &["mechanisms.1.vacuum", "negative"],
    ),
    (
        "id = \"actuator_load\"\ncomponent = \"positive\"\nvacuum = \"negative\"\npayload_kg = 5.0\nstroke_mm = 400.0",
        &["stroke_mm", "0.4 L"],
    ),
    (
        "id = \"residual_flow\"\ncomponent = \"positive\"\nflow_mg_per_s = [1.0]\naxes = [{ variable = \"duty\", of = \"valve_pos\", knots = [0.0, 1.0] }]",
        &["flow_mg_per_s", "1 values", "2 knots"],
    ),
    (
        "id = \"residual_flow\"\ncomponent = \"positive\"\narea_mm2 = [1.0, 2.0]\naxes = [{ variable = \"duty\", of = \"valve_pos\", knots = [0.0, 1.0] }]",
        &["area_mm2", "flow_mg_per_s"],
    ),
    (
        "id = \"residual_flow\"\ncomponent = \"valve_pos\"\narea_mm2 = [1.0, 2.0]\naxes = [{ variable = \"pressure\", of = \"valve_pos\", knots = [0.0, 1.0] }]",
        &["mechanisms.1.axes.1.of", "no volume `valve_pos`"],
    ),
    (
        "id = \"residual_flow\"\ncomponent = \"valve_pos\"\narea_mm2 = [1.0, 2.0]\naxes = [{ variable = \"duty\", of = \"valve_pos\", knots = [1.0, 0.0] }]",
        &["mechanisms.1.axes.1.knots", "each above"],
    ),
];

#[test]
fn wrong_mechanisms_are_refused_by_line_and_key() {
    for (entry, words) in WRONG {
        let text = format!("{DUAL_PRESSURE}\n[[mechanisms]]\n{entry}\n");
        let error = Rig::from_toml(&text).expect_err(entry);
        let message = error.to_string();
        assert!(!message.contains('\n'), "more than one line: {message}");
        for word in words {
            assert!(message.contains(word), "`{word}` is not in: {message}");
        }
        let line = text.lines().nth(error.line.unwrap_or_else(|| panic!("no line in {message}")) - 1).unwrap();
        let at = DUAL_PRESSURE.lines().count();
        assert!(error.line.unwrap() > at, "line {line:?} lies in front of the mechanism: {message}");
    }
}

#[test]
fn twins_are_refused_and_siblings_are_not() {
    let line = |port: &str| {
        format!("[[mechanisms]]\nid = \"line_resistance\"\ncomponent = \"pump\"\nport = \"{port}\"\narea_mm2 = 5.0\n")
    };
    let both = format!("{DUAL_PRESSURE}\n{}{}", line("inlet"), line("outlet"));
    assert!(Rig::from_toml(&both).is_ok(), "one line at each port");
    let twice = format!("{DUAL_PRESSURE}\n{}{}", line("inlet"), line("inlet"));
    let message = Rig::from_toml(&twice).unwrap_err().to_string();
    assert!(message.contains("mechanisms.2") && message.contains("already"), "{message}");
}

#[test]
fn every_mechanism_survives_writing_and_reading() {
    let all: String = crate::mechanisms::ALL
        .iter()
        .map(|(id, component, parameter)| crate::small_rigs::mechanism(id, component, parameter))
        .collect();
    let rig = crate::mechanisms::paper_with(&all);
    assert_eq!(Rig::from_toml(&rig.to_toml().unwrap()).unwrap(), rig);
}

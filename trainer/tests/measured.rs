//! `trainer diagnose` on what others measured, through the rig files of `docs/rigs`, and on small twins of those rigs that
//! our own model makes and that always run.
//!
//! The measured recordings lie beside the repository (`shared/recordings/real`, or where `REAL_RECORDINGS` says) and are
//! never copied into it; those tests run by name (`docs/testing.md`), and without the recordings they say so and end. Each is asked for what its source says is there, not for
//! a number of ours.

// What fails here fails the test, helper functions included.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod program;

use std::path::Path;

use program::{Csv, Folder, elsewhere, sound};
use serde_json::Value;

fn rig(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/rigs").join(name).to_str().unwrap().to_owned()
}

/// Files of a measured set; `None`, told on the test's output, where they are not there.
fn measured(set: &str, names: &[&str]) -> Option<Vec<String>> {
    let folder = elsewhere("REAL_RECORDINGS", "shared/recordings/real")?.join(set);
    Some(names.iter().map(|name| folder.join(name).to_str().unwrap().to_owned()).collect())
}

fn diagnosed(folder: &Folder, rig: &str, recordings: &[String]) -> Value {
    let out = folder.path("found");
    let mut args = vec!["diagnose", "--quick", "--json", "--rig", rig, "--out", &out];
    args.extend(recordings.iter().map(String::as_str));
    let said = sound(args);
    // The rig that comes out runs on the same files.
    let again = folder.path("again.csv");
    let found = format!("{out}/rig.toml");
    sound(["simulate", "--rig", &found, "--refine", "1", "--inputs", &recordings[0], "--out", &again]);
    assert!(Csv::read(&again).rows.len() > 100);
    serde_json::from_str(&said).unwrap()
}

fn ids(said: &Value) -> Vec<&str> {
    said["mechanisms"].as_array().unwrap().iter().map(|m| m["id"].as_str().unwrap()).collect()
}

fn rmse(said: &Value, rig: &str) -> f64 {
    said["fit"][rig]["pos_rmse_kpa"].as_f64().unwrap()
}

/// The value and interval of a parameter of a mechanism.
fn parameter(said: &Value, id: &str, key: &str) -> [f64; 3] {
    let mechanism = said["mechanisms"].as_array().unwrap().iter().find(|m| m["id"] == id).unwrap();
    let p = &mechanism["parameters"][key];
    ["low", "value", "high"].map(|k| p[k].as_f64().unwrap())
}

/// Small even noise from Knuth's MMIX generator, −0.5 … 0.5.
fn noise(seed: &mut u64) -> f64 {
    *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*seed >> 40) as f64 / f64::from(1_u32 << 24) - 0.5
}

/// A closed form: a constant-flow pump whose flow falls to nothing at 30 kPa, `p = 30 (1 − e^(−t/0.8 s))`, recorded as
/// another lab would, every 21 ms under other names. The first model's flow, 1.8 L/min into 0.1 L, starts as fast.
#[test]
fn a_pump_that_stalls_is_found_on_a_closed_form() {
    let folder = Folder::new("stalling");
    let files: Vec<String> = (0..5_u64)
        .map(|n| {
            let mut seed = n + 7;
            let mut text = String::from("Time,Pressure,PWM\n");
            for k in 0..250 {
                let t = 0.021 * f64::from(k);
                let on = (t - 0.1 * n as f64 - 0.0525).max(0.0);
                let p = 30.0 * (1.0 - (-on / 0.8).exp()) + 0.1 * noise(&mut seed);
                text.push_str(&format!("{t:.3},{p:.2},{}\n", if t >= 0.1 * n as f64 + 0.042 { 255 } else { 0 }));
            }
            folder.with(&format!("{n}.csv"), text)
        })
        .collect();
    let said = diagnosed(&folder, &rig("softbot_pump.toml"), &files);
    assert!(ids(&said).contains(&"pump_droop"), "{said:#}");
    // 1/0.3 bar; a hundredth for a command that acts within a row.
    let [_, droop, _] = parameter(&said, "pump_droop", "speed_loss_per_bar");
    assert!((droop * 0.3 - 1.0).abs() < 0.01, "{droop}");
    assert!(rmse(&said, "reidentified") > 3.0 && rmse(&said, "extended") < 0.3, "{said:#}");
}

/// The compliance in the rig that came out.
fn compliance_within(folder: &Folder, expected: f64, share: f64) {
    let text = std::fs::read_to_string(folder.path("found/rig.toml")).unwrap();
    let line = text.lines().find(|line| line.starts_with("compliance_ml_per_kpa")).unwrap();
    let found: f64 = line.split('=').nth(1).unwrap().trim().parse().unwrap();
    assert!((found / expected - 1.0).abs() < share, "{found} mL/kPa instead of {expected}");
}

#[test]
#[ignore = "minutes, on recordings that are not part of the repository; run by name"]
fn softbot_the_pump_gives_way_to_back_pressure() {
    let names = ["sweep_ki_300", "sweep_kp_10", "sweep_kp_20", "sweep_ki_400", "sweep_kp_25", "sweep_kp_30"];
    let names = names.map(|name| format!("{name}.csv"));
    let Some(files) = measured("softbot_pump_50hz", &names.each_ref().map(String::as_str)) else { return };
    let folder = Folder::new("softbot");
    let said = diagnosed(&folder, &rig("softbot_pump.toml"), &files);
    assert_eq!(said["verdict"], "missing_physics", "{said:#}");
    assert!(ids(&said).contains(&"pump_droop"), "{said:#}");
    // The recorded pressures end at 29.3 … 30.1 kPa.
    let [_, droop, _] = parameter(&said, "pump_droop", "speed_loss_per_bar");
    assert!((28.5..31.0).contains(&(100.0 / droop)), "{droop}");
    assert!(rmse(&said, "extended") < 0.55 && rmse(&said, "reidentified") > 3.0, "{said:#}");
}

#[test]
#[ignore = "minutes, on recordings that are not part of the repository; run by name"]
fn respiraworks_the_resistance_is_not_linear_and_the_compliance_stays() {
    let Some(files) = measured("respiraworks_ventilator", &["rfr2_oxy_pc2.csv"]) else { return };
    let folder = Folder::new("respiraworks");
    let said = diagnosed(&folder, &rig("ventilator_c50_r20.toml"), &files);
    assert_eq!(ids(&said), ["line_resistance"], "{said:#}");
    assert_eq!(said["mechanisms"][0]["component"], "airway");
    assert!(rmse(&said, "extended") < 0.85 * rmse(&said, "reidentified"), "{said:#}");
    // Knob 50 mL/cmH2O, 510 mL/kPa with its litre of gas; a straight fit of the source gives 46.
    compliance_within(&folder, 480.0, 0.1);
    // The same resistor in front of a stiffer lung, asked by itself, is as wide.
    let Some(files) = measured("respiraworks_ventilator", &["rfr2_oxy_pc4.csv"]) else { return };
    let folder = Folder::new("respiraworks-stiff");
    let stiff = diagnosed(&folder, &rig("ventilator_c20_r20.toml"), &files);
    assert_eq!(ids(&stiff), ["line_resistance"], "{stiff:#}");
    let [[low, _, high], [stiff_low, _, stiff_high]] =
        [&said, &stiff].map(|said| parameter(said, "line_resistance", "area_mm2"));
    assert!(low < stiff_high && stiff_low < high, "{low} … {high} and {stiff_low} … {stiff_high} mm²");
}

#[test]
#[ignore = "minutes, on recordings that are not part of the repository; run by name"]
fn respiraworks_the_obstruction_is_told_by_when() {
    let Some(files) = measured("respiraworks_ventilator", &["obstruction.csv"]) else { return };
    let folder = Folder::new("obstruction");
    let said = diagnosed(&folder, &rig("ventilator_obstruction.toml"), &files);
    let place = &said["location"][0];
    assert!(place["region"].as_str().unwrap().starts_with("an event"), "{said:#}");
    let [from, to] = [0, 1].map(|n| place["time_s"][n].as_f64().unwrap());
    // Breaths are 3 s apart: disturbed are those from 5 s on, the last of them ends before 15 s.
    assert!((4.0..6.5).contains(&from) && (12.0..15.0).contains(&to), "{from} {to}");
    // Where is told by the balance that is off; that it was the airway behind it, no single change tells well enough.
    assert_eq!(place["component"], "circuit", "{said:#}");
}

/// From a model that opens in proportion. The firmware never goes below 0.05 of the command, for the valve's hysteresis; flow begins
/// between 0.06 and 0.1.
#[test]
#[ignore = "minutes, on recordings that are not part of the repository; run by name"]
fn respiraworks_the_solenoid_has_a_dead_zone_and_play() {
    let names = ["control_oxy_pc1.csv", "control_oxy_pc2.csv", "control_oxy_pc3.csv", "control_oxy_pc4.csv"];
    let Some(files) = measured("respiraworks_ventilator", &names) else { return };
    let folder = Folder::new("solenoid");
    let said = diagnosed(&folder, &rig("ventilator_solenoid.toml"), &files);
    let mut found = ids(&said);
    found.sort_unstable();
    assert_eq!(found, ["dead_zone", "valve_hysteresis"], "{said:#}");
    let [_, closed, _] = parameter(&said, "dead_zone", "closed_duty");
    assert!((0.05..0.1).contains(&closed), "{closed}");
    assert!(rmse(&said, "extended") < 0.8 * rmse(&said, "reidentified"), "{said:#}");
}

/// The prior of `valve_hysteresis` is what these two calibrations say.
#[test]
#[ignore = "minutes, on recordings that are not part of the repository; run by name"]
fn pvp_calibrations_give_the_priors_width() {
    let names = ["deluca_PVQ31_command_to_duty_lut.csv", "pvp_PVQ31_duty_vs_flow_dlite_rig.csv"];
    let Some(files) = measured("pvp_valve_calibration", &names) else { return };
    let (table, flows) = (Csv::read(&files[0]), Csv::read(&files[1]));
    let levels: Vec<f64> = (2..=18).map(|k| 5.0 * f64::from(k)).collect();
    // Half the distance in duty at 10, 15 … 90 % of the command.
    let command = table.numbers("valve_command_percent");
    let (rising, falling) = (table.numbers("col1_duty_rising"), table.numbers("col2_duty_falling"));
    let at = |level: f64| command.iter().position(|c| *c == level).unwrap();
    let one: Vec<f64> = levels.iter().map(|l| 0.5 * (rising[at(*l)] - falling[at(*l)])).collect();
    // And at as many levels of the largest flow, between the two branches' first crossings of it.
    let duty = flows.numbers("duty");
    let branches = ["flow_rising_raw", "flow_falling_raw"].map(|name| flows.numbers(name));
    let most = branches.iter().flatten().fold(0.0, |most: f64, flow| most.max(-flow));
    let crossing = |flow: &[f64], level: f64| {
        let i = (1..flow.len()).find(|i| -flow[*i] >= level && -flow[i - 1] < level).unwrap();
        duty[i - 1] + (duty[i] - duty[i - 1]) * (-level - flow[i - 1]) / (flow[i] - flow[i - 1])
    };
    let other = levels
        .iter()
        .map(|l| 0.5 * (crossing(&branches[0], 0.01 * l * most) - crossing(&branches[1], 0.01 * l * most)));
    let square = other.map(|w| w * w).sum::<f64>() / levels.len() as f64;
    let logs = [one.iter().map(|w| w.ln()).sum::<f64>() / levels.len() as f64, 0.5 * square.ln()];
    let (mean, sd) = ((0.5 * (logs[0] + logs[1])).exp(), 0.5 * (logs[0] - logs[1]));
    let paper = model::rig::Rig::builtin("dual_pressure").unwrap();
    let offered = model::mechanism::candidates(&paper).into_iter().find(|c| c.id == "valve_hysteresis").unwrap();
    let [usual, log_sd] = offered.parameters[0].usual.unwrap();
    // Rounded to what two valves can tell.
    assert!((usual / mean - 1.0).abs() < 0.05 && (log_sd - sd).abs() < 0.05, "{mean} {sd}");
}

/// Tests of the thorough tier (docs/testing.md).
mod thorough {
    use super::*;

    /// A lung breathed through `Δp = 0.5 Q + 1.5 Q|Q|` kPa (Q in L/s), worked out here in steps of 0.1 ms: an implicit circuit
    /// of 10 mL/kPa and a lung of 480 mL/kPa, none of the model's code.
    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn a_parabolic_resistor_is_found_and_the_compliance_left_alone() {
        let folder = Folder::new("parabolic");
        let (circuit, lung) = (0.010, 0.480);
        let mut seed = 3;
        let (mut p, mut p_lung) = (0.6_f64, 0.6_f64);
        let mut text = String::from("time(sec),pressure,net_flow\n");
        for k in 0..3000_u32 {
            let t = 0.01 * f64::from(k);
            let phase = (t / 3.1).fract();
            let depth = 0.6 + 0.4 * (0.37 * t).sin();
            // In for a second, then out: an exponential of equal volume.
            let out = 0.33 * (-(phase - 0.33) / 0.3).exp() / 0.3 / (1.0 - (-0.67_f64 / 0.3).exp());
            let q = depth * if phase < 0.33 { 1.0 } else { -out };
            text.push_str(&format!("{t:.2},{:.3},{:.3}\n", (p + 0.02 * noise(&mut seed)) / 0.098_066_5, 1e3 * q));
            for _ in 0..100 {
                let h = 1e-4;
                // Flow after the step from a quadratic in |Q|, so that the fast circuit stays stable.
                let drive = p + h * q / circuit - p_lung;
                let linear = 0.5 + h / circuit + h / lung;
                let q_lung = drive.signum() * (-linear + (linear * linear + 6.0 * drive.abs()).sqrt()) / 3.0;
                p += h * (q - q_lung) / circuit;
                p_lung += h * q_lung / lung;
            }
        }
        let file = folder.with("lung.csv", text);
        let said = diagnosed(&folder, &rig("ventilator_c50_r20.toml"), &[file]);
        assert_eq!(ids(&said), ["line_resistance"], "{said:#}");
        assert_eq!(said["mechanisms"][0]["component"], "airway");
        // P₁² − P₂² = R T (ṁ/A)² is 2 P ΔP at these pressures: K = ρ/(2 A²) kPa/(L/s)², A = 20 mm² for 1.5.
        let [_, area, _] = parameter(&said, "line_resistance", "area_mm2");
        assert!((area / 20.0 - 1.0).abs() < 0.1, "{area}");
        assert!(rmse(&said, "extended") < 0.5 * rmse(&said, "reidentified"), "{said:#}");
        compliance_within(&folder, 480.0 - 9.9, 0.05);
    }

    /// A solenoid with play that opens at 0.08 of its command, into a meter of which it fills 1 kPa. In closed form: with `v` the command
    /// behind a play of half width 0.03, `a = 2 (v − 0.08)` mm² of an opening that ends at 1/1.15 mm² pass the choked flow from 446 kPa,
    /// 0.875 L/s per mm², through 1.5 kPa s/L. Errors of a tenth of a kPa are much there.
    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn a_dead_zone_and_play_are_found_behind_a_meter_that_reads_little() {
        let folder = Folder::new("solenoid-twin");
        let files: Vec<String> = (0..3_u64)
            .map(|n| {
                let mut seed = n + 11;
                let mut text = String::from("time(sec),cmd_psol,dp_inhale\n");
                let mut v: f64 = 0.0;
                for k in 0..1000_u32 {
                    let t = 0.02 * f64::from(k);
                    let phase = (t / 2.9 + 0.3 * n as f64).fract();
                    let most = 0.35 + 0.2 * (0.41 * t + n as f64).sin();
                    let u = most * (4.0 * (phase - 0.15)).min(3.0 * (0.85 - phase)).clamp(0.0, 1.0);
                    // A command acts from its row on: the reading there is what the one before has come to.
                    let a = 2.0 * (v - 0.08).max(0.0);
                    let p = 1.313 * a / (1.0 + (1.15 * a).powi(4)).powf(0.25) + 0.01 * noise(&mut seed);
                    let root_of_cm_h2o = p / 0.441_25;
                    text.push_str(&format!("{t:.2},{u:.4},{:.5}\n", root_of_cm_h2o * root_of_cm_h2o.abs()));
                    v = v.clamp(u - 0.03, u + 0.03);
                }
                folder.with(&format!("{n}.csv"), text)
            })
            .collect();
        let said = diagnosed(&folder, &rig("ventilator_solenoid.toml"), &files);
        let mut found = ids(&said);
        found.sort_unstable();
        assert_eq!(found, ["dead_zone", "valve_hysteresis"], "{said:#}");
        for (id, key, truth) in [("dead_zone", "closed_duty", 0.08), ("valve_hysteresis", "half_width_duty", 0.03)] {
            let [_, value, _] = parameter(&said, id, key);
            assert!((value / truth - 1.0).abs() < 0.02, "{id}: {value} instead of {truth}");
        }
    }
}

//! Parameters found beside parameters concealed, where both mean the same.
//!
//! The hidden rig has laws of its own (relays for a play, a hole for a gap, a curve of another form), so not every number
//! of a truth has its like in a rig file. Those that do are compared: the error relative to the truth, and whether the
//! stated 90 % interval holds it. Where the laws are close but not the same the error is stated and the interval is not
//! held to account.

use hidden_rig::build_sheet::BuildSheet;
use hidden_rig::effects::chambers::{LeakLaw, laminar_like};
use hidden_rig::effects::{Effect, Place};
use hidden_rig::truth::{Planted, Truth};
use serde::{Deserialize, Serialize};

use crate::diagnosis::Named;

/// A number found beside its truth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Compared {
    /// Id of the mechanism.
    pub id: String,
    /// Name of the parameter in the diagnosis.
    pub parameter: String,
    /// Unit of both.
    pub unit: String,
    /// Value that was concealed.
    pub truth: f64,
    /// Value that was found.
    pub found: f64,
    /// Error relative to the truth (of a gain: to its distance from 1).
    pub relative_error: f64,
    /// True where the 90 % interval holds the truth; absent where the laws differ or no interval is stated.
    pub covered: Option<bool>,
}

/// Number of a truth that one of a diagnosis is held against.
struct Like {
    /// A part of the parameter's name.
    name: &'static str,
    /// Value in the unit of the rig file (ms, litres …).
    value: f64,
    unit: &'static str,
    /// True where both laws are the same.
    same_law: bool,
    /// Scale that errors are relative to, if not the value.
    scale: Option<f64>,
}

impl Like {
    fn same(name: &'static str, value: f64, unit: &'static str) -> Self {
        Self { name, value, unit, same_law: true, scale: None }
    }

    fn close(name: &'static str, value: f64, unit: &'static str) -> Self {
        Self { same_law: false, ..Self::same(name, value, unit) }
    }
}

/// The number of an effect that a rig file would state, if it has one, in the shape that was `named`.
fn like(effect: &Effect, place: Place, build: &BuildSheet, named: &Named) -> Option<Like> {
    let like = match effect {
        // Relays of many widths against one play or five.
        Effect::ValveHysteresis(h) => Like::close("width", h.half_width_duty, "duty"),
        Effect::ValveStiction(s) => Like::close("band", s.band_duty, "duty"),
        // A falling current is up to 15 % slower.
        Effect::ValveLag(lag) => {
            let mean_s = lag.time_constant_s * 0.5 * (1.0 + lag.fall_over_rise);
            Like { same_law: lag.fall_over_rise < 1.05, ..Like::close("time_constant", 1e3 * mean_s, "ms") }
        }
        Effect::CommandDelay(delay) => Like::same("delay", 1e3 * delay.delay_s, "ms"),
        // Resistance rises by r, so the force that is lost is r/(1 + r).
        Effect::CoilHeating(heat) => Like::close("loss", heat.resistance_rise / (1.0 + heat.resistance_rise), "1"),
        Effect::SupplySag(sag) => Like::close("loss", sag.loss_per_duty, "1/duty"),
        Effect::ChamberLeak(leak) if leak.law == LeakLaw::Laminar => {
            Like::same("conductance", laminar_like(leak.area_m2), "kg/(s Pa^2)")
        }
        Effect::CrossLeak(leak) => Like::same("conductance", laminar_like(leak.area_m2), "kg/(s Pa^2)"),
        Effect::PistonBlowby(leak) => Like::same("conductance", laminar_like(leak.area_m2), "kg/(s Pa^2)"),
        Effect::ChamberThermal(thermal) => Like::same("conductance", thermal.wall_conductance_w_k, "W/K"),
        // 1 m³/Pa is 1e9 mL/kPa.
        Effect::VolumeCompliance(walls) => Like::same("compliance", 1e9 * walls.compliance_m3_pa, "mL/kPa"),
        Effect::VolumeChange(change) => {
            let volume_l = 1e3 * build.volume_m3[*place.channels().first()?];
            Like::close("volume", change.relative * volume_l, "L")
        }
        Effect::CriticalRatio(ratio) => Like::close("ratio", ratio.critical_ratio, "1"),
        Effect::CheckValveCracking(cracking) => Like::close("inlet", 1e-3 * cracking.cracking_pa, "kPa"),
        Effect::PumpDroop(droop) => Like::same("per_bar", droop.droop_per_bar, "1/bar"),
        Effect::PumpSpeed(speed) if speed.warming_time_s.is_none() => {
            Like::same("percent", 100.0 * speed.sign * speed.relative, "%")
        }
        // A snubber and a cavity a tenth as slow behind it, or both in one.
        Effect::SensorLag(lag) if named.parameters.iter().any(|(name, _)| name.contains("second_time_constant")) => {
            Like::same("time_constant", 1e3 * lag.time_constant_s, "ms")
        }
        Effect::SensorLag(lag) => Like::close("time_constant", 1.1e3 * lag.time_constant_s, "ms"),
        Effect::SensorBias(bias) => Like::same("bias", bias.sign * bias.size_kpa, "kPa"),
        Effect::SensorGain(gain) => {
            Like { scale: Some(gain.relative), ..Like::same("gain", 1.0 + gain.sign * gain.relative, "1") }
        }
        _ => return None,
    };
    Some(like)
}

/// Factor from a stated unit to the rig file's, for the few that have another customary form.
fn to_unit(stated: &str, unit: &str) -> f64 {
    match (stated.trim(), unit) {
        ("s", "ms") => 1e3,
        ("mL" | "ml", "L") => 1e-3,
        ("Pa", "kPa") => 1e-3,
        ("%", "1" | "duty" | "1/duty" | "1/bar") => 1e-2,
        _ => 1.0,
    }
}

/// Compares what a named mechanism states with the planted effect that it stands for.
pub fn compare(named: &Named, planted: &Planted, truth: &Truth) -> Option<Compared> {
    let like = like(&planted.effect, planted.place, &truth.build, named)?;
    let parameters = &named.parameters;
    let begins = parameters.iter().find(|(name, _)| name.starts_with(like.name));
    let (name, found) = begins.or_else(|| parameters.iter().find(|(name, _)| name.contains(like.name)))?;
    let factor = to_unit(&found.unit, like.unit);
    // `half_width` is what a truth states; a whole width is twice that.
    let whole = if like.name == "width" && !name.contains("half") { 0.5 } else { 1.0 };
    let scaled = |value: f64| value * factor * whole;
    let value = scaled(found.value);
    let interval = found.low.zip(found.high).filter(|_| like.same_law);
    Some(Compared {
        id: named.id.clone(),
        parameter: name.clone(),
        unit: like.unit.to_owned(),
        truth: like.value,
        found: value,
        relative_error: (value - like.value).abs() / like.scale.unwrap_or(like.value.abs()).max(f64::MIN_POSITIVE),
        covered: interval.map(|(low, high)| (scaled(low)..=scaled(high)).contains(&like.value)),
    })
}

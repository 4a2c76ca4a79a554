//! The rigs of a trial, drawn around the model; always the same ones for a model.
//!
//! | bundle | rigs |
//! | --- | --- |
//! | 0 | the model; the model a tick later; six with parameters off by up to a fifth, half of them a tick later |
//! | 1 | valves that are worn as well: lag up to 50 ms, backlash up to 0.03 of duty, parameters off by up to a tenth |
//!
//! Parameters are volumes and check valves, each by itself, and the flow of each valve as a whole: its three coefficients
//! by one factor. (Each by itself would move the duty at which a valve begins to open by a third of its range, which no
//! valve of the same type does.) The opening is moved by up to 0.02 of duty on top.

use model::rig::{Pump, Rig, RigError};

use crate::draw::Draw;

/// Rigs of a bundle.
pub const LANES: usize = 8;
/// Bundles of a trial.
pub const BUNDLES: usize = 2;
/// Seed of the draws: the same rigs for everybody who is compared.
const SEED: u64 = 44;
/// Share by which parameters are drawn in each bundle.
const SPREAD: [f64; BUNDLES] = [0.2, 0.1];
/// Distance by which a valve's opening is moved, in duty.
const OPENING_DUTY: f64 = 0.02;
/// The slowest valve, time constant in ms, and the widest backlash, half width in duty.
const LAG_MS: f64 = 50.0;
const BACKLASH_DUTY: f64 = 0.03;

/// A rig with what is wrong with its valves beside what its file says.
#[derive(Debug, Clone, PartialEq)]
pub struct Drawn {
    /// The rig.
    pub rig: Rig,
    /// Ticks by which commands come late.
    pub delay_ticks: usize,
    /// Time constant of both valves in ms, on top of the file's.
    pub lag_ms: f64,
    /// Half width of both valves' backlash in duty, on top of the file's.
    pub backlash_duty: f64,
}

/// The rigs of all bundles.
///
/// # Errors
/// If a drawn rig is unsound.
pub fn drawn(model: &Rig) -> Result<[Vec<Drawn>; BUNDLES], RigError> {
    let plain = |delay_ticks| Drawn { rig: model.clone(), delay_ticks, lag_ms: 0.0, backlash_duty: 0.0 };
    let mut draw = Draw::new(SEED);
    let mut first = vec![plain(0), plain(1)];
    for lane in first.len()..LANES {
        first.push(Drawn { rig: varied(model, SPREAD[0], &mut draw)?, ..plain(lane % 2) });
    }
    let mut second = Vec::new();
    for lane in 0..LANES {
        // From hardly worn to fully.
        let worn = (lane + 1) as f64 / LANES as f64;
        second.push(Drawn {
            rig: varied(model, SPREAD[1], &mut draw)?,
            lag_ms: LAG_MS * worn,
            backlash_duty: BACKLASH_DUTY * worn,
            ..plain(lane % 2)
        });
    }
    Ok([first, second])
}

fn varied(model: &Rig, spread: f64, draw: &mut Draw) -> Result<Rig, RigError> {
    let mut rig = model.clone();
    for volume in rig.volumes.values_mut() {
        volume.volume_l *= draw.about_one(spread);
    }
    for pump in rig.pumps.values_mut() {
        if let Pump::Piston(piston) = pump {
            piston.inlet_check_area_mm2 *= draw.about_one(spread);
            piston.outlet_check_area_mm2 *= draw.about_one(spread);
        }
    }
    for valve in rig.valves.values_mut() {
        let flow = draw.about_one(spread);
        valve.input_area_mm2 *= flow;
        valve.pressure_area_mm2_per_n *= flow;
        // The spring holds the valve shut up to the duty at which the input's area outweighs its.
        valve.spring_area_mm2 = flow * valve.spring_area_mm2 + OPENING_DUTY * draw.signed() * valve.input_area_mm2;
    }
    rig.check()?;
    Ok(rig)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rigs_are_around_the_model_and_the_same_each_time() {
        let model = Rig::builtin("dual_pressure").unwrap();
        let bundles = drawn(&model).unwrap();
        assert_eq!(bundles, drawn(&model).unwrap());
        assert_eq!(bundles[0][0].rig, model);
        for (bundle, spread) in bundles.iter().zip(SPREAD) {
            assert_eq!(bundle.len(), LANES);
            for drawn in bundle {
                for (name, volume) in &drawn.rig.volumes {
                    let ratio = volume.volume_l / model.volumes[name].volume_l;
                    assert!((1.0 - spread..=1.0 + spread).contains(&ratio), "{ratio}");
                }
            }
        }
        assert!(bundles[1].iter().all(|d| d.lag_ms > 0.0 && d.backlash_duty > 0.0));
    }
}

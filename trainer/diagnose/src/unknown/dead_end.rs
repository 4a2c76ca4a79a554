//! A dead end of a chamber: a room that nothing passes through, behind a narrow passage (a filter's housing, a capped branch, an
//! actuator that nobody counted). No mechanism of the library; the rig file says it with a volume and a laminar line,
//!
//! ```text
//! ṁ = (p² − p_room²) / (2 R T ζ),        V dp_room/dt = R T ṁ,        time constant near a pressure p̄: ζ V / p̄
//! ```
//!
//! Gas that comes and goes by a passage of a second is warm gas, or a leak that ends, to whoever knows no dead ends. Sizes are
//! first looked up with all other parameters giving way to first order; only the best is fitted in free runs.

use fit::parameters::{Knowledge, Parameter, SearchRange, Transform};
use fit::simulate::Run;
use model::rig::{Line, Rig, Volume};

use super::{UnknownTerm, fit_further, told};
use crate::bench::{Bench, Explanation};
use crate::search::quick_search::weighted;
use crate::search::screen::Projector;

/// Volumes that are looked at, as shares of the chamber's.
const SHARES: [f64; 4] = [0.03, 0.1, 0.3, 1.0];
/// Time constants that are looked at, in s.
const TIME_CONSTANTS_S: [f64; 5] = [0.2, 0.6, 1.8, 5.4, 16.0];
/// Log-likelihood, to first order, that is worth a fit.
const WORTH: f64 = 50.0;
/// Standard deviation of the logarithm of volume and resistance: as good as nothing is known of them.
const KNOWN: f64 = 1.5;

/// A dead end at a chamber.
struct DeadEnd<'a> {
    chamber: &'a str,
    volume_l: f64,
    resistance_kpa_s_per_l: f64,
}

impl DeadEnd<'_> {
    /// The name of the room and of the passage to it in a rig.
    fn name(&self) -> String {
        format!("dead_end_{}", self.chamber)
    }

    /// The rig with it; `None` where it has one there.
    fn put_into(&self, rig: &Rig) -> Option<Rig> {
        let name = self.name();
        let temperature_k = rig.volumes.get(self.chamber)?.temperature_k;
        if rig.volumes.contains_key(&name) || rig.lines.contains_key(&name) {
            return None;
        }
        let mut rig = rig.clone();
        let room = Volume { volume_l: self.volume_l, temperature_k, compliance_ml_per_kpa: 0.0 };
        let passage = Line::Laminar {
            from: self.chamber.to_owned(),
            to: name.clone(),
            resistance_kpa_s_per_l: self.resistance_kpa_s_per_l,
        };
        rig.volumes.insert(name.clone(), room);
        rig.lines.insert(name, passage);
        Some(rig)
    }
}

/// Fits a dead end of the chamber that gains most by one; `None` where none does.
pub(super) fn fit_dead_end(bench: &Bench<'_>, base: &Explanation) -> Option<UnknownTerm> {
    let (dead_end, shift) = look(bench, base)?;
    let rig = dead_end.put_into(&base.fitted.rig)?;
    let (name, known) = (dead_end.name(), base.set.len());
    let numbers = [
        (format!("volumes.{name}.volume_l"), dead_end.volume_l),
        (format!("lines.{name}.resistance_kpa_s_per_l"), dead_end.resistance_kpa_s_per_l),
    ];
    let own = numbers.map(|(path, mean)| Parameter {
        path,
        transform: Transform::Log,
        mean,
        knowledge: Knowledge::Prior { sd: KNOWN },
        bounds: [1e-3 * mean, 1e3 * mean],
        range: SearchRange::Whole,
    });
    let explanation = fit_further(bench, base, &rig, own, [base.moved(&shift), base.fitted.point.clone()]).ok()?;
    let depends_on = format!(
        "a dead end of the {} chamber, a room of {} L behind a passage of {} kPa s/L, by which gas comes and goes",
        dead_end.chamber,
        told(&explanation, known),
        told(&explanation, known + 1)
    );
    Some(UnknownTerm { explanation, depends_on, reading: None })
}

/// The dead end that explains most of what `base` leaves, and what the other parameters give way by to it.
fn look<'b>(bench: &'b Bench<'_>, base: &Explanation) -> Option<(DeadEnd<'b>, Vec<f64>)> {
    let fitted = &base.fitted;
    let projector = Projector::of(fitted, &base.set.prior())?;
    let still = bench.fast.one(&fitted.rig, &fitted.arcs).ok()?;
    let weights = bench.weighted(&fitted.scale_kpa);
    let layout = bench.records.layout();
    let readings = bench.records.readings_kpa();
    let mut tries = Vec::new();
    for (channel, chamber) in bench.rig.sensors.values().map(|sensor| sensor.volume.as_str()).enumerate() {
        let Some(volume) = fitted.rig.volumes.get(chamber) else { continue };
        let of_channel: Vec<f64> = (0..layout.records())
            .flat_map(|record| readings.get(layout.channel(record, channel)).unwrap_or_default())
            .copied()
            .collect();
        let usual_kpa_abs =
            fitted.rig.atmosphere.pressure_kpa_abs + of_channel.iter().sum::<f64>() / of_channel.len().max(1) as f64;
        for (share, time_constant_s) in SHARES.iter().flat_map(|s| TIME_CONSTANTS_S.map(|t| (s, t))) {
            let volume_l = share * volume.volume_l;
            let resistance_kpa_s_per_l = time_constant_s * usual_kpa_abs / volume_l;
            tries.push(DeadEnd { chamber, volume_l, resistance_kpa_s_per_l });
        }
    }
    let (tries, runs): (Vec<_>, Vec<Run>) = tries
        .into_iter()
        .filter_map(|dead_end| dead_end.put_into(&fitted.rig).map(|rig| (dead_end, Run::from(rig))))
        .unzip();
    let traces = bench.fast.run(&runs, &fitted.arcs);
    let gains = tries.into_iter().zip(traces).filter_map(|(dead_end, trace)| {
        let (gain, shift) = projector.as_is(&weighted(&still, &trace.ok()?, &[], &weights));
        (gain.is_finite() && gain > WORTH).then_some((gain, dead_end, shift))
    });
    gains.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, dead_end, shift)| (dead_end, shift))
}

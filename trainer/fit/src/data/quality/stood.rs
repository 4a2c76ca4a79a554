//! Pressures that stand at the atmosphere while the recorded commands say that the pump runs.
//!
//! The logger is started, then the pump; or the pump is switched off and the logger runs on. Where the recording does not say so, a run
//! from its commands is off by all that the pump does, and a fit takes that up in whatever parameter comes nearest. Pressures that never
//! leave the atmosphere are another matter: they may be in a larger unit.

use model::rig::{Pump, Rig};

use super::expected::Expected;
use super::{Finding, Severity, Trouble, median};
use crate::data::{Noise, Records};

/// Rows for which all pressures must stand: 1 s.
const ROWS: usize = 50;
/// Largest pressure that is none, in kPa and as a share of the sensor's range, whichever is less …
const AT_REST_KPA: f64 = 0.5;
const AT_REST_SHARE: f64 = 0.01;
/// … and in deviations of the noise.
const NOISES: f64 = 5.0;
/// Factor by which a running pump must make more of it.
const RUNS: f64 = 10.0;

/// Adds a finding for each recording in which the pump stood unseen.
pub(super) fn check(
    rig: &Rig,
    records: &Records,
    noise: &[Noise],
    expected: &Expected<'_>,
    findings: &mut Vec<Finding>,
) {
    let Some((name, pump)) = rig.pumps.iter().next() else { return };
    let margins: Vec<f64> =
        records.sensors().iter().enumerate().map(|(at, column)| margin(rig, noise, at, column)).collect();
    for (record, r) in records.records().iter().enumerate() {
        let channels: Vec<&[f64]> = (0..margins.len()).map(|channel| records.channel_kpa(record, channel)).collect();
        let stands = |row: &usize| {
            channels.iter().zip(&margins).all(|(values, margin)| values.get(*row).is_some_and(|p| p.abs() <= *margin))
        };
        // A pressure that never leaves the atmosphere says nothing of the pump.
        let leaves: Vec<bool> = channels
            .iter()
            .zip(&margins)
            .map(|(values, margin)| values.iter().any(|p| p.abs() > RUNS * margin))
            .collect();
        let runs = r.segments.iter().flat_map(|segment| {
            let rows: Vec<usize> = segment.clone().collect();
            let runs: Vec<Vec<usize>> = rows.chunk_by(|a, b| stands(a) == stands(b)).map(<[usize]>::to_vec).collect();
            runs
        });
        for run in runs.filter(|run| run.len() >= ROWS && run.first().is_some_and(stands)) {
            let (Some(first), Some(last)) = (run.first().copied(), run.last().copied()) else { continue };
            // The pump takes some tenths of a second to move anything.
            let settled = first + ROWS / 2..last + 1;
            let would = (0..margins.len()).filter(|channel| leaves.get(*channel) == Some(&true)).find_map(|channel| {
                let kpa = median(expected.channel_kpa(record, channel)?.get(settled.clone())?);
                (kpa.abs() > RUNS * margins.get(channel)?).then_some((channel, kpa))
            });
            let Some((channel, kpa)) = would else { continue };
            let at = |row: usize| r.time_s.get(row).copied().unwrap_or(0.0);
            let column = records.sensors().get(channel).map_or("", String::as_str);
            findings.push(Finding {
                source: r.source.clone(),
                column: String::new(),
                severity: Severity::Unusable,
                trouble: Trouble::PumpStood,
                text: format!(
                    "all pressures stand at the atmosphere from {:.2} to {:.2} s, where {column} would be at {kpa:.1} kPa by the recorded \
                     commands: was the pump off? {}, or leave these rows out",
                    at(first),
                    at(last),
                    mend(name, pump)
                ),
            });
            break;
        }
    }
}

/// Largest pressure of a channel that is none, in kPa.
fn margin(rig: &Rig, noise: &[Noise], channel: usize, column: &str) -> f64 {
    let sensor = rig.sensor_of(column).map(|(_, sensor)| sensor);
    let range_kpa = sensor.map_or(f64::INFINITY, |s| (s.range_kpa_gauge[0] - s.range_kpa_gauge[1]).abs());
    let of_noise = NOISES * noise.get(channel).map_or(0.0, |n| n.sigma_kpa);
    AT_REST_KPA.min(AT_REST_SHARE * range_kpa).max(of_noise)
}

/// Advice on how a recording says that a pump stood.
fn mend(name: &str, pump: &Pump) -> String {
    match pump {
        Pump::Piston(piston) => match &piston.relay {
            // A recording without the column counts as one in which it says 1 throughout.
            Some(relay) => format!("Say so in the column {relay} (1 on, 0 off)"),
            None => format!(
                "Give it a relay in the rig file, [pumps.{name}] relay = \"pump_on\", and a column of that name (1 on, 0 off)"
            ),
        },
        Pump::Flow(_) => "Check its command".to_owned(),
    }
}

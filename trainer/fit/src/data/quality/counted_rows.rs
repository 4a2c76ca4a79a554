//! A count of rows in the place of seconds, told by the way the rig would go.
//!
//! A column that is called `time_s` and holds 0, 1, 2 … may be of a logger that writes a row a second, and may count rows of 20 ms. The
//! commands tell: run once with a row a second and once with a row every 20 ms, the rig follows the readings in one of the two.

use model::rig::Rig;
use proto::recording::Recording;

use crate::FitError;
use crate::data::Records;
use crate::simulate::{Arcs, Fidelity, Simulator};

/// Samples that are looked at: more take long and tell no more.
const SAMPLES: usize = 600;
/// Fewer tell nothing.
const LEAST_SAMPLES: usize = 50;
/// Share of its error with a row a second that the rig is off by at most, where rows are counted.
const CLEARLY: f64 = 0.5;

/// Refuses recordings whose seconds count rows; those without readings tell nothing.
///
/// # Errors
/// The first such recording, with the key that says so, or a rig that cannot be simulated.
pub fn seconds_are_no_count(rig: &Rig, recordings: &[Recording]) -> Result<(), FitError> {
    let has_readings = |r: &&Recording| rig.sensors.values().all(|sensor| r.column(&sensor.column).is_some());
    for recording in recordings.iter().filter(|r| r.may_count_rows()).filter(has_readings) {
        let records = Records::new(rig, std::slice::from_ref(recording))?;
        let Some(r) = records.records().first() else { continue };
        let Some(first) = r.segments.first() else { continue };
        let rows: Vec<usize> = first.clone().filter(|row| r.is_measured(*row)).take(SAMPLES).collect();
        let Some(last) = rows.last().filter(|_| rows.len() >= LEAST_SAMPLES) else { continue };
        let (alone, _) = records.parts(&[(0, 0..last + 1)]);
        let Some(counted) = records.counted(0, &rows) else { continue };
        let every: Vec<usize> = (0..rows.len()).collect();
        let (as_read, as_counted) = (off_kpa(rig, &alone, &rows)?, off_kpa(rig, &counted, &every)?);
        if as_counted < CLEARLY * as_read {
            return Err(FitError::Unusable(format!(
                "{}: time_s: seems to count rows: pressures follow the commands as they do at a row every 20 ms, and not at a row a \
                 second: [recording] time = {{ from = \"time_s\", scale = 0.02 }}, or unit = \"s\" if these are seconds",
                r.source
            )));
        }
    }
    Ok(())
}

/// Distance of the rig from a recording's readings at some rows (kPa): mean of all channels.
fn off_kpa(rig: &Rig, records: &Records, rows: &[usize]) -> Result<f64, FitError> {
    let trace = Simulator::new(records, Fidelity::Coarse).one(rig, &Arcs::free(records))?;
    let of = |channel: usize| {
        let simulated = trace.get(records.layout().channel(0, channel)).unwrap_or_default();
        let read = records.channel_kpa(0, channel);
        let at = rows.iter().filter_map(|row| Some((simulated.get(*row)? - read.get(*row)?).abs()));
        let off: Vec<f64> = at.filter(|off| off.is_finite()).collect();
        // A run that comes to no numbers follows nothing.
        if off.is_empty() { f64::INFINITY } else { off.iter().sum::<f64>() / off.len() as f64 }
    };
    Ok((0..records.layout().channels()).map(of).sum())
}

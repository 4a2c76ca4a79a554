//! Recordings in which a pressure is moved that nothing in the rig file can move.
//!
//! Without a pump and without a source, pressures only come nearer to the atmosphere's, whatever valves do: the largest of them
//! cannot grow. Where it does, somebody pumped, and no mechanism is missing but the pump.

use fit::data::{Noise, Records};
use model::rig::Rig;

use crate::error::DiagnoseError;

/// Share of what the readings move through by which they may rise all the same: gas that warms after an expansion, a sensor that drifts.
const RISES_SHARE: f64 = 0.2;
/// And multiples of the noise.
const RISES_NOISE: f64 = 10.0;

/// Refuses recordings in which a pressure rises though `rig` has nothing that could raise it.
///
/// # Errors
/// [`DiagnoseError::Immovable`], with the column and what it does.
pub(crate) fn refuse_what_nothing_moves(rig: &Rig, records: &Records, noise: &[Noise]) -> Result<(), DiagnoseError> {
    if !rig.pumps.is_empty() || !rig.sources.is_empty() {
        return Ok(());
    }
    let noise_kpa = noise.iter().map(|n| n.sigma_kpa).fold(0.0, f64::max);
    for (record, r) in records.records().iter().enumerate() {
        let channels = 0..records.layout().channels();
        let read: Vec<&[f64]> = channels.map(|channel| records.channel_kpa(record, channel)).collect();
        let all = || read.iter().flat_map(|channel| channel.iter()).map(|kpa| kpa.abs());
        let span_kpa = all().fold(0.0, f64::max) - all().fold(f64::INFINITY, f64::min);
        let least_kpa = (RISES_SHARE * span_kpa).max(RISES_NOISE * noise_kpa);
        for rows in &r.segments {
            let mut lowest: Option<(f64, usize)> = None;
            for row in rows.clone() {
                let distances = read.iter().enumerate().filter_map(|(c, kpa)| Some((c, kpa.get(row)?.abs())));
                let Some((channel, now)) = distances.max_by(|a, b| a.1.total_cmp(&b.1)) else { continue };
                match lowest {
                    Some((least, since)) if now > least + least_kpa => {
                        return Err(immovable(rig, records, (record, channel), [since, row]));
                    }
                    Some((least, _)) if now >= least => {}
                    _ => lowest = Some((now, row)),
                }
            }
        }
    }
    Ok(())
}

fn immovable(rig: &Rig, records: &Records, (record, channel): (usize, usize), rows: [usize; 2]) -> DiagnoseError {
    let [from, to] = rows.map(|row| {
        let kpa = records.channel_kpa(record, channel).get(row).copied().unwrap_or(f64::NAN);
        let time = records.records().get(record).and_then(|r| r.time_s.get(row)).copied().unwrap_or(f64::NAN);
        format!("{kpa:.1} kPa at {time:.1} s")
    });
    DiagnoseError::Immovable {
        rig: rig.name.clone(),
        channel: records.sensors().get(channel).cloned().unwrap_or_default(),
        moves: format!("goes from {from} to {to}, away from the atmosphere"),
    }
}

#[cfg(test)]
mod tests {
    use fit::data::noise;
    use proto::recording::Recording;

    use super::*;
    use crate::made::column;

    fn asked(reading: impl Fn(f64) -> f64) -> Result<(), DiagnoseError> {
        let mut rig = Rig::builtin("dual_pressure").unwrap();
        rig.pumps.clear();
        rig.valves.clear();
        rig.sensors.shift_remove("sensor_neg");
        rig.volumes.shift_remove("negative");
        // White enough: a sequence of hundredths that comes back after 97 rows.
        let white = |k: u32| 0.01 * (f64::from(k * 37 % 97) - 48.0) / 48.0;
        let time_s: Vec<f64> = (0..2000_u32).map(|k| 0.02 * f64::from(k)).collect();
        let kpa = (0..2000_u32).map(|k| reading(0.02 * f64::from(k)) + white(k)).collect();
        let recording = Recording::new("run.csv", time_s, vec![column("p_pos_kpa", kpa)]).unwrap();
        let records = Records::new(&rig, &[recording]).unwrap();
        refuse_what_nothing_moves(&rig, &records, &noise(&records))
    }

    #[test]
    fn a_pressure_that_only_falls_is_a_leak_test_and_one_that_is_pumped_up_is_refused() {
        asked(|t| 150.0 * (-0.02 * t).exp()).unwrap();
        asked(|t| -60.0 * (-0.02 * t).exp()).unwrap();
        let refused = asked(|t| if t < 10.0 { 15.0 * t } else { 150.0 * (-0.05 * (t - 10.0)).exp() }).unwrap_err();
        assert!(refused.to_string().contains("p_pos_kpa goes from"), "{refused}");
    }
}

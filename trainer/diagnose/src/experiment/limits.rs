//! Pressures that an experiment must not leave.
//!
//! The envelope of the rigs that the daemon drives is known. Of any other nobody stated what it stands, a pump that follows a command
//! or a source behind a valve goes wherever it is let, and hardly more is asked than was recorded. Nor is a sensor taken where it reads
//! no more: what it shows there tells nothing apart, and a sensitive one breaks.

use model::rig::Rig;

use super::menu::{drives, has_a_drive};
use crate::bench::Bench;

/// Pressures that every rival's simulation must stay within on a rig that the daemon drives, in kPa gauge: the envelope of
/// −95 … 160 kPa with room for what the rivals do not know either.
const SAFE_KPA: [f64; 2] = [-92.0, 150.0];
/// Share of what was recorded by which an experiment may go beyond it on a rig whose limits nobody stated.
const BEYOND_RECORDED: f64 = 0.1;
/// Share of a sensor's range that is kept from its ends, for what the rivals do not know either.
const FROM_AN_END: f64 = 0.05;

/// Pressures that every rival must stay within, by channel in kPa gauge. A rig at rest at the open air is always within.
pub(super) fn limits_kpa(bench: &Bench<'_>) -> Vec<[f64; 2]> {
    let is_known = drives(bench.rig) && !has_a_drive(bench.rig, bench.records.inputs());
    let of = |(column, recorded): (&String, [f64; 2])| {
        let envelope = if is_known { SAFE_KPA } else { a_little_beyond(recorded) };
        // Whichever sensor of a chamber ends first.
        ranges_of_chamber(bench.rig, column).fold(envelope, |within, range| common(within, of_sensor(range)))
    };
    bench.records.sensors().iter().zip(bench.recorded_kpa()).map(of).collect()
}

/// Range of what was recorded and a little more at either end.
fn a_little_beyond([low, high]: [f64; 2]) -> [f64; 2] {
    let beyond = BEYOND_RECORDED * (high - low);
    [low - beyond, high + beyond]
}

/// Ranges in kPa gauge, lower end first, of all sensors of the chamber that a column is read in.
fn ranges_of_chamber(rig: &Rig, column: &str) -> impl Iterator<Item = [f64; 2]> {
    let volume = rig.sensor_of(column).map(|(_, sensor)| sensor.volume.as_str());
    let of_it = rig.sensors.values().filter(move |sensor| Some(sensor.volume.as_str()) == volume);
    of_it.map(|sensor| {
        let [one, other] = sensor.range_kpa_gauge;
        [one.min(other), one.max(other)]
    })
}

/// Limits by a sensor's range. An end at the open air, where chambers rest, is none that a pressure must keep away from: beyond the
/// air a pressure may go by what it is kept from any other end, for gas that cools and a zero that is off.
fn of_sensor([low, high]: [f64; 2]) -> [f64; 2] {
    let margin = FROM_AN_END * (high - low);
    [(low + margin).min(-margin), (high - margin).max(margin)]
}

/// Range that lies within both of two.
fn common([low, high]: [f64; 2], [other_low, other_high]: [f64; 2]) -> [f64; 2] {
    [low.max(other_low), high.min(other_high)]
}

#[cfg(test)]
mod tests {
    use fit::data::Records;

    use super::*;
    use crate::made::two_chambers::{holds, recorded, rig};
    use crate::made::{self, made_after, moved};

    /// The paper's sensors go beyond the envelope, or end at the open air, beyond which only a twentieth of what they read is left;
    /// those of a small rig do not let it go that far.
    #[test]
    fn no_sensor_is_taken_beyond_its_range() {
        let limits_with = |ranges: [[f64; 2]; 2]| {
            let (mut rig, _) = moved(&[]);
            for (sensor, range) in rig.sensors.values_mut().zip(ranges) {
                sensor.range_kpa_gauge = range;
            }
            let records = Records::new(&rig, &made_after(0, 600, &rig, 1, 5)).unwrap();
            limits_kpa(&made::bench(&rig, &records))
        };
        let papers = limits_with([[0.0, 1000.0], [0.0, -101.0]]);
        assert_eq!((papers[0], papers[1][0]), ([-50.0, SAFE_KPA[1]], SAFE_KPA[0]));
        assert!((papers[1][1] - 5.05).abs() < 1e-9, "{papers:?}");
        let small = limits_with([[-20.0, 20.0], [20.0, -20.0]]);
        assert_eq!(small, [[-18.0, 18.0]; 2]);
        let from_the_air = limits_with([[0.0, 20.0], [0.0, -20.0]]);
        assert_eq!(from_the_air, [[-1.0, 19.0], [-19.0, 1.0]]);
        // An end that is a little off the air is no other one.
        let nearly = limits_with([[0.5, 20.5], [-0.5, -20.5]]);
        assert_eq!(nearly, [[-1.0, 19.5], [-19.5, 1.0]]);
    }

    /// A pump that follows a command, or a source, fills a chamber as far as it can: a rig that the daemon does not drive stays near
    /// what was recorded in each chamber, and within what its sensors read.
    #[test]
    fn a_rig_of_others_stays_near_what_was_recorded() {
        let mut rig = rig();
        let recording = recorded(&rig, "run.csv", &holds(1500, [0.1, 0.5], 1), 1);
        let most = |column: &str| recording.column(column).unwrap().iter().copied().fold(0.0, f64::max);
        let limits_of = |rig: &Rig| {
            let records = Records::new(rig, std::slice::from_ref(&recording)).unwrap();
            limits_kpa(&made::bench(rig, &records))
        };
        for (limits, column) in limits_of(&rig).iter().zip(["pa", "pb"]) {
            let most = most(column);
            // Rests at the open air within the noise.
            assert!(most > 5.0 && limits[1] > most && limits[1] < 1.15 * most, "{limits:?} {most}");
            assert!(limits[0] < 0.0 && limits[0] > -0.15 * most, "{limits:?}");
        }
        rig.sensors["sb"].range_kpa_gauge = [-2.0, 5.0];
        let limits = limits_of(&rig);
        // A twentieth of 7 kPa from the end.
        assert!((limits[1][1] - 4.65).abs() < 1e-9 && limits[0][1] > 5.0, "{limits:?}");
    }
}

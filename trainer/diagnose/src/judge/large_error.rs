//! Errors that are much for a model to leave, by channel.
//!
//! Bars in kPa are meant for chambers that move through tens of kPa. A meter whose whole reading is 1 kPa would never be off by 0.12,
//! and a model that misses a tenth of all that it shows would pass for one that lacks nothing. So there it is a share of what the readings
//! move through. Names are not judged by it: they have bars of their own, and a rig that others built leaves some percent of its swing
//! beside a name that is right.
//!
//! Nor is a bar in kPa meant for readings in steps of 1 kPa: what is no larger than the noise itself is down to the noise, as the headline
//! says.

use fit::data::{Noise, Records};

/// Error beyond the noise, in kPa, above which a model that lacks nothing known lacks something unknown.
pub(crate) const UNKNOWN_KPA: f64 = 0.12;
/// Such an error as a share of what a channel moves through. Sketches of breathing circuits whose physics is right but for what
/// they were made to lack leave 2 to 3 %; a solenoid without its dead zone leaves 10 %.
const OF_SWING: f64 = 0.05;
/// Share of the readings beyond either end of what a channel moves through.
const BEYOND: f64 = 0.02;

/// Multiples of the noise that are never much: no estimate of it is good to less where nothing moves.
const OF_NOISE: f64 = 2.0;

/// Error by channel, in kPa, above which it is much for a model to leave; `counted` is 0 at readings that do not count.
pub(crate) fn much_kpa(records: &Records, counted: &[f64], noise: &[Noise]) -> Vec<f64> {
    let layout = records.layout();
    let mut read = vec![Vec::new(); layout.channels()];
    for (_, channel, range) in layout.all() {
        let counts = range.filter(|i| counted.get(*i).is_some_and(|w| *w != 0.0));
        read[channel].extend(counts.filter_map(|i| records.readings_kpa().get(i)).copied());
    }
    let much = |(read, noise): (Vec<f64>, &Noise)| {
        let share_kpa = (OF_SWING * swing(read)).max(OF_NOISE * noise.sigma_kpa);
        share_kpa.min(a_name_may_leave_kpa(noise))
    };
    read.into_iter().zip(noise).map(much).collect()
}

/// Error beyond the noise in kPa that what is named may leave in a channel, however little of it that explains.
pub(crate) fn a_name_may_leave_kpa(noise: &Noise) -> f64 {
    UNKNOWN_KPA.max(noise.sigma_kpa)
}

/// Range that some readings move through, but for those far out.
fn swing(mut read: Vec<f64>) -> f64 {
    read.sort_by(f64::total_cmp);
    let beyond = (BEYOND * read.len() as f64) as usize;
    let ends = read.get(beyond).zip(read.len().checked_sub(1 + beyond).and_then(|last| read.get(last)));
    ends.map_or(f64::INFINITY, |(least, most)| most - least)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_down_to_coarse_readings_is_not_much() {
        let of = |sigma_kpa: f64| a_name_may_leave_kpa(&Noise { sigma_kpa, step_kpa: 0.0, on_plateaus_kpa: None });
        assert_eq!([of(0.03), of(0.08), of(0.29)], [UNKNOWN_KPA, UNKNOWN_KPA, 0.29]);
    }

    #[test]
    fn what_readings_move_through_leaves_single_ones_out() {
        let mut read: Vec<f64> = (0..=100).map(|k| 0.01 * f64::from(k)).collect();
        assert!((swing(read.clone()) - 0.96).abs() < 1e-12);
        read.extend([50.0, -50.0]);
        assert!((swing(read) - 0.98).abs() < 0.021);
        assert_eq!(swing(Vec::new()), f64::INFINITY);
    }
}

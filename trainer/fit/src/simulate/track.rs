//! The course of a pump's speed, followed through its ripple.
//!
//! A pump that slows down under load, or speeds up as it warms, pulses at 84 or 103 Hz instead of the stated 100, never for
//! long at the same rate: sampled every 20 ms its ripple looks like noise of 0.3 kPa. Within a second, though, it keeps
//! step with a course of the speed that is nearly right, and nothing else does. So courses are laid over the readings,
//! the angle of the crank free in every window:
//!
//! ```text
//! gain       Σ over windows of max over φ of |off|² − |off − r(φ + f ∫ s dt)|²
//! ```
//!
//! for a share `s` by which the speed is off ([`Course`]).
//!
//! `off` is what the averaged pump does not explain, `r` its ripple ([`super::ripple`]), both less a straight line in every
//! window: what is slow is the parameters' to explain. A coarse grid over windows of 1 s is refined with windows of 2 and
//! 4 s, in which speeds are told to 1e-4. Plain courses come first: constant, drooping, warming. Where none of them is the pump's, and
//! what scatters could be its ripple, a pump is looked for that droops and turns at another speed besides. What is found must have the height that the pump's model predicts, in every
//! recording.

use super::course::Course;
use super::ripple::Ripple;
use super::tachometer::LONG_S;
use super::windows::{Match, Piece};
use crate::data::Records;
use model::rig::Rig;

mod best;
mod followed;
mod laid;
use laid::{Laid, WINDOWS};

/// A ripple that was followed.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// The pump.
    pub pump: String,
    /// Course of its speed.
    pub course: Course,
    /// Standard errors of the course's numbers, in their places, from the scatter between recordings.
    pub errors: Course,
    /// Share by which the speed was off on average.
    pub mean_share: f64,
    /// Height of the ripple over the predicted one.
    pub height: f64,
    /// Log-likelihood that the ripple gains, each channel's errors as large as they are.
    pub log_likelihood: f64,
    /// Share of what was unexplained within windows that goes with it.
    pub share: f64,
    /// The ripple on each reading, in kPa.
    pub ripple_kpa: Vec<f64>,
}

/// Range in which the height of the pump's own ripple is, over the predicted one.
const HEIGHT: [f64; 2] = [0.7, 1.35];
/// Such a range where nothing but the pump follows its load so: a rig that lacks something else as well is fitted with
/// wrong volumes, which the predicted height goes by.
const HEIGHT_FOLLOWED: [f64; 2] = [0.5, 2.0];
/// Factor by which a ripple must be there more than by chance to be taken for nothing else.
const UNMISTAKABLE: f64 = 4.0;
/// Factor by which a recording must have more of it than by chance.
const STANDS_OUT: f64 = 1.2;
/// Gain in log-likelihood by each angle that is free where there is no ripple: half of a χ² of an angle and a height.
const BY_CHANCE: f64 = 1.0;
/// Share of the ripple's energy that must lie where a window tells it from something slow.
const QUICK: f64 = 0.3;

/// Follows the ripple of a pump of `rig`; `None` where no course accounts for it, by more than its free angles would without one.
/// `weights` is zero at readings that do not count.
pub fn track(records: &Records, rig: &Rig, ripple: &Ripple, weights: &[f64]) -> Option<Track> {
    let laid = Laid::of(records, rig, ripple, weights)?;
    let (course, chance) = laid.best_course();
    let (course, found) = laid.is_its_own(course, &chance).map(|found| (course, found)).or_else(|| {
        let course = laid.scatters_like_it().then(|| laid.best_of_both()).flatten()?;
        Some((course, laid.is_its_own(course, &chance)?))
    })?;
    let ripple_kpa = laid.followed(course, weights.len());
    let (log_likelihood, share) = laid.gained(&ripple_kpa);
    // What a sensor that lags leaves of a ripple is less than the noise, and some course always goes along with that.
    if log_likelihood <= BY_CHANCE * laid.free_angles() as f64 {
        return None;
    }
    let Found { mean_share, height } = found;
    let (pump, errors) = (ripple.pump.clone(), laid.errors(course));
    Some(Track { pump, course, errors, mean_share, height, log_likelihood, share, ripple_kpa })
}

/// Figures of a course that was found.
struct Found {
    mean_share: f64,
    height: f64,
}

impl Laid {
    /// Tells whether what a course matches is the pump's own ripple, in every recording; `chance` as in [`Laid::best_course`].
    fn is_its_own(&self, course: Course, chance: &[f64]) -> Option<Found> {
        let matched = self.matches(course, WINDOWS[0]);
        // What is found by chance adds to what is there as noise does to a length.
        let own = |(m, chance): (&Match, &f64)| (m.product * m.product - chance * chance).max(0.0).sqrt();
        let long = |piece: &Piece| piece.lasts_s() > LONG_S;
        let any_long = self.pieces.iter().any(long);
        let asked = || {
            let all = self.pieces.iter().zip(matched.iter().zip(chance));
            all.filter(|(piece, _)| !any_long || long(piece)).map(|(_, of)| of)
        };
        let everywhere = asked().all(|(m, c)| own((m, c)) > 0.5 * m.energy && m.product > STANDS_OUT * c);
        let all = matched.iter().fold(Match::default(), |sum, m| sum.plus(*m));
        let product: f64 = matched.iter().zip(chance).map(own).sum();
        let quick = all.energy > QUICK * all.whole;
        let shares: Vec<f64> = self.pieces.iter().flat_map(|piece| piece.shares(course)).collect();
        let mean_share = shares.iter().sum::<f64>() / shares.len().max(1) as f64;
        // The valves let through what they did, so a slower pump moves more in each stroke.
        let height = product / all.energy * (1.0 + mean_share);
        let followed = asked().all(|(m, c)| m.product > UNMISTAKABLE * c);
        let [low, high] = if followed && course.droop.is_some() { HEIGHT_FOLLOWED } else { HEIGHT };
        (everywhere && quick && (low..=high).contains(&height)).then_some(Found { mean_share, height })
    }
}

#[cfg(test)]
mod tests {
    use super::super::course::{Droop, Warming};
    use super::super::simulator::{Fidelity, Simulator};
    use super::super::tachometer::tests::recorded_on;
    use super::*;
    use model::mechanism::{Mechanism, PumpDroop, PumpSpeed, SensorLag};
    use model::rig::MechanismInstance;
    use proto::recording::Recording;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    /// Two recordings of 30 s on the detailed rig with mechanisms of its pump, and noise of 0.06 kPa.
    fn records(rig: &Rig, mechanisms: impl IntoIterator<Item = Mechanism>, seed: u64) -> Records {
        let mut with = rig.clone();
        with.mechanisms.extend(mechanisms.into_iter().map(|mechanism| MechanismInstance {
            component: "pump".to_owned(),
            enabled: true,
            mechanism,
        }));
        let recordings: Vec<Recording> = [0.2, 0.7].map(|crank| recorded_on(with.clone(), crank, 1500)).to_vec();
        let records = Records::new(rig, &recordings).unwrap();
        let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
        let noise: Vec<f64> = records
            .readings_kpa()
            .iter()
            .map(|kpa| {
                let normal: f64 = StandardNormal.sample(&mut random);
                kpa + 0.06 * normal
            })
            .collect();
        records.with_readings(noise).unwrap()
    }

    fn followed(rig: &Rig, records: &Records) -> Option<Track> {
        let simulator = Simulator::new(records, Fidelity::Averaged).on(1);
        let ripple = Ripple::of(&simulator, rig).unwrap().unwrap();
        track(records, rig, &ripple, &vec![1.0; records.layout().len()])
    }

    #[test]
    fn droop_is_read_off_a_ripple_that_never_keeps_one_rate() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        for per_bar in [0.03, 0.1] {
            let droop = PumpDroop { speed_loss_per_bar: per_bar };
            let records = records(&rig, Some(Mechanism::PumpDroop(droop)), 1);
            let read = followed(&rig, &records).unwrap();
            let Course { share, droop: Some(Droop { per_bar: found, .. }), warming: None } = read.course else {
                panic!("{:?}", read.course)
            };
            // Speeds are told to 1e-4 in a window; loads differ by some tenths of a bar. Load and speed without load are
            // told apart the worse: 1.5 bar of the one are a share of the other.
            assert!((found - per_bar).abs() < 0.03 * per_bar, "{per_bar} {:?} {:?}", read.course, read.errors);
            assert!(share.abs() < 0.05 * per_bar, "{:?}", read.course);
            // What is left is the noise that was put on: a ripple of 0.3 kPa is nine tenths of the rest.
            assert!(read.share > 0.8 && read.log_likelihood > 1000.0, "{} {}", read.share, read.log_likelihood);
        }
    }

    #[test]
    fn a_constant_speed_several_per_cent_off_is_called_constant() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        for percent in [4.0, -7.0] {
            let records = records(
                &rig,
                Some(Mechanism::PumpSpeed(PumpSpeed { change_percent: percent, time_constant_s: 0.0 })),
                2,
            );
            let read = followed(&rig, &records).unwrap();
            let Course { share, droop: None, warming: None } = read.course else { panic!("{:?}", read.course) };
            // A twentieth of a turn of 100 Hz in windows of 4 s.
            assert!((share - 0.01 * percent).abs() < 2e-4, "{percent} {share}");
        }
    }

    /// The speed that a pump moves towards, and how fast, each with an error that holds the truth.
    #[test]
    fn a_pump_that_warms_tells_its_time_constant() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let warming = PumpSpeed { change_percent: -6.0, time_constant_s: 11.0 };
        let read = followed(&rig, &records(&rig, Some(Mechanism::PumpSpeed(warming)), 4)).unwrap();
        let (Course { droop: None, warming: Some(Warming { share, time_s }), .. }, Some(error)) =
            (read.course, read.errors.warming)
        else {
            panic!("{:?}", read.course)
        };
        // Four standard errors, and what a step of the climb and a ripple that is not quite the model's leave.
        assert!((share + 0.06).abs() < 4.0 * error.share + 3e-4, "{share} ± {error:?}");
        assert!((time_s - 11.0).abs() < 4.0 * error.time_s + 0.05, "{time_s} ± {error:?}");
        assert!(error.time_s < 0.5, "{error:?}");
    }

    /// Neither course alone is anywhere near: the load moves the speed by 15 %, and so does the warming.
    #[test]
    fn a_pump_that_droops_and_warms_tells_both() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let both = [
            Mechanism::PumpDroop(PumpDroop { speed_loss_per_bar: 0.15 }),
            Mechanism::PumpSpeed(PumpSpeed { change_percent: 10.0, time_constant_s: 25.0 }),
        ];
        let read = followed(&rig, &records(&rig, both, 5)).unwrap();
        let Course { droop: Some(droop), warming: Some(warming), .. } = read.course else {
            panic!("{:?}", read.course)
        };
        assert!((droop.per_bar / 0.15 - 1.0).abs() < 0.03, "{droop:?} {:?}", read.errors);
        // A recording of 30 s ends before the speed has settled: end and time constant are known by their quotient best.
        assert!((warming.share / 0.1 - 1.0).abs() < 0.05, "{warming:?} {:?}", read.errors);
        assert!((warming.time_s / 25.0 - 1.0).abs() < 0.08, "{warming:?} {:?}", read.errors);
        assert!(read.share > 0.8, "{}", read.share);
    }

    #[test]
    fn a_pump_that_droops_and_is_slow_tells_both() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let both = [
            Mechanism::PumpDroop(PumpDroop { speed_loss_per_bar: 0.06 }),
            Mechanism::PumpSpeed(PumpSpeed { change_percent: -8.0, time_constant_s: 0.0 }),
        ];
        let read = followed(&rig, &records(&rig, both, 6)).unwrap();
        let Course { share, droop: Some(droop), warming: None } = read.course else { panic!("{:?}", read.course) };
        assert!((droop.per_bar / 0.06 - 1.0).abs() < 0.05, "{droop:?} {:?}", read.errors);
        assert!((share + 0.08).abs() < 0.005, "{share} {:?}", read.errors);
    }

    #[test]
    fn nothing_is_followed_at_the_stated_speed() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        assert_eq!(followed(&rig, &records(&rig, None, 3)).map(|read| read.course), None);
    }

    /// Sensors that lag leave next to nothing of the ripple. Where the noise is coloured, some course goes along with it: of
    /// these six five did, for a gain of 41 to 63 in log-likelihood, where 118 angles are free.
    #[test]
    fn coloured_noise_behind_sensors_that_lag_is_not_followed() {
        let mut rig = Rig::builtin("dual_pressure").unwrap();
        rig.mechanisms.extend(["sensor_pos", "sensor_neg"].map(|sensor| MechanismInstance {
            component: sensor.to_owned(),
            enabled: true,
            mechanism: Mechanism::SensorLag(SensorLag { time_constant_ms: 63.0, second_time_constant_ms: 6.3 }),
        }));
        let quiet = records(&rig, None, 0);
        for seed in 0..6 {
            let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
            let mut off = 0.0;
            let coloured = quiet.readings_kpa().iter().map(|kpa| {
                let normal: f64 = StandardNormal.sample(&mut random);
                off = 0.8 * off + 0.6 * normal;
                kpa + 0.1 * off
            });
            let records = quiet.with_readings(coloured.collect()).unwrap();
            assert_eq!(followed(&rig, &records).map(|read| read.course), None, "{seed}");
        }
    }

    #[test]
    fn no_step_leads_to_a_pump_that_gains_speed_under_load() {
        let droop = Droop { per_bar: 1e-4, lag_s: 0.1 };
        let steps = Course { droop: Some(droop), ..Course::default() }.neighbours(1.0, 1.5);
        assert!(
            steps.len() > 4 && steps.iter().all(|step| step.droop.is_some_and(|droop| droop.per_bar > 0.0)),
            "{steps:?}"
        );
    }
}

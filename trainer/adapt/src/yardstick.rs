//! Errors of a flight: its readings less the reference, or less what late sensors show of chambers that are on it.
//!
//! A controller that knows of a late sensor puts the *chamber* on the reference (docs/control.md), and the reading trails the
//! reference by the sensor's lag. By readings less reference the better flight would look the worse, and the model would be
//! put back. So flights on a found rig with a `sensor_lag` or a `residual_response` are judged by their readings less what its
//! sensors would read if the chambers were on the reference ([`model::shown_reference`]), as the daemon's trial and arbiter
//! judge as well.
//!
//! A lag that was named wrongly would define the yardstick by which it looks better. It is believed only because others have
//! taken it, and neither of them looks at the reference: diagnosis, on rows that nothing was fitted to, and the daemon, which
//! compared both models' predictions with the last minutes and put this one in force. No flight is judged so before that,
//! readings less reference are told beside, and extremes and limits are of the readings as they are.

use model::observation::Pair;
use model::rig::Rig;
use model::shown_reference::ShownReference;
use proto::recording::TickRecord;

/// Sentence on which of two figures decides, and why.
pub(crate) const JUDGED_BEHIND_LATE_SENSORS: &str = "the sensors of the model that was found show pressures late, so runs are judged by \
     their readings less what these sensors would read with the chambers on the reference: readings less reference would count the lag of a \
     sensor as an error of the controller";

/// Measure of a flight's errors; by default its readings less the reference.
#[derive(Debug, Clone, Default)]
pub struct Yardstick {
    /// At the beginning of a flight.
    shown: ShownReference,
}

impl Yardstick {
    /// Yardstick of flights on a rig that was found: readings less reference where none of its sensors is late.
    pub fn of(found: &Rig) -> Self {
        Yardstick { shown: ShownReference::of(found) }
    }

    /// Tells whether it is another than readings less reference.
    pub fn has_late_sensors(&self) -> bool {
        self.shown.is_late()
    }

    /// Errors in kPa, tick by tick of a flight from its first on; not finite where a reading or the reference is not.
    pub fn errors_kpa(&self, ticks: &[TickRecord]) -> Vec<Pair> {
        let mut shown = self.shown.clone();
        // Tick at which the reference was last known.
        let mut known = None;
        let error = |tick: &TickRecord| {
            let reference_kpa = [tick.ref_pos_kpa, tick.ref_neg_kpa];
            let since = tick.tick.saturating_sub(known.unwrap_or(tick.tick));
            let shown_kpa = shown.next_kpa(since, reference_kpa);
            if reference_kpa.iter().all(|kpa| kpa.is_finite()) {
                known = Some(tick.tick);
            }
            let readings_kpa = [tick.p_pos_kpa, tick.p_neg_kpa];
            std::array::from_fn(|c| readings_kpa[c] - shown_kpa[c])
        };
        ticks.iter().map(error).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guard::{squares_by_second, worse_window};
    use crate::recorded::RUN;
    use crate::rig_time::TICK_S;
    use crate::tracking::Tracking;
    use model::observation::CHANNELS;
    use model::predict::DualPressureRig;

    /// The paper's rig with mechanisms at its sensors.
    fn with(mechanisms: &str) -> Rig {
        Rig::from_toml(&format!("{}\n{mechanisms}", model::rig::DUAL_PRESSURE)).unwrap()
    }

    fn lag(sensor: &str, rest: &str) -> String {
        format!("[[mechanisms]]\nid = \"sensor_lag\"\ncomponent = \"{sensor}\"\n{rest}\n")
    }

    fn flight(readings_and_reference: impl Iterator<Item = [Pair; 2]>) -> Vec<TickRecord> {
        let tick = |(tick, [[p_pos_kpa, p_neg_kpa], [ref_pos_kpa, ref_neg_kpa]]): (u32, [Pair; 2])| TickRecord {
            state: RUN,
            tick,
            p_pos_kpa,
            p_neg_kpa,
            ref_pos_kpa,
            ref_neg_kpa,
            ..TickRecord::default()
        };
        (1000..).zip(readings_and_reference).map(tick).collect()
    }

    /// Behind one lag a ramp is shown late by the time constant, behind two by both, behind an answer of the second order by
    /// 2ζ/ω times its share.
    #[test]
    fn a_ramp_is_shown_late_by_the_time_constants() {
        let ramp = |rate: f64| flight((0..500).map(move |n| [[0.0; 2], [40.0 + rate * TICK_S * f64::from(n), -70.0]]));
        let answer = "[[mechanisms]]\nid = \"residual_response\"\ncomponent = \"sensor_pos\"\nnatural_frequency_hz = 2.0\ndamping_ratio = 0.7\nshare = 0.5\n";
        let two = lag("sensor_pos", "time_constant_ms = 300.0\nsecond_time_constant_ms = 80.0");
        for (mechanisms, late_s) in [
            (lag("sensor_pos", "time_constant_ms = 160.0"), 0.16),
            (lag("sensor_pos", "time_constant_ms = 8.0"), 0.008),
            (two.clone(), 0.38),
            (answer.to_owned(), 0.5 * 2.0 * 0.7 / (std::f64::consts::TAU * 2.0)),
            (format!("{two}{answer}"), 0.38 + 0.5 * 2.0 * 0.7 / (std::f64::consts::TAU * 2.0)),
        ] {
            let ticks = ramp(4.0);
            let yardstick = Yardstick::of(&with(&mechanisms));
            let last = yardstick.errors_kpa(&ticks)[499];
            // The error of a reading of nothing is what is shown, with its sign turned.
            let (shown_kpa, reference_kpa) = (-last[0], ticks[499].ref_pos_kpa);
            // A part in which the chamber stands: h²/12τ of the 1 ms, below 0.02 ms.
            assert!((reference_kpa - shown_kpa - 4.0 * late_s).abs() < 4.0 * 2e-5, "{mechanisms}: {last:?}");
            assert_eq!(-last[1], -70.0, "the other sensor reads what is there");
        }
    }

    /// Chambers that vent with the pump at rest, read by a rig with late sensors and by one without.
    #[test]
    fn the_reference_is_shown_as_the_rig_shows_its_chambers() {
        let late = lag("sensor_pos", "time_constant_ms = 120.0\nsecond_time_constant_ms = 40.0")
            + "[[mechanisms]]\nid = \"residual_response\"\ncomponent = \"sensor_neg\"\nnatural_frequency_hz = 3.0\ndamping_ratio = 0.2\n";
        let own = late.clone() + "[[mechanisms]]\nid = \"sensor_gain\"\ncomponent = \"sensor_pos\"\ngain = 1.02\n";
        let rigs = [with(&late), with("")];
        let [mut late, mut plain] = rigs.map(|rig| DualPressureRig::new(&rig).unwrap());
        let duty = |n: u32| if n < 50 { [0.0; 2] } else { [0.8 + 0.1 * (0.05 * f64::from(n)).sin(), 0.8] };
        for rig in [&mut late, &mut plain] {
            rig.start_from([90.0, -72.0], duty(0));
            // Cylinders and chambers come to rest with each other.
            (0..250).for_each(|_| rig.tick(duty(0), false));
        }
        let flown = flight((0..400).map(|n| {
            let both = [late.readings_kpa(), plain.readings_kpa()];
            late.tick(duty(n), false);
            plain.tick(duty(n), false);
            both
        }));
        let moved_kpa = flown[0].p_pos_kpa - flown[399].p_pos_kpa;
        assert!(moved_kpa > 20.0, "{moved_kpa}");
        let raw_kpa = Yardstick::default().errors_kpa(&flown);
        // A gain is none of the yardstick's business: reference and readings both have it.
        let errors_kpa = Yardstick::of(&with(&own)).errors_kpa(&flown);
        let most = |errors: &[Pair], c: usize| errors.iter().fold(0.0_f64, |most, error| most.max(error[c].abs()));
        for c in 0..CHANNELS {
            // Between ticks the chambers do not go straight when a valve has just moved.
            assert!(
                most(&raw_kpa, c) > 0.5 && most(&errors_kpa, c) < 0.02,
                "{c}: {} {}",
                most(&raw_kpa, c),
                most(&errors_kpa, c)
            );
        }
    }

    #[test]
    fn without_late_sensors_errors_are_readings_less_reference_to_the_bit() {
        let valves = "[[mechanisms]]\nid = \"valve_lag\"\ncomponent = \"valve_pos\"\ntime_constant_ms = 80.0\n";
        let bias = "[[mechanisms]]\nid = \"sensor_bias\"\ncomponent = \"sensor_pos\"\nbias_kpa = 1.0\n";
        let off = lag("sensor_neg", "time_constant_ms = 100.0\nenabled = false");
        let yardstick = Yardstick::of(&with(&format!("{valves}{bias}{off}")));
        assert!(!yardstick.has_late_sensors());
        let ticks = flight((0..600).map(|n| {
            let at = 0.1 * f64::from(n);
            [[80.0 + at.sin(), -70.0 + at.cos()], [80.0 + 0.3 * at, -70.0 + 0.1 * at]]
        }));
        let raw = |t: &TickRecord| [t.p_pos_kpa - t.ref_pos_kpa, t.p_neg_kpa - t.ref_neg_kpa];
        assert_eq!(yardstick.errors_kpa(&ticks), ticks.iter().map(raw).collect::<Vec<_>>());
        assert_eq!(Tracking::of(&ticks, &yardstick), Tracking::of(&ticks, &Yardstick::default()));
        assert_eq!(Tracking::of(&ticks, &yardstick).unwrap().late_rmse_kpa, None);
    }

    /// Two flights along a sine: a chamber on it, whose reading is the sine's own answer of the first order, and a reading on it.
    #[test]
    fn behind_a_late_sensor_the_chamber_is_to_be_on_the_reference() {
        let (omega, tau_s, size_kpa) = (0.8_f64, 0.16, 10.0);
        let (size, late) = (size_kpa / (1.0 + (omega * tau_s).powi(2)).sqrt(), (omega * tau_s).atan());
        let sine = |n: u32, size: f64, late: f64| 80.0 + size * (omega * TICK_S * f64::from(n) - late).sin();
        let reference = |n: u32| [sine(n, size_kpa, 0.0), -70.0];
        let on_the_chamber = flight((0..2000).map(|n| [[sine(n, size, late), -70.0], reference(n)]));
        let on_the_reading = flight((0..2000).map(|n| [reference(n), reference(n)]));
        let yardstick = Yardstick::of(&with(&lag("sensor_pos", "time_constant_ms = 160.0")));
        let [chamber, reading] =
            [&on_the_chamber, &on_the_reading].map(|ticks| Tracking::of(ticks, &yardstick).unwrap());
        // The difference of both sines: ωτ/√(1+ω²τ²) of the size, by root mean square. Over whole seconds, not whole turns.
        let apart_kpa = size_kpa * (omega * tau_s) / (1.0 + (omega * tau_s).powi(2)).sqrt() / 2f64.sqrt();
        assert!(
            (chamber.rmse_kpa[0] - apart_kpa).abs() < 0.05 * apart_kpa && reading.rmse_kpa[0] == 0.0,
            "{chamber:?}"
        );
        let [late_of_chamber, late_of_reading] = [chamber, reading].map(|tracking| tracking.late_rmse_kpa.unwrap()[0]);
        assert!((late_of_reading - apart_kpa).abs() < 0.05 * apart_kpa, "{reading:?}");
        // Lines between ticks in the place of a sine: 10 · 0.64 · 0.02²/8, and the 1 ms parts.
        assert!(late_of_chamber < 1e-3, "{chamber:?}");
        assert!(chamber.over_by_channel(&reading)[0] < 1e-3);
        // So it is second by second: the one is ended beside the other, and not the other way round.
        let by_second = |ticks: &[TickRecord], yardstick: &Yardstick| squares_by_second(ticks, 1000, yardstick);
        let [good, bad] = [&on_the_chamber, &on_the_reading].map(|ticks| by_second(ticks, &yardstick));
        assert!(worse_window(&bad, &good).is_some() && worse_window(&good, &bad).is_none());
        let [good, bad] = [&on_the_chamber, &on_the_reading].map(|ticks| by_second(ticks, &Yardstick::default()));
        assert!(worse_window(&bad, &good).is_none() && worse_window(&good, &bad).is_some());
    }

    /// A reference that a recording lacks for some ticks is gone on from where it was; the errors there are none.
    #[test]
    fn a_gap_in_the_reference_is_an_error_of_nothing() {
        let yardstick = Yardstick::of(&with(&lag("sensor_neg", "time_constant_ms = 100.0")));
        let mut ticks = flight((0..600).map(|n| [[80.0, -70.0 - 0.01 * f64::from(n)]; 2]));
        let whole = yardstick.errors_kpa(&ticks);
        ticks[300].ref_pos_kpa = f64::NAN;
        let gap = yardstick.errors_kpa(&ticks);
        assert!(gap[300].iter().all(|error| error.is_nan()));
        ticks.remove(300);
        let missed = yardstick.errors_kpa(&ticks);
        assert!((gap[599][1] - whole[599][1]).abs() < 1e-9 && (missed[598][1] - whole[599][1]).abs() < 1e-9);
    }
}

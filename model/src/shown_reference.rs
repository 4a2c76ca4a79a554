//! Readings of late sensors whose chambers stand on a reference: the yardstick of errors behind them.
//!
//! A controller that knows of a late sensor (`sensor_lag`, `residual_response`) puts the *chamber* on the reference
//! (docs/control.md), and the reading trails the reference by the sensor's lag. By readings less reference it would look
//! worse than one that drives the chamber ahead to keep the reading there. So errors behind such sensors are readings less
//! what these very sensors would show of chambers that are held on the reference. Gain, bias and drift of a sensor are left
//! out, since references are in terms of what is read. A sensor that is not late shows the reference itself, to the bit.

use crate::observation::{CHANNELS, Pair, TICKS_PER_S};
use crate::plant::{MOST_SENSED, SensorPath};
use crate::predict::DualPressurePorts;
use crate::rig::Rig;

/// Parts of a tick in which sensors follow: of 1 ms. One lag follows a straight line exactly in steps of any length, but what
/// it hands to a second one is no straight line.
const PARTS: u32 = 20;
/// Ticks beyond which a gap between two values of a reference counts no further (10 s).
const MOST_TICKS: u32 = 500;

/// Readings of both sensors with their chambers on a reference, tick by tick; the default has no late sensor.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ShownReference {
    /// Sensor of each channel that is late; nothing of one that reads what is there.
    sensors: [Option<SensorPath<f64>>; CHANNELS],
    /// Memory of the sensors, in kPa gauge.
    memory: [f64; CHANNELS * MOST_SENSED],
    /// The reference where it was last known.
    last_kpa: Option<Pair>,
}

impl ShownReference {
    /// The reference as a checked rig's sensors show it, at its beginning.
    pub fn of(rig: &Rig) -> Self {
        let mut used = 0;
        let sensors = DualPressurePorts::READING.map(|column| {
            let (name, _) = rig.sensor_of(column)?;
            let mechanisms = rig.mechanisms.iter().filter(|m| m.enabled && m.component == *name);
            let part_s = 1.0 / (TICKS_PER_S * f64::from(PARTS));
            let sensor = SensorPath::with(0, mechanisms.map(|m| &m.mechanism), part_s, &mut used);
            sensor.is_late().then_some(sensor)
        });
        ShownReference { sensors, ..ShownReference::default() }
    }

    /// Tells whether a sensor is late, so that it shows another thing than the reference.
    pub fn is_late(&self) -> bool {
        self.sensors.iter().any(Option::is_some)
    }

    /// Forgets what was shown: another reference begins, or this one from elsewhere.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn restart(&mut self) {
        self.last_kpa = None;
    }

    /// Readings so many ticks after those before, in kPa gauge; between both the reference goes straight. The first time the
    /// sensors have settled: what would be left of the way there is over within seconds.
    ///
    /// # Real-time
    /// May run in the tick; allocation-free, some 0.2 µs for each tick that has passed where a sensor is late.
    pub fn next_kpa(&mut self, ticks: u32, reference_kpa: Pair) -> Pair {
        if !self.is_late() {
            return reference_kpa;
        }
        if !reference_kpa.iter().all(|kpa| kpa.is_finite()) {
            return [f64::NAN; CHANNELS];
        }
        let before_kpa = self.last_kpa.replace(reference_kpa);
        std::array::from_fn(|c| {
            let Some(sensor) = self.sensors[c] else { return reference_kpa[c] };
            match before_kpa {
                None => sensor.settle(reference_kpa[c], &mut self.memory),
                Some(before_kpa) => {
                    let parts = ticks.min(MOST_TICKS) * PARTS;
                    let part_kpa = (reference_kpa[c] - before_kpa[c]) / f64::from(parts);
                    let at = |part: u32| part_kpa.mul_add(f64::from(part), before_kpa[c]);
                    for part in 0..parts {
                        sensor.follow([at(part), at(part + 1)], &mut self.memory);
                    }
                }
            }
            sensor.seen(reference_kpa[c], &self.memory)
        })
    }

    /// Shown readings of now, as [`ShownReference::next_kpa`], and of the goals ahead, a tick each. Of goals that are missing
    /// nothing is known.
    ///
    /// # Real-time
    /// May run in the tick; allocation-free.
    pub fn goals_kpa<const N: usize>(&mut self, ticks: u32, goals_kpa: &[Pair]) -> [Pair; N] {
        let goal = |ahead: usize| goals_kpa.get(ahead).copied().unwrap_or([f64::NAN; CHANNELS]);
        if !self.is_late() {
            return std::array::from_fn(goal);
        }
        let now_kpa = self.next_kpa(ticks, goal(0));
        let mut later = self.clone();
        // The sensors have followed up to the last goal that was known: the next takes all ticks since then.
        let is_known = |ahead: usize| goal(ahead).iter().all(|kpa| kpa.is_finite());
        let mut since = if is_known(0) { 0 } else { ticks };
        std::array::from_fn(|ahead| {
            if ahead == 0 {
                return now_kpa;
            }
            since = since.saturating_add(1);
            let shown_kpa = later.next_kpa(since, goal(ahead));
            if is_known(ahead) {
                since = 0;
            }
            shown_kpa
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TICK_S: f64 = 1.0 / TICKS_PER_S;

    fn with(mechanisms: &str) -> Rig {
        Rig::from_toml(&format!("{}\n{mechanisms}", crate::rig::DUAL_PRESSURE)).unwrap()
    }

    fn lag(sensor: &str, rest: &str) -> String {
        format!("[[mechanisms]]\nid = \"sensor_lag\"\ncomponent = \"{sensor}\"\n{rest}\n")
    }

    /// A ramp that sets out from rest, behind one lag: r t − r τ (1 − e^(−t/τ)).
    #[test]
    fn a_ramp_is_shown_as_the_equation_of_the_first_order_has_it() {
        let (rate, tau_s) = (4.0, 0.16);
        let mut shown = ShownReference::of(&with(&lag("sensor_pos", "time_constant_ms = 160.0")));
        assert!(shown.is_late());
        for tick in 0..500 {
            let time_s = TICK_S * f64::from(tick);
            let [pos, neg] = shown.next_kpa(1, [40.0 + rate * time_s, -70.0]);
            let expected = 40.0 + rate * (time_s + tau_s * (-time_s / tau_s).exp_m1());
            assert!((pos - expected).abs() < 1e-9, "{time_s} s: {pos}, {expected}");
            assert_eq!(neg, -70.0, "the other sensor reads what is there");
        }
        // Begun anew it has settled at once.
        shown.restart();
        assert_eq!(shown.next_kpa(1, [90.0, -70.0]), [90.0, -70.0]);
    }

    /// Two lags in series behind a ramp, against Euler steps of 2 µs.
    #[test]
    fn a_second_lag_takes_what_the_first_has_come_to() {
        let two = lag("sensor_neg", "time_constant_ms = 30.0\nsecond_time_constant_ms = 80.0");
        let mut shown = ShownReference::of(&with(&two));
        shown.next_kpa(1, [80.0, -60.0]);
        let (mut first, mut second, step_s) = (-60.0, -60.0, 2e-6);
        for tick in 0..30 {
            let reading = shown.next_kpa(1, [80.0, -60.0 - 5.0 * TICK_S * f64::from(tick + 1)])[1];
            for step in 0..10_000 {
                let at = -60.0 - 5.0 * (TICK_S * f64::from(tick) + step_s * f64::from(step));
                let towards = first;
                first += step_s / 0.03 * (at - first);
                second += step_s / 0.08 * (towards - second);
            }
            assert!((reading - second).abs() < 1e-4, "tick {tick}: {reading}, {second}");
        }
    }

    #[test]
    fn without_late_sensors_it_is_the_reference_to_the_bit() {
        let valves = "[[mechanisms]]\nid = \"valve_lag\"\ncomponent = \"valve_pos\"\ntime_constant_ms = 80.0\n";
        let gain = "[[mechanisms]]\nid = \"sensor_gain\"\ncomponent = \"sensor_pos\"\ngain = 1.02\n";
        let off = lag("sensor_neg", "time_constant_ms = 100.0\nenabled = false");
        let mut shown = ShownReference::of(&with(&format!("{valves}{gain}{off}")));
        assert!(!shown.is_late());
        for tick in 0..600 {
            let at = 0.1 * f64::from(tick);
            let reference_kpa = [80.0 + at.sin(), -70.0 + 0.3 * at.cos()];
            let bits = |kpa: Pair| kpa.map(f64::to_bits);
            assert_eq!(bits(shown.next_kpa(1 + tick % 3, reference_kpa)), bits(reference_kpa));
        }
    }

    /// Goals ahead are foretold as they are shown when they come.
    #[test]
    fn goals_ahead_are_shown_as_they_will_be() {
        let rig = with(&lag("sensor_pos", "time_constant_ms = 160.0"));
        let mut shown = ShownReference::of(&rig);
        let goal = |tick: usize| [80.0 + 3.0 * (0.1 * tick as f64).sin(), -70.0];
        let mut foretold = Vec::new();
        for tick in 0..50 {
            let goals_kpa: Vec<Pair> = (tick..tick + 6).map(goal).collect();
            let ahead: [Pair; 6] = shown.goals_kpa(1, &goals_kpa);
            foretold.push(ahead);
            for back in 0..foretold.len().min(6) {
                assert_eq!(foretold[tick - back][back], ahead[0], "{back} ticks before {tick}");
            }
        }
        assert!((foretold[49][0][0] - goal(49)[0]).abs() > 0.1);
    }

    /// Ticks in which the reference is not known are made up for by the next: it has gone straight.
    #[test]
    fn a_gap_is_gone_over_at_once() {
        let rig = with(&lag("sensor_pos", "time_constant_ms = 160.0"));
        let (mut whole, mut gap) = (ShownReference::of(&rig), ShownReference::of(&rig));
        for tick in 0..100 {
            let reference_kpa = [80.0 + 0.05 * f64::from(tick), -70.0];
            let reading = whole.next_kpa(1, reference_kpa);
            match tick {
                40..=43 => assert!(gap.next_kpa(1, [f64::NAN, -70.0])[0].is_nan()),
                44 => assert!((gap.next_kpa(5, reference_kpa)[0] - reading[0]).abs() < 1e-9),
                _ => assert!((gap.next_kpa(1, reference_kpa)[0] - reading[0]).abs() < 1e-9),
            }
        }
    }

    /// Goals behind some that are not known, now or ahead, are shown as if the reference had gone straight to them.
    #[test]
    fn goals_behind_a_gap_are_shown_as_they_will_be() {
        let mut whole = ShownReference::of(&with(&lag("sensor_pos", "time_constant_ms = 160.0")));
        let goal = |tick: u32| [80.0 + 0.05 * f64::from(tick), -70.0];
        for tick in 0..50 {
            whole.next_kpa(1, goal(tick));
        }
        let gap = whole.clone();
        let expected: Vec<Pair> = (50..60).map(|tick| whole.next_kpa(1, goal(tick))).collect();
        for unknown in [50..53, 52..54, 51..52] {
            let known = |tick: u32| if unknown.contains(&tick) { [f64::NAN; CHANNELS] } else { goal(tick) };
            let goals_kpa: Vec<Pair> = (50..56).map(known).collect();
            let ahead: [Pair; 6] = gap.clone().goals_kpa(1, &goals_kpa);
            for (tick, (shown_kpa, expected_kpa)) in (50..).zip(ahead.iter().zip(&expected)) {
                if unknown.contains(&tick) {
                    assert!(shown_kpa[0].is_nan(), "{tick}");
                } else {
                    assert!((shown_kpa[0] - expected_kpa[0]).abs() < 1e-9, "{tick}: {shown_kpa:?}, {expected_kpa:?}");
                }
            }
        }
        // Two ticks after the last that was known.
        let mut late = gap.clone();
        assert!(late.next_kpa(1, [f64::NAN; CHANNELS])[0].is_nan());
        let [now, next]: [Pair; 2] = late.goals_kpa(2, &[[f64::NAN; CHANNELS], goal(52)]);
        assert!(now[0].is_nan() && (next[0] - expected[2][0]).abs() < 1e-9, "{next:?}");
    }
}

//! Check that venting is what it should be: reported by the cRIO, and the pressure falls, and goes on falling until the chamber is
//! near rest. That it has begun to fall proves little: gas that a pump has heated loses a fifth of its pressure by cooling in a
//! chamber that is shut.

use model::observation::{CHANNELS, Pair};
use supervisor::{Condition, ConditionSet};

/// Frames after the vent command in which the pressure must have begun to fall, at the least: half a second (study of the
/// daemon, §3.4). A rig whose readings take longer for half of their way, by its model, has that long: one that is ten times as
/// slow has then fallen by `LEAST_FALL`.
pub const FRAMES_TO_FALL: u32 = 25;
/// Frames after the vent command from which on the echo must report open vents (study of the daemon, §3.4).
pub const FRAMES_TO_ECHO: u32 = 3;
/// Echoed duty from which on a vent counts as open.
pub const OPEN_DUTY: f32 = 0.99;
/// Distance from rest below which there is nothing to see fall, in kPa: sensor bias and the balance of a pump that runs on.
const NEAR_REST_KPA: f64 = 10.0;
/// Share of the distance to rest that must be gone: a vent empties a chamber in a few tenths of a second, so this is what is
/// left of it with an exhaust that is ten times too narrow (derived).
const LEAST_FALL: f64 = 0.05;
/// Windows in a row that take off less than [`LEAST_FALL`] of what the window before had left, so that one that a wrong reading
/// has spoilt is no fault (a single reading that is 40 kPa off moves a mean of 25 by 1.6 kPa).
const WINDOWS_STANDING: u32 = 2;
/// Share of what there was when the vents were commanded open that a chamber may keep, where that is less than
/// [`UNDER_PRESSURE_KPA`]: a chamber that was hardly filled and stays shut keeps more (chosen).
const MAY_KEEP: f64 = 0.5;
/// Distance from rest that is never too much, in kPa: a vent valve whose spring shuts it at low pressure keeps 10.4 kPa on a rig
/// drawn with a sagging supply, and a sensor has a bias.
const SPRING_KEEPS_KPA: f64 = 15.0;
/// Rise above the highest pressure soon after the vent command that no vented chamber makes, in kPa (chosen).
const RISE_KPA: f64 = 5.0;
/// Frames, at the least, in which a reading may still rise: the valve's delay and lag, and what a late sensor has yet to show.
const FRAMES_TO_RISE: u32 = 10;
/// Frames in a row in which it must have risen, so that one wrong reading is no fault (as for a reading that jumps).
const FRAMES_RISEN: u32 = 3;
/// Distance from rest beyond which a rig that a new session finds vented must be seen to empty, in kPa
/// (chosen: well above what a bias, or a pump that runs on against another muffler than the model's, leaves).
const UNDER_PRESSURE_KPA: f64 = 30.0;

/// Venting of a rig, by its model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VentModel {
    /// Pressures at which it comes to rest with both vents open, kPa gauge.
    pub rest_kpa: Pair,
    /// Ticks in which its readings make half of the way there.
    pub half_ticks: [u32; CHANNELS],
}

impl VentModel {
    /// A rig that is vented within half a second and comes to rest at the atmosphere.
    pub const QUICK: VentModel = VentModel { rest_kpa: [0.0; CHANNELS], half_ticks: [0; CHANNELS] };

    /// Distance from rest of a channel's reading, in kPa: how much further it is from the atmosphere than at rest.
    fn distance_kpa(&self, channel: usize, reading_kpa: f64) -> f64 {
        reading_kpa.abs() - self.rest_kpa[channel].abs()
    }
}

/// Tells a chamber that empties from one that stands: means of windows, each held against the one before.
///
/// Through an open vent the share of what is left that a window takes off does not shrink toward rest by much: choked flow takes
/// off a growing share, a line with laminar loss (p' = −k p (p + 2 p0)) at rest seven tenths of what it takes off at 90 kPa. A
/// chamber with such a line that is ten times as slow as the model loses 7 % in a window at 90 kPa and 5.1 % near rest: so what the
/// first window must show, [`LEAST_FALL`], every further one must.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Emptying {
    /// Distance from rest up to which a chamber may stand, in kPa.
    may_stand_kpa: f64,
    sum_kpa: f64,
    frames: u32,
    /// Mean distance from rest in the window before.
    before_kpa: Option<f64>,
    /// Windows in a row that took off too little.
    standing: u32,
}

impl Emptying {
    fn new(may_stand_kpa: f64) -> Self {
        Emptying { may_stand_kpa, sum_kpa: 0.0, frames: 0, before_kpa: None, standing: 0 }
    }

    /// An emptying from this distance from rest on.
    fn from(distance_kpa: f64) -> Self {
        Emptying::new((MAY_KEEP * distance_kpa).clamp(SPRING_KEEPS_KPA, UNDER_PRESSURE_KPA))
    }

    /// Takes a distance from rest, in windows of so many frames, and answers whether the chamber stands under pressure.
    fn stands(&mut self, distance_kpa: f64, window: u32) -> bool {
        self.sum_kpa += distance_kpa;
        self.frames += 1;
        if self.frames >= window {
            let mean = self.sum_kpa / f64::from(self.frames);
            let too_little = self.before_kpa.is_some_and(|before| mean > before * (1.0 - LEAST_FALL));
            self.standing = if too_little && mean > self.may_stand_kpa { self.standing + 1 } else { 0 };
            (self.sum_kpa, self.frames, self.before_kpa) = (0.0, 0, Some(mean));
        }
        // Once it has emptied there is nothing left to wait a window for.
        self.standing >= WINDOWS_STANDING && distance_kpa > self.may_stand_kpa
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Venting {
    from_kpa: Pair,
    frames: u32,
    disagreeing: u32,
    fallen: [bool; CHANNELS],
    emptying: [Emptying; CHANNELS],
    /// Frames in a row in which each has risen.
    risen: [u32; CHANNELS],
}

impl Venting {
    fn from(from_kpa: Pair, fallen: [bool; CHANNELS], emptying: [Emptying; CHANNELS]) -> Self {
        Venting { from_kpa, frames: 0, disagreeing: 0, fallen, emptying, risen: [0; CHANNELS] }
    }
}

/// Watches a rig that was under pressure and is vented now.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VentCheck {
    model: VentModel,
    venting: Option<Venting>,
}

impl VentCheck {
    /// A check for a rig of this model.
    pub fn new(model: VentModel) -> Self {
        VentCheck { model, venting: None }
    }

    /// Goes on by another model.
    pub fn set_model(&mut self, model: VentModel) {
        self.model = model;
    }

    /// The vents are commanded open from now on, at these pressures.
    pub fn begin(&mut self, measured_kpa: Pair) {
        let emptying = |c: usize| Emptying::from(self.model.distance_kpa(c, measured_kpa[c]));
        self.venting = Some(Venting::from(measured_kpa, [false; CHANNELS], std::array::from_fn(emptying)));
    }

    /// The vents are commanded open by a session that has just begun, and nobody knows since when: what it finds under pressure
    /// must be seen to empty. Changes nothing while a venting is watched already.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn begin_as_found(&mut self, readings_kpa: [Option<f64>; CHANNELS]) {
        if let (None, [Some(positive), Some(negative)]) = (&self.venting, readings_kpa) {
            let found = [positive, negative];
            let at_rest = |c: usize| self.model.distance_kpa(c, found[c]) < UNDER_PRESSURE_KPA;
            let emptying = [Emptying::new(UNDER_PRESSURE_KPA); CHANNELS];
            self.venting = Some(Venting::from(found, std::array::from_fn(at_rest), emptying));
        }
    }

    /// The vents are no longer commanded open, or there is nobody who could say.
    pub fn end(&mut self) {
        self.venting = None;
    }

    /// Takes a frame: echoed duties, and the readings that can be read.
    ///
    /// # Real-time
    /// May run in the tick.
    pub fn judge(&mut self, echo: [f32; CHANNELS], readings_kpa: [Option<f64>; CHANNELS], found: &mut ConditionSet) {
        let Some(venting) = &mut self.venting else { return };
        venting.frames = venting.frames.saturating_add(1);
        // A command takes a tick to come back; NaN is not open.
        let open = echo.iter().all(|duty| *duty >= OPEN_DUTY);
        venting.disagreeing = if open { 0 } else { venting.disagreeing.saturating_add(1) };
        if venting.disagreeing > FRAMES_TO_ECHO {
            found.insert(Condition::VentNotEchoed, echo.iter().map(|d| f64::from(*d)).fold(1.0, f64::min));
        }
        #[allow(clippy::needless_range_loop)] // several arrays of channels side by side
        for c in 0..CHANNELS {
            let Some(now) = readings_kpa[c] else { continue };
            let distance = |kpa: f64| self.model.distance_kpa(c, kpa);
            let half = self.model.half_ticks[c];
            let may_rise = venting.frames <= FRAMES_TO_RISE.max(half);
            if may_rise && distance(now) > distance(venting.from_kpa[c]) {
                venting.from_kpa[c] = now;
            }
            let (from, left) = (distance(venting.from_kpa[c]), distance(now));
            venting.fallen[c] |= left <= NEAR_REST_KPA || left <= from * (1.0 - LEAST_FALL);
            let window = FRAMES_TO_FALL.max(half);
            let late = venting.frames >= window && !venting.fallen[c];
            let stands = venting.emptying[c].stands(left, window);
            let rising = !may_rise && left > from.max(0.0) + RISE_KPA && left > NEAR_REST_KPA;
            venting.risen[c] = if rising { venting.risen[c] + 1 } else { 0 };
            // Once it has fallen, what counts is the lowest it has reached.
            if venting.fallen[c] && left < from {
                venting.from_kpa[c] = now;
            }
            if late || stands || venting.risen[c] >= FRAMES_RISEN {
                found.insert(Condition::VentIneffective, now);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OPEN: [f32; 2] = [1.0, 1.0];

    /// Frames until something is found, over a course of both pressures.
    fn found(echo: [f32; 2], course: impl Fn(u32) -> Pair) -> Option<(u32, Condition)> {
        first_found(VentCheck::new(VentModel::QUICK), echo, 500, course)
    }

    fn first_found(
        mut check: VentCheck,
        echo: [f32; 2],
        frames: u32,
        course: impl Fn(u32) -> Pair,
    ) -> Option<(u32, Condition)> {
        check.begin(course(0));
        (0..frames).find_map(|k| {
            let mut set = ConditionSet::EMPTY;
            check.judge(echo, course(k).map(Some), &mut set);
            set.iter().next().map(|condition| (k, condition))
        })
    }

    #[test]
    fn a_rig_that_empties_is_vented_and_one_that_does_not_is_a_fault() {
        let empties =
            |tau: f64| move |k: u32| [90.0 * (-f64::from(k) / tau).exp(), -70.0 * (-f64::from(k) / tau).exp()];
        assert_eq!(found(OPEN, empties(25.0)), None);
        assert_eq!(found(OPEN, empties(300.0)), None, "twelve times as slow");
        assert_eq!(found(OPEN, |_| [0.2, -0.1]), None, "nothing to vent");
        let stuck = found(OPEN, |k| [90.0, empties(25.0)(k)[1]]);
        assert!(stuck.is_some_and(|(k, c)| k < FRAMES_TO_FALL && c == Condition::VentIneffective), "{stuck:?}");
        let rising = found(OPEN, |k| [90.0 + 2.0 * f64::from(k), -70.0]);
        assert!(rising.is_some_and(|(k, _)| k < FRAMES_TO_RISE + 3 + FRAMES_RISEN), "{rising:?}");
        // It falls and comes back: somebody else opens a supply.
        let back = found(OPEN, |k| if k < 40 { empties(25.0)(k) } else { [60.0, -1.0] });
        assert_eq!(back.map(|(_, c)| c), Some(Condition::VentIneffective));
    }

    /// Pressure of gas that cools from `from` to four fifths of it, in a chamber that is shut.
    fn cooled(from: f64, k: u32) -> f64 {
        from * (0.8 + 0.2 * (-f64::from(k) / 40.0).exp())
    }

    #[test]
    fn gas_that_cools_in_a_chamber_that_is_shut_is_not_vented() {
        let empties = |k: u32, from: f64| from * (-f64::from(k) / 25.0).exp();
        for (name, course) in [
            ("positive", Box::new(|k| [cooled(82.0, k), empties(k, -70.0)]) as Box<dyn Fn(u32) -> Pair>),
            ("negative", Box::new(|k| [empties(k, 82.0), cooled(-70.0, k)])),
            ("hardly filled", Box::new(|k| [cooled(24.0, k), empties(k, -20.0)])),
            ("let go for a moment, then shut", Box::new(|k| [empties(k.min(12), 82.0), empties(k, -70.0)])),
        ] {
            // Fallen far enough within the first window, and still nothing is vented: 5 s are plenty for whoever stands beside it.
            assert!(course(FRAMES_TO_FALL).iter().zip(course(0)).all(|(now, from)| now.abs() <= 0.95 * from.abs()));
            let found = found(OPEN, &course);
            assert!(found.is_some_and(|(k, c)| k < 250 && c == Condition::VentIneffective), "{name}: {found:?}");
        }
        let found = found_as_found(|k| [cooled(82.0, k), 0.0]);
        assert!(
            found.is_some_and(|(_, c)| c == Condition::VentIneffective),
            "found by a session that begins: {found:?}"
        );
    }

    #[test]
    fn a_chamber_that_empties_slowly_or_keeps_little_is_vented() {
        // Laminar flow: p' = -k p (p + 2 p0), with so many frames as its time constant near rest, where it is slowest.
        let laminar = |frames: f64| {
            let fall = move |p: &f64| Some(p - p * (p + 202.65) / (202.65 * frames));
            let course: Vec<f64> = std::iter::successors(Some(90.0), fall).take(6000).collect();
            move |k: u32| [course[k as usize], -course[k as usize]]
        };
        assert_eq!(found(OPEN, laminar(300.0)), None, "a line with laminar loss, ten times too narrow");
        // As large as its model says, and ten times as slow as that.
        let model = VentModel { half_ticks: [100; CHANNELS], ..VentModel::QUICK };
        let large = |k: u32| [90.0 * 0.5_f64.powf(f64::from(k) / 1000.0), -0.1];
        assert_eq!(first_found(VentCheck::new(model), OPEN, 3000, large), None, "a large chamber");
        // The same with a laminar line: the model comes from 90 to 45 kPa in 100 frames, by the solution of its equation.
        let near_rest = 100.0 / (90.0 / 292.65 * 247.65 / 45.0_f64).ln();
        let vented = |times: f64| first_found(VentCheck::new(model), OPEN, 6000, laminar(times * near_rest));
        assert_eq!(vented(10.0), None, "a large chamber with a laminar line");
        assert!(vented(20.0).is_some(), "twenty times as slow is no venting");
        // A spring that shuts the valve at low pressure, and the bias of a sensor.
        for from in [80.0, 10.0] {
            assert_eq!(
                found(OPEN, |k| [10.4 + from * (-f64::from(k) / 25.0).exp(), 4.0]),
                None,
                "from {from} kPa more"
            );
        }
    }

    #[test]
    fn a_window_that_noise_has_spoilt_is_no_fault() {
        let mut word = 1u32;
        let mut noise = move || {
            word = word.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(word >> 16) / 65_536.0 - 0.5
        };
        let noisy: Vec<f64> = (0..501).map(|k| 90.0 * (-f64::from(k) / 250.0).exp() + 3.0 * noise()).collect();
        assert_eq!(found(OPEN, |k| [noisy[k as usize], -0.1]), None, "3 kPa of noise on a slow vent");
        // So slow that a single window with a wrong reading takes off too little: it must not count alone.
        for wrong in 1..250 {
            let spiked = |k: u32| 90.0 * (-f64::from(k) / 400.0).exp() + if k == wrong { 40.0 } else { 0.0 };
            assert_eq!(found(OPEN, |k| [spiked(k), -0.1]), None, "frame {wrong} reads 40 kPa too much");
        }
    }

    /// Frames until something is found of a rig that a session finds vented.
    fn found_as_found(course: impl Fn(u32) -> Pair) -> Option<(u32, Condition)> {
        let mut check = VentCheck::new(VentModel::QUICK);
        (0..500).find_map(|k| {
            let mut set = ConditionSet::EMPTY;
            check.begin_as_found(course(k).map(Some));
            check.judge(OPEN, course(k).map(Some), &mut set);
            set.iter().next().map(|condition| (k, condition))
        })
    }

    #[test]
    fn what_a_session_finds_under_pressure_must_empty_and_what_it_finds_at_rest_must_stay_there() {
        let stuck = found_as_found(|_| [90.0, 0.0]);
        assert!(stuck.is_some_and(|(k, c)| k < FRAMES_TO_FALL && c == Condition::VentIneffective), "{stuck:?}");
        assert_eq!(found_as_found(|k| [90.0 * (-f64::from(k) / 25.0).exp(), -20.0]), None, "it empties");
        assert_eq!(found_as_found(|_| [20.0, 9.0]), None, "another rest than the model's, or a bias");
        assert!(found_as_found(|k| [if k < 50 { 0.0 } else { 40.0 }, 0.0]).is_some(), "somebody opens a supply");
        let spike = |k: u32| [if k % 50 < 2 { 40.0 } else { 0.0 }, 0.0];
        assert_eq!(found_as_found(move |k| spike(k + 2)), None, "two wrong readings in a row are none");
    }

    #[test]
    fn vents_that_are_not_reported_are_a_fault() {
        for echo in [[0.3, 1.0], [1.0, f32::NAN], [0.0, 0.0]] {
            let found = found(echo, |k| [90.0 * (-f64::from(k) / 25.0).exp(), -70.0]);
            assert!(found.is_some_and(|(k, c)| k <= FRAMES_TO_ECHO && c == Condition::VentNotEchoed), "{found:?}");
        }
    }

    #[test]
    fn a_reading_that_cannot_be_read_is_not_judged() {
        let mut check = VentCheck::new(VentModel::QUICK);
        check.begin([90.0, -70.0]);
        for k in 0..200 {
            let mut set = ConditionSet::EMPTY;
            check.judge(OPEN, [None, Some(-70.0 * (-f64::from(k) / 25.0).exp())], &mut set);
            assert!(set.is_empty(), "{k}");
        }
    }
}

//! Eight rigs side by side, each with its law, its noise and its valves: a flight of the trial.
//!
//! A tick runs as in the daemon: measure, predict (MPObs), observe, decide, limit, apply. Plant and model both have
//! averaged pumps, which a tick of 20 ms cannot tell from real ones by more than some hundredths of a kPa. Behind late sensors
//! the fallback is told by the observer of the model, as it is in the daemon; elsewhere that would tell it what is read.

use std::sync::Arc;

use law::{ControlInput, PolicyLaw, SoftStart, TICK_S};
use model::observation::{
    ACTION_LEN, AHEAD, ActionTrajectory, CHANNELS, CORRECTION_OBSERVATION_LEN, GOALS_AHEAD, ObservationLayout, Pair,
};
use model::predict::{DualPressureRig, Predictor};
use model::real::{Lanes, Real};
use model::rig::{Rig, RigError};
use model::shown_reference::ShownReference;
use model::steady::SteadyMap;
use policy::Policy;
use proto::emulator::{SensorScale, Sensors, rig_and_crio};

use super::course::Course;
use super::rigs::{Drawn, LANES};
use super::tally::{Sums, Tally};

type Eight = Lanes<LANES>;

/// Both vents open: how a rig is found.
const VENT: Pair = [1.0; CHANNELS];
/// Step of averaged plants in ms.
const STEP_MS: f64 = 10.0;

/// The envelope that must not be left, in kPa gauge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Highest positive pressure.
    pub max_pos_kpa: f64,
    /// Lowest negative pressure.
    pub min_neg_kpa: f64,
}

/// Source of the duties.
pub(super) enum Flyer<'a> {
    /// The fallback.
    Fallback,
    /// A policy in its law.
    Policy(&'a mut Policy),
}

impl Flyer<'_> {
    fn layout(&self) -> ObservationLayout {
        let version = match self {
            Flyer::Fallback => None,
            Flyer::Policy(policy) => ObservationLayout::of_version(policy.contract().version),
        };
        version.unwrap_or(ObservationLayout::Correction)
    }
}

/// Eight rigs, compiled once and flown many times.
pub(super) struct Bundle {
    drawn: Vec<Drawn>,
    plant: DualPressureRig<Eight>,
    model: DualPressureRig<Eight>,
    map: Arc<SteadyMap>,
    scales: [SensorScale; CHANNELS],
    /// Tells whether a sensor of the model is late.
    is_late: bool,
    limits: Limits,
}

impl Bundle {
    pub(super) fn new(model: &Rig, drawn: Vec<Drawn>, map: &Arc<SteadyMap>, limits: Limits) -> Result<Self, RigError> {
        let rigs: Vec<Rig> = drawn.iter().map(|d| d.rig.clone()).collect();
        let scales = rig_and_crio(model)?.1.scales;
        Ok(Bundle {
            plant: DualPressureRig::averaged_side_by_side(&rigs, STEP_MS)?,
            model: DualPressureRig::averaged_side_by_side(std::slice::from_ref(model), STEP_MS)?,
            map: Arc::clone(map),
            drawn,
            scales,
            is_late: ShownReference::of(model).is_late(),
            limits,
        })
    }

    /// Noise of the converter on both channels, root mean square in kPa.
    pub(super) fn noise_kpa(&self) -> Pair {
        self.scales.map(|scale| (scale.gauge_kpa(Sensors::ADC_NOISE_V_RMS) - scale.gauge_kpa(0.0)).abs())
    }

    /// Flies the course on all eight.
    pub(super) fn fly(&self, course: &Course, flyer: &mut Flyer<'_>) -> Vec<Tally> {
        let layout = flyer.layout();
        let mut plant = self.plant.clone();
        let mut predictor = Predictor::with(self.model.clone());
        let readings = |plant: &DualPressureRig<Eight>, lane: usize| plant.readings_kpa().map(|p| p.lane(lane));
        let mut members: Vec<Member> = self
            .drawn
            .iter()
            .enumerate()
            .map(|(lane, drawn)| {
                let mut member = Member::new(
                    drawn,
                    &self.map,
                    layout,
                    Sensors::new(self.scales, Sensors::ADC_NOISE_V_RMS, lane as u64 + 1),
                );
                member.begin(readings(&plant, lane), course);
                member
            })
            .collect();
        let of = |members: &[Member], value: &dyn Fn(&Member) -> f64| {
            Eight::from_lanes(|lane| members.get(lane).map_or(0.0, value))
        };
        predictor.restart(std::array::from_fn(|c| of(&members, &|m| m.input.measured_kpa[c])), VENT.map(Eight::splat));
        for tick in 0..course.ticks {
            for (lane, member) in members.iter_mut().enumerate() {
                member.measure(readings(&plant, lane), course, tick);
            }
            let predicts = matches!(flyer, Flyer::Policy(_));
            let observes = predicts || self.is_late;
            if observes {
                let undelayed = predictor.observe(std::array::from_fn(|c| of(&members, &|m| m.input.measured_kpa[c])));
                for (lane, member) in members.iter_mut().enumerate() {
                    member.input.undelayed_kpa = undelayed.map(|p| p.lane(lane));
                }
            }
            if predicts {
                let plan =
                    std::array::from_fn(|j| std::array::from_fn(|c| of(&members, &|m| m.plan.remaining()[j][c])));
                let predicted = predictor.predict(&plan, true);
                for (lane, member) in members.iter_mut().enumerate() {
                    member.predicted(predicted.map(|pair| pair.map(|p| p.lane(lane))));
                }
            }
            members.iter_mut().for_each(|member| member.decide(flyer));
            let sent: [Eight; CHANNELS] = std::array::from_fn(|c| of(&members, &|m| m.duty[c]));
            if observes {
                predictor.advance(sent, true);
            }
            let at_valves: Vec<Pair> = members.iter_mut().map(Member::at_valves).collect();
            plant.tick(
                std::array::from_fn(|c| Eight::from_lanes(|lane| at_valves.get(lane).map_or(1.0, |d| d[c]))),
                true,
            );
            for (lane, member) in members.iter_mut().enumerate() {
                member.count(readings(&plant, lane), course, tick, self.limits);
            }
        }
        members.iter().map(|member| member.sums.tally()).collect()
    }
}

/// One rig but for its physics.
struct Member {
    law: PolicyLaw,
    sensors: Sensors,
    approach: SoftStart,
    input: ControlInput,
    predicted_kpa: [Pair; AHEAD],
    plan: ActionTrajectory,
    duty: Pair,
    before: Pair,
    valves: Valves,
    sums: Sums,
}

impl Member {
    fn new(drawn: &Drawn, map: &Arc<SteadyMap>, layout: ObservationLayout, sensors: Sensors) -> Self {
        Member {
            law: PolicyLaw::new(Arc::clone(map), layout),
            sensors,
            approach: SoftStart::new([0.0; CHANNELS], [0.0; CHANNELS]),
            input: ControlInput::of_measured([0.0; CHANNELS], [[0.0; CHANNELS]; GOALS_AHEAD + 1]),
            predicted_kpa: [[0.0; CHANNELS]; AHEAD],
            plan: ActionTrajectory::held(VENT),
            duty: VENT,
            before: VENT,
            valves: Valves::new(drawn),
            sums: Sums::default(),
        }
    }

    fn begin(&mut self, readings_kpa: Pair, course: &Course) {
        self.law.restart(VENT);
        self.approach = SoftStart::new(readings_kpa, course.at(0));
        self.input.measured_kpa = readings_kpa;
    }

    fn measure(&mut self, readings_kpa: Pair, course: &Course, tick: usize) {
        let volts = self.sensors.sample(readings_kpa, [&[], &[]]);
        let scales = self.sensors.scales();
        let measured_kpa = std::array::from_fn(|c| scales[c].gauge_kpa(f64::from(volts[c])));
        let goals_kpa = std::array::from_fn(|j| {
            let (goal, offset) = (course.at(tick + j), self.approach.offset_kpa((tick + j) as f64 * TICK_S));
            std::array::from_fn(|c| goal[c] + offset[c])
        });
        self.input = ControlInput::of_measured(measured_kpa, goals_kpa);
        self.predicted_kpa = [measured_kpa; AHEAD];
    }

    fn predicted(&mut self, predicted_kpa: [Pair; AHEAD]) {
        if predicted_kpa.as_flattened().iter().all(|p| p.is_finite()) {
            self.predicted_kpa = predicted_kpa;
        }
    }

    fn decide(&mut self, flyer: &mut Flyer<'_>) {
        let mut decision = self.law.observe(&self.input);
        if let Flyer::Policy(policy) = flyer {
            let mut observation = [0.0; CORRECTION_OBSERVATION_LEN];
            let told = observation.get_mut(..self.law.contract().observation_len()).unwrap_or_default();
            self.law.write_observation(&self.input, &self.predicted_kpa, told);
            let mut outputs = [0.0; ACTION_LEN];
            match policy.run(told, &mut outputs) {
                Ok(()) => decision = self.law.decide(&self.input, &outputs),
                Err(_) => self.sums.not_finite = true,
            }
        }
        self.before = self.duty;
        self.duty = decision.duty();
        self.plan = decision.trajectory;
        self.law.applied(self.duty);
    }

    fn at_valves(&mut self) -> Pair {
        self.valves.follow(self.duty)
    }

    /// Takes in the readings before noise at the end of a tick.
    fn count(&mut self, readings_kpa: Pair, course: &Course, tick: usize, limits: Limits) {
        // Written so that a number that is none counts as outside.
        let within = readings_kpa[0] <= limits.max_pos_kpa && readings_kpa[1] >= limits.min_neg_kpa;
        if !within && self.sums.left_s.is_none() {
            self.sums.left_s = Some(tick as f64 * TICK_S);
        }
        let shown_kpa = course.shown_at(tick + 1);
        let error_kpa: Pair = std::array::from_fn(|c| readings_kpa[c] - shown_kpa[c]);
        if course.counts(tick) {
            self.sums.error(error_kpa);
        }
        if let Some(stretch) = course.still(tick) {
            self.sums.still(stretch, error_kpa, std::array::from_fn(|c| self.duty[c] - self.before[c]));
        }
    }
}

/// Faults of both valves of a rig beside what its file says: late, slow, with backlash.
struct Valves {
    delay_ticks: usize,
    /// Commands that have not come yet, the newest last.
    late: [Pair; 2],
    share: f64,
    opening: Pair,
    half_width: f64,
    flapper: Pair,
}

impl Valves {
    fn new(drawn: &Drawn) -> Self {
        let share = if drawn.lag_ms > 0.0 { 1.0 - (-1e3 * TICK_S / drawn.lag_ms).exp() } else { 1.0 };
        Valves {
            delay_ticks: drawn.delay_ticks,
            late: [VENT; 2],
            share,
            opening: VENT,
            half_width: drawn.backlash_duty,
            flapper: VENT,
        }
    }

    fn follow(&mut self, command: Pair) -> Pair {
        self.late = [self.late[1], command];
        let come = if self.delay_ticks == 0 { command } else { self.late[0] };
        #[allow(clippy::needless_range_loop)] // several arrays of channels side by side
        for c in 0..CHANNELS {
            self.flapper[c] = self.flapper[c].clamp(come[c] - self.half_width, come[c] + self.half_width);
            self.opening[c] += self.share * (self.flapper[c] - self.opening[c]);
        }
        self.opening.map(|u| u.clamp(0.0, 1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The paper's rig, whose positive sensor lags by 160 ms.
    fn late() -> Rig {
        let lag = "[[mechanisms]]\nid = \"sensor_lag\"\ncomponent = \"sensor_pos\"\ntime_constant_ms = 160.0\n";
        Rig::from_toml(&format!("{}\n{lag}", model::rig::DUAL_PRESSURE)).unwrap()
    }

    /// A chamber on the course, whose reading is the equation's of the first order, and a reading on the course.
    #[test]
    fn behind_a_late_sensor_a_chamber_on_the_course_errs_less_than_a_reading_on_it() {
        let rig = late();
        let map = Arc::new(SteadyMap::new(&rig).unwrap());
        let course = Course::new(&map, ShownReference::of(&rig));
        let drawn = Drawn { rig, delay_ticks: 0, lag_ms: 0.0, backlash_duty: 0.0 };
        let limits = Limits { max_pos_kpa: 160.0, min_neg_kpa: -95.0 };
        let tally = |reading_kpa: &mut dyn FnMut(usize) -> Pair| {
            let sensors = Sensors::new(rig_and_crio(&drawn.rig).unwrap().1.scales, Sensors::ADC_NOISE_V_RMS, 1);
            let mut member = Member::new(&drawn, &map, ObservationLayout::Correction, sensors);
            (0..course.ticks).for_each(|tick| member.count(reading_kpa(tick + 1), &course, tick, limits));
            member.sums.tally().rmse_kpa
        };
        // Steps of 20 µs of the lag behind a straight line.
        let (mut lagged, steps) = (course.at(0)[0], 1000_u32);
        let on_the_chamber = tally(&mut |tick| {
            let ([from, _], [to, neg]) = (course.at(tick - 1), course.at(tick));
            for step in 0..steps {
                let at = from + (to - from) * f64::from(step) / f64::from(steps);
                lagged += TICK_S / f64::from(steps) / 0.16 * (at - lagged);
            }
            [lagged, neg]
        });
        let on_the_reading = tally(&mut |tick| course.at(tick));
        assert!(on_the_chamber[0] < 1e-3 && on_the_chamber[1] == 0.0, "{on_the_chamber:?}");
        assert!(on_the_reading[0] > 0.3, "{on_the_reading:?}");
    }

    #[test]
    fn the_noise_of_the_trial_is_the_converters() {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let map = Arc::new(SteadyMap::new(&rig).unwrap());
        let [first, _] = super::super::rigs::drawn(&rig).unwrap();
        let limits = Limits { max_pos_kpa: 160.0, min_neg_kpa: -95.0 };
        let [pos, neg] = Bundle::new(&rig, first, &map, limits).unwrap().noise_kpa();
        // 0.24 mV of 250 and of 25.25 kPa/V.
        assert!((pos - 0.06).abs() < 1e-9 && (neg - 0.00606).abs() < 1e-9, "{pos} {neg}");
    }
}

//! The loop of the daemon on `bench` with averaged pumps, knowing `dual_pressure` unless told otherwise: arbiter and safety filter.
// Each test file compiles this module for itself and uses part of it.
#![allow(dead_code, unreachable_pub, missing_docs, clippy::unwrap_used)]

use std::sync::Arc;

use handover::{Arbiter, Candidate, PolicyEvent, Snapshot, StoreEnd, channel};
use law::{ControlInput, SoftStart, TICK_S};
use model::observation::{AHEAD, ActionTrajectory, CHANNELS, Pair};
use model::predict::{DualPressureRig, Predictor};
use model::real::{Lanes, Real};
use model::rig::Rig;
use model::shown_reference::ShownReference;
use model::steady::SteadyMap;
use policy::Policy;
use proto::emulator::{PSE540A_R06, PSE541A_R06, SensorScale, Sensors};
use proto::reference::Reference;
use safety_filter::{Envelope, SafetyFilter, SlewLimit};

/// Bundles of four are the smallest whose averaged tick is compiled; one lane is looked at.
type Four = Lanes<4>;

pub const ENVELOPE: Envelope = Envelope { max_pos_kpa: 160.0, min_neg_kpa: -95.0 };

pub struct Loop {
    plant: DualPressureRig<Four>,
    predictor: Predictor<Four>,
    pub arbiter: Arbiter,
    pub store: StoreEnd,
    filter: SafetyFilter,
    sensors: Sensors,
    scales: [SensorScale; 2],
    reference: Reference,
    approach: Option<SoftStart>,
    plan: ActionTrajectory,
    tick: u32,
    pub last: Pair,
    /// The farthest true pressures, and the largest change of a duty since it was last asked for.
    pub farthest: Pair,
    pub steepest: f64,
    pub events: Vec<(u32, PolicyEvent)>,
    pub errors: Vec<Pair>,
}

pub fn policy(bytes: &[u8]) -> Policy {
    Policy::from_bytes("test".into(), bytes, &admission::signatures::offered()).unwrap()
}

impl Loop {
    pub fn new(active: Option<Policy>, reference: Reference, seed: u64) -> Self {
        Loop::knowing("dual_pressure", active, reference, seed)
    }

    /// A loop around another model.
    pub fn knowing(model: &str, active: Option<Policy>, reference: Reference, seed: u64) -> Self {
        let rig = |name: &str| Rig::builtin(name).unwrap();
        let averaged = |name: &str| DualPressureRig::<Four>::averaged_side_by_side(&[rig(name)], 10.0).unwrap();
        let map = Arc::new(SteadyMap::new(&rig(model)).unwrap());
        let (end, store) = channel();
        let scales = [PSE540A_R06, PSE541A_R06];
        Loop {
            plant: averaged("bench"),
            predictor: Predictor::with(averaged(model)),
            arbiter: Arbiter::new(map, ShownReference::of(&rig(model)), active.map(Candidate::new), end),
            store,
            filter: SafetyFilter::new(&rig(model), ENVELOPE, SlewLimit::DEFAULT).unwrap(),
            sensors: Sensors::new(scales, Sensors::ADC_NOISE_V_RMS, seed),
            scales,
            reference,
            approach: None,
            plan: ActionTrajectory::held([1.0; CHANNELS]),
            tick: 0,
            last: [1.0; CHANNELS],
            farthest: [0.0; CHANNELS],
            steepest: 0.0,
            events: Vec::new(),
            errors: Vec::new(),
        }
    }

    pub fn ticks(&mut self, count: u32) {
        (0..count).for_each(|_| self.step());
    }

    /// Goes on until `done` or for `most` ticks; whether it was done.
    pub fn until(&mut self, most: u32, mut done: impl FnMut(&Loop) -> bool) -> bool {
        (0..most).any(|_| {
            self.step();
            done(self)
        })
    }

    pub fn snapshot(&self) -> Snapshot {
        self.store.snapshot().unwrap_or_default()
    }

    fn step(&mut self) {
        let truth: Pair = self.plant.readings_kpa().map(|p| p.lane(0));
        self.farthest = [self.farthest[0].max(truth[0]), self.farthest[1].min(truth[1])];
        let volts = self.sensors.sample(truth, [&[], &[]]);
        let measured_kpa: Pair = std::array::from_fn(|c| self.scales[c].gauge_kpa(f64::from(volts[c])));
        let spread = |pair: Pair| pair.map(Four::splat);
        if self.approach.is_none() {
            self.predictor.restart(spread(measured_kpa), spread([1.0; CHANNELS]));
            self.arbiter.restart([1.0; CHANNELS]);
        }
        let approach = *self.approach.get_or_insert_with(|| SoftStart::new(measured_kpa, self.reference.at(0.0)));
        let goals_kpa = std::array::from_fn(|j| {
            // The paper's reference forth and back, so that it never jumps.
            let since_s = f64::from(self.tick + j as u32) * TICK_S;
            let (goal, offset) =
                (self.reference.at(60.0 - (since_s % 120.0 - 60.0).abs()), approach.offset_kpa(since_s));
            std::array::from_fn(|c| goal[c] + offset[c])
        });
        self.predictor.observe(spread(measured_kpa));
        self.filter.observe(measured_kpa);
        let predicted = self.predictor.predict(&self.plan.remaining().map(spread), true);
        let predicted: [Pair; AHEAD] = predicted.map(|pair| pair.map(|p| p.lane(0)));
        let input = ControlInput::of_measured(measured_kpa, goals_kpa);
        let arbitrated = self.arbiter.decide(&input, &predicted);
        self.plan = arbitrated.decision.trajectory;
        let sent = self.filter.limit(arbitrated.decision.duty()).duty;
        self.filter.sent(sent);
        let later = self.arbiter.applied(sent);
        for event in [arbitrated.event, later].into_iter().flatten() {
            self.events.push((self.tick, event));
        }
        self.predictor.advance(spread(sent), true);
        self.plant.tick(spread(sent), true);
        self.steepest = (0..CHANNELS).fold(self.steepest, |s, c| s.max((sent[c] - self.last[c]).abs()));
        self.errors.push(std::array::from_fn(|c| goals_kpa[0][c] - measured_kpa[c]));
        self.last = sent;
        self.tick += 1;
    }
}

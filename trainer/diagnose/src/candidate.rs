//! What may be missing: a mechanism at a place, with what is free in it.

use fit::parameters::Parameter;
use model::mechanism::{
    ChamberLeak, ChamberThermal, CommandDelay, Mechanism, SensorLag, ValveHysteresis, ValveLag,
};
use model::rig::{Attached, Rig};

use crate::place::side;

/// A mechanism at one or more components.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// The mechanism's id.
    pub id: String,
    /// The components it is attached to.
    pub components: Vec<String>,
    /// `positive`, `negative` or `both`.
    pub side: String,
    /// What is put into the rig, at the magnitudes where fits start.
    pub attached: Vec<Attached>,
    /// What is free in it; the prior's mean is where fits start.
    pub free: Vec<Parameter>,
    /// Further starts, in coordinates of [`Candidate::free`].
    pub starts: Vec<Vec<f64>>,
}

impl Candidate {
    /// `id:side`, the name that diagnoses use.
    pub fn name(&self) -> String {
        format!("{}:{}", self.id, self.side)
    }

    /// Whether both cannot be in one rig at a time.
    pub fn excludes(&self, other: &Candidate) -> bool {
        self.id == other.id && self.components.iter().any(|component| other.components.contains(component))
    }
}

/// Everything that may be missing from a rig: mechanisms that it has already are left out.
pub fn candidates(rig: &Rig) -> Vec<Candidate> {
    let mut all = Vec::new();
    let log = |path: &str, mean: f64, low: f64, high: f64| (path.to_owned(), mean, [low, high]);
    let mut add = |component: &str, mechanism: Mechanism, free: Vec<(String, f64, [f64; 2])>| {
        let id = mechanism.id().to_owned();
        let has = rig.mechanisms.iter().any(|m| m.enabled && m.component == component && m.mechanism.id() == id);
        if has {
            return;
        }
        let parameters = free
            .into_iter()
            .map(|(key, mean, [low, high])| {
                Parameter::log(format!("mechanisms.{id}@{component}.{key}"), mean, 1.5).within(low, high)
            })
            .collect::<Vec<_>>();
        all.push(Candidate {
            side: side(rig, &[component.to_owned()]),
            components: vec![component.to_owned()],
            attached: vec![Attached { component: component.to_owned(), enabled: true, mechanism }],
            starts: Vec::new(),
            free: parameters,
            id,
        });
    };
    for valve in rig.valves.keys() {
        add(
            valve,
            Mechanism::ValveHysteresis(ValveHysteresis { half_width_duty: 0.02 }),
            vec![log("half_width_duty", 0.02, 1e-4, 0.3)],
        );
        add(
            valve,
            Mechanism::ValveLag(ValveLag { time_constant_ms: 30.0 }),
            vec![log("time_constant_ms", 30.0, 0.5, 2000.0)],
        );
        add(
            valve,
            Mechanism::CommandDelay(CommandDelay { delay_ms: 20.0 }),
            vec![log("delay_ms", 20.0, 0.5, 160.0)],
        );
    }
    for volume in rig.volumes.keys() {
        add(
            volume,
            Mechanism::ChamberLeak(ChamberLeak { conductance_kg_per_s_pa2: 1e-15 }),
            vec![log("conductance_kg_per_s_pa2", 1e-15, 1e-18, 1e-12)],
        );
        add(
            volume,
            Mechanism::ChamberThermal(ChamberThermal { wall_conductance_w_per_k: 2.0 }),
            vec![log("wall_conductance_w_per_k", 2.0, 0.01, 500.0)],
        );
    }
    for sensor in rig.sensors.keys() {
        add(
            sensor,
            Mechanism::SensorLag(SensorLag { time_constant_ms: 40.0 }),
            vec![log("time_constant_ms", 40.0, 0.5, 5000.0)],
        );
    }
    all
}

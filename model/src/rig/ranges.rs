//! The numbers of every component: units, accepted and plausible ranges, and what one knows beforehand.
//!
//! Priors are what a careful lab knows before identification: geometry by caliper, volumes by data sheet plus
//! hoses, effective areas within a twentieth, check valves and the pump's speed as its plate says.

use super::number::{Number, Numbers, numbers};
use super::schema::{Atmosphere, FlowPump, Gas, Line, PistonPump, Pump, Source, Valve, Volume};

const TEMPERATURE: Number =
    Number::new("K", 150.0, 1000.0).plausible(270.0, 370.0).known_to(0.01).hint("a value in °C?");

numbers!(Gas {
    gas_constant_j_per_kg_k: Number::new("J/(kg K)", 50.0, 5000.0)
        .plausible(286.0, 292.0)
        .known_to(0.002)
        .hint("287 for dry air"),
    heat_capacity_ratio: Number::new("", 1.05, 1.67).plausible(1.38, 1.41).known_to(0.005).hint("1.4 for air"),
});

numbers!(Atmosphere {
    pressure_kpa_abs: Number::new("kPa", 30.0, 120.0)
        .plausible(85.0, 105.0)
        .known_to(0.01)
        .hint("absolute pressure is meant"),
    temperature_k: TEMPERATURE,
});

numbers!(Volume {
    // More than 100 L is a room, not a tank on a bench.
    volume_l: Number::new("L", 1e-4, 100.0).hint("it must be positive; a value in mL?"),
    temperature_k: TEMPERATURE,
    compliance_ml_per_kpa: Number::new("mL/kPa", 0.0, 1e4).hint("leave it out for a rigid volume").optional(),
});

numbers!(PistonPump {
    speed_rpm: Number::new("rev/min", 1.0, 20_000.0).known_to(0.02),
    crank_radius_mm: Number::new("mm", 0.1, 500.0).known_to(0.002),
    // The rod must be longer than the crank, the cylinder than the stroke: checked beside the ranges.
    rod_length_mm: Number::new("mm", 0.1, 5000.0).known_to(0.005),
    effective_length_mm: Number::new("mm", 0.1, 2000.0).known_to(0.002),
    head_area_cm2: Number::new("cm²", 1e-3, 1e4).known_to(0.005),
    gas_temperature_k: TEMPERATURE.known_to(0.03),
    inlet_check_area_mm2: Number::new("mm²", 1e-3, 1e4).known_to(0.1),
    outlet_check_area_mm2: Number::new("mm²", 1e-3, 1e4).known_to(0.1),
});

numbers!(FlowPump {
    flow_l_per_min: Number::new("L/min", 1e-6, 1e5).known_to(0.2),
    dead_zone_duty: Number::new("duty", 0.0, 0.95)
        .known_to(0.2)
        .hint("the command below which nothing flows")
        .optional(),
});

numbers!(Valve {
    input_area_mm2: Number::new("mm²", 1e-3, 1e4),
    pressure_area_mm2_per_n: Number::new("mm²/N", 0.0, 1e4),
    spring_area_mm2: Number::new("mm²", -1e4, 1e4),
    // It enters by its product with `pressure_area_mm2_per_n` alone, so one of the two is as good as given.
    nozzle_diameter_mm: Number::new("mm", 0.01, 100.0).known_to(0.002),
});

impl Numbers for Line {
    fn numbers(&self) -> Vec<Number> {
        vec![match self {
            Line::Orifice { .. } => Number::new("mm²", 0.0, 1e4).known_to(0.1).named("area_mm2"),
            Line::Laminar { .. } => Number::new("kPa s/L", 1e-6, 1e9)
                .known_to(0.2)
                .hint("it must be positive")
                .named("resistance_kpa_s_per_l"),
        }]
    }

    fn number(&self, index: usize) -> f64 {
        match (self, index) {
            (Line::Orifice { area_mm2, .. }, 0) => *area_mm2,
            (Line::Laminar { resistance_kpa_s_per_l, .. }, 0) => *resistance_kpa_s_per_l,
            _ => f64::NAN,
        }
    }

    fn number_mut(&mut self, index: usize) -> Option<&mut f64> {
        match (self, index) {
            (Line::Orifice { area_mm2, .. }, 0) => Some(area_mm2),
            (Line::Laminar { resistance_kpa_s_per_l, .. }, 0) => Some(resistance_kpa_s_per_l),
            _ => None,
        }
    }
}

impl Numbers for Source {
    fn numbers(&self) -> Vec<Number> {
        match self {
            Source::Pressure { .. } => vec![
                Number::new("kPa", -120.0, 5000.0)
                    .known_to(0.02)
                    .hint("gauge pressure is meant")
                    .named("pressure_kpa_gauge"),
                TEMPERATURE.named("temperature_k"),
            ],
            Source::Flow { .. } => vec![
                Number::new("L/min", -1e5, 1e5).known_to(0.05).named("flow_l_per_min"),
                Number::new("L/min", -1e5, 1e5).named("offset_l_per_min").optional(),
            ],
        }
    }

    fn number(&self, index: usize) -> f64 {
        match (self, index) {
            (Source::Pressure { pressure_kpa_gauge, .. }, 0) => *pressure_kpa_gauge,
            (Source::Pressure { temperature_k, .. }, 1) => *temperature_k,
            (Source::Flow { flow_l_per_min, .. }, 0) => *flow_l_per_min,
            (Source::Flow { offset_l_per_min, .. }, 1) => *offset_l_per_min,
            _ => f64::NAN,
        }
    }

    fn number_mut(&mut self, index: usize) -> Option<&mut f64> {
        match (self, index) {
            (Source::Pressure { pressure_kpa_gauge, .. }, 0) => Some(pressure_kpa_gauge),
            (Source::Pressure { temperature_k, .. }, 1) => Some(temperature_k),
            (Source::Flow { flow_l_per_min, .. }, 0) => Some(flow_l_per_min),
            (Source::Flow { offset_l_per_min, .. }, 1) => Some(offset_l_per_min),
            _ => None,
        }
    }
}

impl Numbers for Pump {
    fn numbers(&self) -> Vec<Number> {
        match self {
            Pump::Piston(p) => p.numbers(),
            Pump::Flow(p) => p.numbers(),
        }
    }

    fn number(&self, index: usize) -> f64 {
        match self {
            Pump::Piston(p) => p.number(index),
            Pump::Flow(p) => p.number(index),
        }
    }

    fn number_mut(&mut self, index: usize) -> Option<&mut f64> {
        match self {
            Pump::Piston(p) => p.number_mut(index),
            Pump::Flow(p) => p.number_mut(index),
        }
    }
}

//! The compiled parts of a rig: flat records of node numbers and SI numbers.
//!
//! Node numbers index the pressures: chambers first, then cylinders, then the places whose pressure is
//! given. What differs between rigs of one structure is of type `R` (one number per lane), what makes up
//! the structure is not. Each record knows how to lie side by side with its twins from other rigs.

use crate::real::Real;

/// Gathers one number per lane from records of the same structure; lanes beyond the last repeat it.
pub(crate) fn lanes_of<T, R: Real>(parts: &[T], mut number: impl FnMut(&T) -> f64) -> R {
    R::from_lanes(|lane| parts.get(lane).or(parts.last()).map_or(f64::NAN, &mut number))
}

/// Declares a record with structure (left) and numbers per lane (right), and how to merge it.
macro_rules! record {
    ($(#[$doc:meta])* $name:ident { $($(#[$sd:meta])* $structure:ident: $type:ty,)* } lanes { $($(#[$nd:meta])* $number:ident,)* }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub(crate) struct $name<R> {
            $($(#[$sd])* pub(crate) $structure: $type,)*
            $($(#[$nd])* pub(crate) $number: R,)*
        }

        impl<R: Real> $name<R> {
            /// Merges twins; `None` if their structure differs.
            pub(crate) fn side_by_side(parts: &[$name<f64>]) -> Option<Self> {
                let first = parts.first()?;
                $(if parts.iter().any(|p| p.$structure != first.$structure) { return None; })*
                Some($name {
                    $($structure: first.$structure,)*
                    $($number: lanes_of(parts, |p| p.$number),)*
                })
            }
        }
    };
}

record! {
    /// A one-way orifice of fixed effective area: check valves, and each direction of a line.
    Passage { up: usize, down: usize, law: usize, } lanes {
        /// Effective area in m².
        area,
    }
}

record! {
    /// A commanded nozzle-flapper valve, paper eqs. (4)-(5).
    Vent { up: usize, down: usize, law: usize,
        /// Which command path drives it.
        command: usize,
    } lanes {
        /// Ĉ_u in m² per duty.
        input_area,
        /// Ĉ_P · πD²/4 in m²/Pa.
        pressure_area,
        /// Ĉ_k in m².
        spring_area,
    }
}

record! {
    /// A laminar path, ṁ = k (P₁² − P₂²), in both directions.
    Capillary { up: usize, down: usize, } lanes {
        /// k in kg/(s Pa²).
        conductance,
    }
}

record! {
    /// A pump that displaces a given volume flow of inlet gas.
    Displacement { up: usize, down: usize,
        /// Input that scales it, if any.
        command: Option<usize>,
    } lanes {
        /// Volume flow in m³/s at full command.
        flow,
        /// R T of the gas at the inlet, in J/kg.
        rt,
    }
}

record! {
    /// A mass flow forced into a node.
    Feed { down: usize,
        /// Input that scales it, if any.
        command: Option<usize>,
    } lanes {
        /// Mass flow in kg/s.
        flow,
        /// Temperature of what comes in, in K.
        temperature,
    }
}

record! {
    /// A place whose pressure is given.
    Given { node: usize,
        /// Input that scales the gauge part, if any.
        command: Option<usize>,
    } lanes {
        /// Pressure of the atmosphere in Pa.
        atmosphere,
        /// Gauge pressure in Pa.
        gauge,
    }
}

record! {
    /// A rigid isothermal chamber, paper eqs. (6)-(7): Ṗ = (R T/V) Σṁ.
    Isothermal { node: usize, } lanes {
        /// R T / V in Pa/kg.
        pressure_per_mass,
    }
}

record! {
    /// A compliant isothermal chamber: Ṗ = R T Σṁ / (V(P) + P V').
    Compliant { node: usize, } lanes {
        /// R T in J/kg.
        rt,
        /// Volume extrapolated to zero absolute pressure, in m³.
        volume_at_vacuum,
        /// V' = dV/dP in m³/Pa.
        compliance,
    }
}

record! {
    /// A chamber with an energy balance (mechanism `chamber_thermal`).
    Thermal { node: usize,
        /// State that holds its temperature.
        temperature: usize,
    } lanes {
        /// Volume extrapolated to zero absolute pressure, in m³.
        volume_at_vacuum,
        /// V' = dV/dP in m³/Pa.
        compliance,
        /// G in W/K.
        wall_conductance,
        /// Wall temperature in K.
        wall_temperature,
    }
}

record! {
    /// A cylinder of a piston pump: the node with a moving wall.
    Cylinder { node: usize,
        /// Which drive turns it.
        drive: usize,
    } lanes {
        /// Crank phase in revolutions.
        phase,
    }
}

record! {
    /// The shaft and the geometry of a piston pump, paper eq. (2).
    Drive {
        /// Input that switches it, if any.
        relay: Option<usize>,
    } lanes {
        /// Speed in rev/s when on.
        speed,
        /// r in m.
        crank_radius,
        /// l in m.
        rod_length,
        /// δ in m.
        effective_length,
        /// S in m².
        head_area,
        /// R T in the cylinders, in J/kg.
        rt,
    }
}

record! {
    /// A sensor on a chamber.
    SensorPath { node: usize,
        /// Where in the memory its lagged reading lives, if it lags.
        memory: Option<usize>,
    } lanes {
        /// Share of the distance to the pressure covered in one step (0 … 1).
        approach,
    }
}

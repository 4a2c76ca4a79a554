//! The compiled parts of a rig: flat records of node numbers and SI numbers.
//!
//! Node numbers index the pressures: chambers first, then cylinders, then the places whose pressure is
//! given. What differs between rigs of one structure is of type `R` (one number per lane), what makes up
//! the structure is not. Each record knows how to lie side by side with its twins from other rigs.

use std::sync::Arc;

use crate::averaged::PumpTable;
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
                let _ = first;
                $(if parts.iter().any(|p| p.$structure != first.$structure) { return None; })*
                Some($name {
                    $($structure: first.$structure,)*
                    $($number: lanes_of(parts, |p| p.$number),)*
                })
            }
        }
    };
}

pub(crate) use record;

record! {
    /// A one-way orifice of fixed effective area: check valves, and each direction of a line.
    Passage { up: usize, down: usize, law: usize, } lanes {
        /// Effective area in m².
        area,
    }
}

record! {
    /// A commanded nozzle-flapper valve, paper eqs. (4)-(5). Where `down` has the higher pressure gas passes the other way, through
    /// the area that the forces leave.
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
    /// A one-way orifice that opens against a spring (mechanism `check_valve_cracking`).
    SpringCheck { up: usize, down: usize, law: usize, } lanes {
        /// Effective area in m².
        area,
        /// Cracking pressure in Pa.
        cracking,
        /// Pressure that the spring takes from the difference which drives the flow, in Pa.
        taken,
        /// One over the difference beyond the cracking pressure over which it opens, in 1/Pa.
        inverse_opening,
    }
}

record! {
    /// A commanded valve with forces that are no straight lines, or something in series with it.
    ShapedVent { up: usize, down: usize, law: usize,
        /// Which command path drives it.
        command: usize,
        /// True where anything is in series with it.
        restricted: bool,
        /// Which tabled area comes on top of its own, if any.
        residual: Option<usize>,
        /// Where in the memory it stands what dry friction holds the flapper at (in duty), if any.
        held: Option<usize>,
    } lanes {
        /// Ĉ_u in m² per duty.
        input_area,
        /// Ĉ_P · πD²/4 in m²/Pa.
        pressure_area,
        /// c · (πD²/4)² in m²/Pa².
        pressure_curvature,
        /// Ĉ_k in m².
        spring_area,
        /// 1/a_full in 1/m².
        inverse_full_area,
        /// 1/A² of what is in series upstream, in 1/m⁴; 0 is nothing.
        upstream_drop,
        /// 1/A² of what is in series downstream.
        downstream_drop,
        /// Dry friction of the flapper: the band, and by how much a jump ends short, in duty.
        band,
        short,
    }
}

impl ShapedVent<f64> {
    /// A valve without any of it.
    pub(crate) fn from_plain(vent: &Vent<f64>) -> Self {
        ShapedVent {
            up: vent.up,
            down: vent.down,
            law: vent.law,
            command: vent.command,
            restricted: false,
            residual: None,
            held: None,
            input_area: vent.input_area,
            pressure_area: vent.pressure_area,
            pressure_curvature: 0.0,
            spring_area: vent.spring_area,
            inverse_full_area: 0.0,
            upstream_drop: 0.0,
            downstream_drop: 0.0,
            band: 0.0,
            short: 0.0,
        }
    }
}

record! {
    /// A laminar path with a part that grows with the square of the flow: P₁² − P₂² = ṁ/k + R T (ṁ/A)².
    Parabolic { up: usize, down: usize, } lanes {
        /// 1/k in Pa² s/kg.
        linear,
        /// R T/A² in Pa² s²/kg².
        quadratic,
    }
}

record! {
    /// A muscle with a weight between two chambers (mechanism `actuator_load`).
    Muscle {
        /// The chamber that gains volume when it contracts.
        gains: usize,
        /// The chamber that loses it.
        loses: usize,
        /// State that holds its contraction.
        contraction: usize,
    } lanes {
        /// A in m².
        area,
        /// m g in N.
        weight,
        /// 1/k in m/N.
        inverse_stiffness,
        /// Longest contraction in m.
        stroke,
        /// 1/τ in 1/s.
        inverse_time,
    }
}

impl<R: Real> Muscle<R> {
    /// The contraction in m at which the weight hangs still.
    #[inline(always)]
    pub(crate) fn at_rest(&self, gains_pa: R, loses_pa: R) -> R {
        let pull = self.area * (gains_pa - loses_pa) - self.weight;
        (pull * self.inverse_stiffness).limited(R::splat(0.0), self.stroke)
    }
}

record! {
    /// A volume that a chamber gains (or loses) at some time (mechanism `volume_change`).
    Joined { node: usize,
        /// State that holds how much of it there is by now, in m³.
        volume: usize,
    } lanes {
        /// All of it, in m³.
        whole,
        /// When it begins to, in s after the start.
        begins_s,
        /// Gas that comes with it, in kg/m³, and its temperature in K.
        brings,
        temperature,
    }
}

/// Time that a volume takes to join, in s: a cock that is turned, a hose that is plugged in.
const JOINING_S: f64 = 0.5;

impl<R: Real> Joined<R> {
    /// Part of it that is there `time_s` after the start, in m³: from none to all as 3 s² − 2 s³ of the time it takes, so that
    /// a fit sees a smooth function of when it begins.
    #[inline(always)]
    pub(crate) fn volume_at(&self, time_s: f64) -> R {
        let gone = (R::splat(time_s) - self.begins_s) * R::splat(1.0 / JOINING_S);
        let share = gone.limited(R::splat(0.0), R::splat(1.0));
        self.whole * share * share * (R::splat(3.0) - share - share)
    }
}

/// A piston pump as a table (see [`crate::averaged`]).
#[derive(Debug, Clone)]
pub(crate) struct AveragedPump<R> {
    pub(crate) inlet: usize,
    pub(crate) outlet: usize,
    /// State that holds the gas in its cylinders, in kg.
    pub(crate) content: usize,
    /// The drive whose relay, speed and phase it has.
    pub(crate) drive: usize,
    /// Where in the memory it stands whether it ran in the last tick.
    pub(crate) memory: usize,
    /// Revolutions of the shaft over which its ripple repeats itself: one over the number of evenly spaced pistons.
    pub(crate) beat: f64,
    /// Temperature of what it delivers, in K.
    pub(crate) temperature: R,
    pub(crate) table: Arc<PumpTable<R>>,
    /// Table at the speed that it has once warm.
    pub(crate) warm: Option<Arc<PumpTable<R>>>,
}

impl<R: Real> AveragedPump<R> {
    /// Merges twins; `None` if their structure differs.
    pub(crate) fn side_by_side(parts: &[AveragedPump<f64>]) -> Option<Self> {
        let first = parts.first()?;
        let structure = |p: &AveragedPump<f64>| (p.inlet, p.outlet, p.content, p.drive, p.memory, p.warm.is_some());
        if parts.iter().any(|p| structure(p) != structure(first)) {
            return None;
        }
        let merged = |tables: Vec<&PumpTable<f64>>| Some(Arc::new(PumpTable::side_by_side(&tables)?));
        // All are warm or none is, by their structure.
        let warm: Vec<&PumpTable<f64>> = parts.iter().filter_map(|p| p.warm.as_deref()).collect();
        Some(AveragedPump {
            inlet: first.inlet,
            outlet: first.outlet,
            content: first.content,
            drive: first.drive,
            memory: first.memory,
            beat: first.beat,
            temperature: lanes_of(parts, |p| p.temperature),
            table: merged(parts.iter().map(|p| p.table.as_ref()).collect())?,
            warm: if warm.is_empty() { None } else { Some(merged(warm)?) },
        })
    }

    /// Flow at the inlet and at the outlet in kg/s (each at least zero), and what the cylinders gain.
    ///
    /// `running` is 1 or 0. A pump that stands evens out with its ports through its check valves. `warmth` is how far its speed
    /// has come from the one at the start of a run to the one in the end; between them flows are as good as straight.
    #[inline(always)]
    pub(crate) fn flows(&self, inlet: R, outlet: R, content: R, running: R, warmth: R) -> [R; 3] {
        let zero = R::splat(0.0);
        let table = &self.table;
        let mut mean = table.at(inlet, outlet);
        if let Some(warm) = &self.warm {
            mean = mean.towards(&warm.at(inlet, outlet), warmth);
        }
        let excess = content - mean.content;
        let turning = [
            mean.drawn_response.mul_add(excess, mean.drawn).at_least(zero),
            mean.delivered_response.mul_add(excess, mean.delivered).at_least(zero),
        ];
        // What neither port accounts for has gone past the rings.
        let lost =
            (mean.drawn - mean.delivered) + (mean.relaxation + mean.drawn_response - mean.delivered_response) * excess;
        let standing = [
            (inlet * table.content_per_pa - content).at_least(zero) * table.standing[0],
            (content - outlet * table.content_per_pa).at_least(zero) * table.standing[1],
        ];
        let stopped = R::splat(1.0) - running;
        let drawn = running * turning[0] + stopped * standing[0];
        let delivered = running * turning[1] + stopped * standing[1];
        [drawn, delivered, drawn - delivered - running * lost]
    }
}

record! {
    /// The supply that all valves share (mechanism `supply_sag`).
    Sag { } lanes {
        /// Share of the voltage lost per unit of total duty.
        loss,
    }
}

impl<R: Real> Sag<R> {
    /// Share of the voltage that is left under a total duty.
    #[inline(always)]
    pub(crate) fn left(&self, total: R) -> R {
        R::splat(1.0) - self.loss * total
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
        /// Command path that its command takes, if it takes one.
        path: Option<usize>,
    } lanes {
        /// Volume flow in m³/s at full command.
        flow,
        /// Command up to which nothing flows.
        dead_zone,
        /// One over what is left of the command's range.
        inverse_range,
        /// Share of the flow lost per Pa between outlet and inlet (mechanism `pump_droop`).
        droop,
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
        /// Mass flow in kg/s that comes on top, whatever the input.
        offset,
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
        /// Node that it draws from.
        inlet: usize,
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
        /// Inlet and outlet, where the speed falls with their difference (mechanism `pump_droop`).
        droops: Option<(usize, usize)>,
        /// True where the speed changes from the start of a run on (mechanism `pump_speed`).
        warms: bool,
    } lanes {
        /// Speed in rev/s when on, without load, at the start of a run.
        speed,
        /// Share of it that is added once warm, and the rate in 1/s with which it comes.
        warm_share,
        approach_rate,
        /// Share of the speed lost per Pa between outlet and inlet.
        droop,
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

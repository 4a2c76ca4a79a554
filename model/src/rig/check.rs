//! Checks that a rig makes sense: numbers within the range of their unit, joins that lead somewhere.

use super::error::RigError;
use super::number::Numbers as _;
use super::schema::{ATMOSPHERE, Line, MechanismInstance, Pump, Rig, Source};

/// Checks one number against a range.
///
/// `hint` says what a value outside the range usually means.
pub(crate) fn within(key: &str, value: f64, low: f64, high: f64, unit: &str, hint: &str) -> Result<(), RigError> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
    let hint = if hint.is_empty() { String::new() } else { format!("; {hint}") };
    Err(RigError::at(key, format!("{value}{unit} is outside {low} … {high}{unit}{hint}")))
}

impl Rig {
    /// Checks every number and join of the rig.
    ///
    /// # Errors
    /// The first thing that is wrong, by its dotted key.
    pub fn check(&self) -> Result<(), RigError> {
        if self.format != 1 {
            return Err(RigError::at("format", format!("{} is not known; this program reads format = 1", self.format)));
        }
        self.gas.check_numbers("gas")?;
        self.atmosphere.check_numbers("atmosphere")?;
        let i = &self.integrator;
        within("integrator.step_ms", i.step_ms, 0.001, 1.0, "ms", "0.1 is the paper's")?;
        within("integrator.tick_ms", i.tick_ms, 1.0, 1000.0, "ms", "20 is 50 Hz")?;
        let steps = i.tick_ms / i.step_ms;
        if (steps - steps.round()).abs() > 1e-6 {
            return Err(RigError::at(
                "integrator.step_ms",
                format!("a tick of {} ms is not a whole number of steps of {} ms", i.tick_ms, i.step_ms),
            ));
        }
        self.check_volumes()?;
        self.check_pumps()?;
        self.check_paths()?;
        self.check_sensors()?;
        if let Some(map) = &self.recording {
            map.check(self)?;
        }
        for (n, attached) in self.mechanisms.iter().enumerate() {
            let key = format!("mechanisms.{}", n + 1);
            attached.mechanism.check(self, &attached.component, &key)?;
            let twin = |other: &&MechanismInstance| other.enabled && other.is_twin_of(attached);
            if attached.enabled && self.mechanisms.iter().take(n).any(|other| twin(&other)) {
                return Err(RigError::at(
                    key,
                    format!("`{}` acts on `{}` already; keep one", attached.mechanism.id(), attached.component),
                ));
            }
        }
        Ok(())
    }

    fn check_volumes(&self) -> Result<(), RigError> {
        if self.volumes.is_empty() {
            return Err(RigError::at("volumes", "the rig has no volume; add a table [volumes.NAME]"));
        }
        for (name, v) in &self.volumes {
            if name == ATMOSPHERE {
                return Err(RigError::at(
                    "volumes.atmosphere",
                    "`atmosphere` names the open air; call the volume something else",
                ));
            }
            v.check_numbers(&format!("volumes.{name}"))?;
        }
        Ok(())
    }

    fn check_pumps(&self) -> Result<(), RigError> {
        for (name, pump) in &self.pumps {
            let key = |k: &str| format!("pumps.{name}.{k}");
            let (inlet, outlet) = match pump {
                Pump::Piston(p) => (&p.inlet, &p.outlet),
                Pump::Flow(p) => (&p.inlet, &p.outlet),
            };
            self.joins(&key("inlet"), inlet)?;
            self.joins(&key("outlet"), outlet)?;
            differ(&format!("pumps.{name}"), inlet, outlet)?;
            pump.check_numbers(&format!("pumps.{name}"))?;
            if let Pump::Piston(p) = pump {
                if p.phases_deg.is_empty() || p.phases_deg.len() > 6 {
                    return Err(RigError::at(
                        key("phases_deg"),
                        format!("{} pistons; one phase for each of 1 … 6 pistons", p.phases_deg.len()),
                    ));
                }
                for phase in &p.phases_deg {
                    within(&key("phases_deg"), *phase, -360.0, 360.0, "°", "")?;
                }
                within(
                    &key("rod_length_mm"),
                    p.rod_length_mm,
                    1.01 * p.crank_radius_mm,
                    5000.0,
                    "mm",
                    "the rod must be longer than the crank",
                )?;
                // Less would let the piston hit the head: no volume left at top dead centre.
                within(
                    &key("effective_length_mm"),
                    p.effective_length_mm,
                    2.0 * p.crank_radius_mm * 1.0001,
                    2000.0,
                    "mm",
                    "it must exceed the stroke, twice the crank radius",
                )?;
            }
        }
        Ok(())
    }

    fn check_paths(&self) -> Result<(), RigError> {
        for (name, v) in &self.valves {
            let key = |k: &str| format!("valves.{name}.{k}");
            self.joins(&key("from"), &v.from)?;
            self.joins(&key("to"), &v.to)?;
            differ(&format!("valves.{name}"), &v.from, &v.to)?;
            v.check_numbers(&format!("valves.{name}"))?;
        }
        for (name, line) in &self.lines {
            let key = |k: &str| format!("lines.{name}.{k}");
            let (Line::Orifice { from, to, .. } | Line::Laminar { from, to, .. }) = line;
            self.joins(&key("from"), from)?;
            self.joins(&key("to"), to)?;
            differ(&format!("lines.{name}"), from, to)?;
            line.check_numbers(&format!("lines.{name}"))?;
        }
        for (name, source) in &self.sources {
            let key = |k: &str| format!("sources.{name}.{k}");
            match source {
                Source::Pressure { pressure_kpa_gauge, .. } => within(
                    &key("pressure_kpa_gauge"),
                    *pressure_kpa_gauge,
                    -self.atmosphere.pressure_kpa_abs,
                    5000.0,
                    "kPa",
                    "gauge pressure is meant",
                )?,
                Source::Flow { to, .. } => self.joins(&key("to"), to)?,
            }
            source.check_numbers(&format!("sources.{name}"))?;
            if self.volumes.contains_key(name) || name == ATMOSPHERE {
                return Err(RigError::at(
                    format!("sources.{name}"),
                    "a volume has this name already; joins could not tell them apart",
                ));
            }
        }
        Ok(())
    }

    fn check_sensors(&self) -> Result<(), RigError> {
        if self.sensors.is_empty() {
            return Err(RigError::at("sensors", "the rig has no sensor; add a table [sensors.NAME]"));
        }
        for (n, (name, s)) in self.sensors.iter().enumerate() {
            let key = |k: &str| format!("sensors.{name}.{k}");
            if !self.volumes.contains_key(&s.volume) {
                return Err(RigError::at(
                    key("volume"),
                    format!("there is no volume `{}`; there are {}", s.volume, names(self.volumes.keys())),
                ));
            }
            for (k, range, low, high, unit) in
                [("range_kpa_gauge", s.range_kpa_gauge, -102.0, 1e5, "kPa"), ("range_v", s.range_v, -10.0, 10.0, "V")]
            {
                within(&key(k), range[0], low, high, unit, "")?;
                within(&key(k), range[1], low, high, unit, "")?;
                if range[0] == range[1] {
                    return Err(RigError::at(
                        key(k),
                        format!("both ends are {} {unit}; give the two ends of the range", range[0]),
                    ));
                }
            }
            if let Some((other, _)) = self.sensors.iter().take(n).find(|(_, o)| o.column == s.column) {
                return Err(RigError::at(
                    key("column"),
                    format!("sensor `{other}` writes column `{}` already; give each its own", s.column),
                ));
            }
        }
        Ok(())
    }

    /// Checks that `place` is a volume, a pressure source or the atmosphere.
    fn joins(&self, key: &str, place: &str) -> Result<(), RigError> {
        let source = self.sources.get(place).is_some_and(|s| matches!(s, Source::Pressure { .. }));
        if place == ATMOSPHERE || source || self.volumes.contains_key(place) {
            return Ok(());
        }
        let sources = self.sources.iter().filter(|(_, s)| matches!(s, Source::Pressure { .. })).map(|(name, _)| name);
        Err(RigError::at(
            key,
            format!("`{place}` joins nothing; there are {}, `atmosphere`", names(self.volumes.keys().chain(sources))),
        ))
    }
}

/// Checks that the two ends of a component are different places.
fn differ(key: &str, one: &str, other: &str) -> Result<(), RigError> {
    if one == other {
        return Err(RigError::at(key, format!("both ends are joined to `{one}`; nothing could flow")));
    }
    Ok(())
}

/// Lists names for an error message.
pub(crate) fn names<'a>(names: impl Iterator<Item = &'a String>) -> String {
    names.map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ")
}

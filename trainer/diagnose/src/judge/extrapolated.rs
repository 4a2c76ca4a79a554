//! Levels that no recording came to.
//!
//! A dead zone is told by commands below and above it. Where all commands were above, what shows is that the flow is no straight
//! line through zero: a line that begins later fits that, and so does a flow that bends with its command. The level is then where the
//! line would end, which is an extrapolation, and it is told as one. So it is with every number of a mechanism at which something begins
//! or ends:
//!
//! ```text
//! dead zone                the command at which a flow begins                  to be reached from above
//! critical ratio           the pressure ratio at which an orifice chokes       to be reached from above
//! full opening             the area at which a valve is as open as it gets     to be reached from below
//! play, static friction    the way of a command until the flapper follows      to be reached from below
//! ```
//!
//! (A cracking pressure is a difference that every stroke goes through, and no level of a pressure that is recorded.)

use fit::data::{Record, Records};
use model::mechanism::{Mechanism, Rubs};
use model::rig::{ATMOSPHERE, Line, MechanismInstance, Pump, Rig};

use crate::bench::{Bench, Explanation};
use crate::report::wording::three;
use crate::search::candidate::Candidate;
use crate::search::values_of;

/// Rows that must lie at a level or behind it for it to show: half a second.
const ROWS: usize = 25;

/// Quantity that a level is a value of.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Measure {
    /// A command above nothing, in which a flow begins.
    Command,
    /// Ratio of the absolute pressures behind and before an orifice.
    PressureRatio,
    /// Area in mm² that the forces on a valve's flapper open.
    Opening,
    /// Way of a command from its lowest to its highest within a run.
    Travel,
}

impl Measure {
    /// Tells whether what is recorded must come down to the level.
    fn is_reached_from_above(self) -> bool {
        matches!(self, Measure::Command | Measure::PressureRatio)
    }

    /// Numbers that must have reached the level: of rows, or of runs.
    fn least(self) -> usize {
        match self {
            Measure::Travel => 1,
            Measure::Command | Measure::PressureRatio | Measure::Opening => ROWS,
        }
    }
}

/// A level of a mechanism with what was recorded of the same measure.
#[derive(Debug, Clone, PartialEq)]
struct Level {
    /// Key of the number that it is.
    key: &'static str,
    measure: Measure,
    /// Column of the command, or the component, whose measure it is.
    of: String,
    /// The level that fits.
    at: f64,
    recorded: Vec<f64>,
}

impl Level {
    /// The recorded number that came nearest to the level, where too few reached it.
    fn nearest_short_of_it(&self) -> Option<f64> {
        let from_above = self.measure.is_reached_from_above();
        let is_reached = |x: &&f64| if from_above { **x <= self.at } else { **x >= self.at };
        if self.recorded.iter().filter(is_reached).count() >= self.measure.least() {
            return None;
        }
        let nearest = |a: &f64, b: &f64| if from_above { a.min(*b) } else { a.max(*b) };
        self.recorded.iter().copied().reduce(|a, b| nearest(&a, &b))
    }
}

/// A level of a named term that no recording came to.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Extrapolated {
    /// The term.
    term: usize,
    /// Key of the number.
    key: &'static str,
    measure: Measure,
    /// Column of the command, or the component.
    of: String,
    /// The level that fits.
    level: f64,
    /// Recorded number nearest to it.
    nearest: f64,
}

impl Extrapolated {
    /// Tells whether it is the number with this key of a term.
    pub(crate) fn is_of(&self, term: usize, key: &str) -> bool {
        self.term == term && self.key == key
    }

    /// A few words behind the number itself.
    pub(crate) fn in_brief(&self) -> &'static str {
        if self.measure.is_reached_from_above() { "below what was recorded" } else { "beyond what was recorded" }
    }

    /// The finding in words, with what to record.
    pub(crate) fn in_words(&self) -> String {
        let Extrapolated { of, level, nearest, .. } = self;
        let (at, nearest) = (three(*level), three(*nearest));
        let half_a_second = ROWS as f64 * proto::recording::PERIOD_S;
        let (why, wanted) = match self.measure {
            Measure::Command => (
                format!(
                    "`{of}` was never between 0 and it for {half_a_second} s in all (the least was {nearest}), and a flow that bends with its \
                     command would look the same"
                ),
                format!("`{of}` between {} and {}", three(0.5 * level), three(1.5 * level)),
            ),
            Measure::PressureRatio => (
                format!(
                    "the pressure behind `{of}` was never so small a share of that before it for {half_a_second} s in all (the least was \
                     {nearest}), and a flow that bends otherwise towards equal pressures would look the same"
                ),
                format!("a share between {} and {}", three(0.7 * level), three((1.3 * level).min(0.5 + 0.5 * level))),
            ),
            Measure::Opening => (
                format!(
                    "`{of}` was never pushed as far open as {at} mm² for {half_a_second} s in all ({nearest} mm² at most), and a line in series \
                     would look the same"
                ),
                format!("`{of}` wide open"),
            ),
            Measure::Travel => (
                format!(
                    "`{of}` never went as far as {at} within a run ({nearest} at most), so the valve never followed it all the way, and one \
                     that hardly moves for another reason would look the same"
                ),
                format!("`{of}` going up and down by more than {}", three(1.5 * level)),
            ),
        };
        let level = match self.measure {
            Measure::Command | Measure::PressureRatio => format!("The level {at}"),
            Measure::Opening | Measure::Travel => format!("`{}`", self.key),
        };
        format!(
            "{level} is an extrapolation: {why}. Record with {wanted} as well, and ask again with that recording beside the others."
        )
    }
}

/// Levels among the numbers of `named` terms of `best` that no recording came to.
pub(crate) fn extrapolated(
    bench: &Bench<'_>,
    candidates: &[Candidate],
    best: &Explanation,
    named: &[usize],
) -> Vec<Extrapolated> {
    let of = |term: &usize| {
        let candidate = candidates.get(*term)?;
        let attached = candidate.attached(&values_of(bench, candidates, best, *term)?);
        let level = level(&best.fitted.rig, bench.records, &attached)?;
        let nearest = level.nearest_short_of_it().filter(|_| candidate.keys().any(|key| key == level.key))?;
        let Level { key, measure, of, at, .. } = level;
        Some(Extrapolated { term: *term, key, measure, of, level: at, nearest })
    };
    named.iter().filter_map(of).collect()
}

/// The level of a mechanism with what was recorded of it; `None` for a mechanism without one, and where no sensor or command shows it.
fn level(rig: &Rig, records: &Records, attached: &MechanismInstance) -> Option<Level> {
    let component = attached.component.as_str();
    let level = |key, measure, of: &str, at, recorded| Some(Level { key, measure, of: of.to_owned(), at, recorded });
    match &attached.mechanism {
        Mechanism::DeadZone(m) => {
            let command = command_of(rig, component)?;
            let driven = duties(records, command).filter(|duty| *duty > 0.0).collect();
            level("closed_duty", Measure::Command, command, m.closed_duty, driven)
        }
        Mechanism::CriticalRatio(m) => {
            let ratios = ratios(rig, records, component)?;
            level("ratio", Measure::PressureRatio, component, m.ratio, ratios)
        }
        Mechanism::ValveForceCurve(m) if m.inverse_full_area_per_mm2 > 0.0 => {
            let openings = openings(rig, records, component, [m.duty_curvature, m.pressure_curvature_mm2_per_n2])?;
            let at = 1.0 / m.inverse_full_area_per_mm2;
            level("inverse_full_area_per_mm2", Measure::Opening, component, at, openings)
        }
        Mechanism::ValveHysteresis(m) => {
            let command = command_of(rig, component)?;
            level("half_width_duty", Measure::Travel, command, 2.0 * m.half_width_duty, travels(records, command))
        }
        // A flapper that rubs is moved by the pressure too.
        Mechanism::ValveStiction(m) if m.rubs == Rubs::Plunger => {
            let command = command_of(rig, component)?;
            level("band_duty", Measure::Travel, command, m.band_duty, travels(records, command))
        }
        _ => None,
    }
}

/// Column of the command of a valve or a pump.
fn command_of<'r>(rig: &'r Rig, component: &str) -> Option<&'r str> {
    if let Some(valve) = rig.valves.get(component) {
        return Some(&valve.command);
    }
    match rig.pumps.get(component)? {
        Pump::Flow(pump) => pump.command.as_deref(),
        Pump::Piston(_) => None,
    }
}

/// All commands of a column.
fn duties<'r>(records: &'r Records, command: &'r str) -> impl Iterator<Item = f64> + 'r {
    (0..records.records().len()).filter_map(move |record| records.input(record, command)).flatten().copied()
}

/// Way of a command within each run.
fn travels(records: &Records, command: &str) -> Vec<f64> {
    let of = |(record, r): (usize, &Record)| {
        let input = records.input(record, command).unwrap_or_default();
        let way = |rows: &std::ops::Range<usize>| {
            let [low, high] = input
                .get(rows.clone())?
                .iter()
                .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| [low.min(*x), high.max(*x)]);
            (high >= low).then_some(high - low)
        };
        r.segments.iter().filter_map(way).collect::<Vec<f64>>()
    };
    records.records().iter().enumerate().flat_map(of).collect()
}

/// Absolute pressures in kPa before and behind a component, and the row of a recording, wherever both were read.
fn pressures<'r>(
    rig: &'r Rig,
    records: &'r Records,
    [from, to]: [&str; 2],
) -> Option<impl Iterator<Item = (usize, usize, [f64; 2])> + 'r> {
    let atmosphere_kpa = rig.atmosphere.pressure_kpa_abs;
    // The channel of a volume with a sensor, none for the open air.
    let channel = |place: &str| {
        if place == ATMOSPHERE {
            return Some(None);
        }
        let column = &rig.sensors.values().find(|sensor| sensor.volume == place)?.column;
        records.sensors().iter().position(|sensor| sensor == column).map(Some)
    };
    let ends = [channel(from)?, channel(to)?];
    let of_record = move |(record, r): (usize, &'r Record)| {
        let rows = 0..r.time_s.len();
        rows.filter_map(move |row| {
            let read = |end: Option<usize>| match end {
                None => Some(atmosphere_kpa),
                Some(channel) if r.is_read(channel, row) => {
                    records.channel_kpa(record, channel).get(row).map(|kpa| kpa + atmosphere_kpa)
                }
                Some(_) => None,
            };
            Some((record, row, [read(ends[0])?, read(ends[1])?]))
        })
    };
    Some(records.records().iter().enumerate().flat_map(of_record))
}

/// Ratios of the pressure behind an orifice to that before it.
fn ratios(rig: &Rig, records: &Records, component: &str) -> Option<Vec<f64>> {
    let ends = match (rig.valves.get(component), rig.lines.get(component)) {
        (Some(valve), _) => [valve.from.as_str(), valve.to.as_str()],
        (None, Some(Line::Orifice { from, to, .. })) => [from.as_str(), to.as_str()],
        _ => return None,
    };
    let ratio = |[one, other]: [f64; 2]| one.min(other) / one.max(other);
    Some(pressures(rig, records, ends)?.map(|(_, _, both)| ratio(both)).collect())
}

/// Areas in mm² that the forces on a valve's flapper open, before anything limits them: (4) of the paper with its curvatures over the
/// duty and the force of the pressure.
fn openings(rig: &Rig, records: &Records, component: &str, [of_duty, of_pressure]: [f64; 2]) -> Option<Vec<f64>> {
    let valve = rig.valves.get(component)?;
    let nozzle_mm2 = 0.25 * std::f64::consts::PI * valve.nozzle_diameter_mm.powi(2);
    let area = |duty: f64, [before, behind]: [f64; 2]| {
        // mm² kPa are mN.
        let force_n = 1e-3 * nozzle_mm2 * (before - behind);
        valve.input_area_mm2 * (duty + of_duty * duty * (duty - 1.0))
            + valve.pressure_area_mm2_per_n * force_n
            + of_pressure * force_n * force_n
            - valve.spring_area_mm2
    };
    let rows = pressures(rig, records, [&valve.from, &valve.to])?;
    let duty = |record: usize, row: usize| records.input(record, &valve.command)?.get(row).copied();
    Some(rows.filter_map(|(record, row, both)| Some(area(duty(record, row)?, both))).collect())
}

#[cfg(test)]
mod tests {
    use fit::data::Records;
    use fit::simulate::Fidelity;

    use super::*;
    use crate::bench::Effort;
    use crate::made::two_chambers::{holds, recorded, rig};
    use crate::search::candidate::candidates;

    /// Words on a dead zone at a level, where the pump was driven between two others.
    fn said(level: f64, driven: [f64; 2]) -> Vec<String> {
        let rig = rig();
        let all = candidates(&rig);
        let at = all.iter().position(|candidate| candidate.id == "dead_zone").unwrap();
        let mut truth = rig.clone();
        truth.mechanisms.push(all[at].attached(&[level]));
        let records = Records::new(&rig, &[recorded(&truth, "run.csv", &holds(1500, driven, 5), 5)]).unwrap();
        let bench = Bench::new(&rig, &records, &vec![1.0; records.layout().len()], Fidelity::Averaged);
        let mut start = vec![0.0; bench.nominal.len()];
        start.extend(all[at].parameters(0).iter().map(|parameter| parameter.coordinate(level)));
        let best = bench.fit(&all, &[at], &[start], Effort::Polish).unwrap();
        extrapolated(&bench, &all, &best, &[at]).iter().map(Extrapolated::in_words).collect()
    }

    /// Ten seconds of the paper's rig: duties of 0.7 to 0.9, 60 to 90 kPa in the positive chamber.
    fn paper() -> (Rig, Records) {
        let rig = Rig::builtin("dual_pressure").unwrap();
        let row = |k: usize| {
            let wave = (k as f64 * 0.05).sin();
            format!("{:.2},{:.4},0.5,{:.4},-60.0\n", 0.02 * k as f64, 0.8 + 0.1 * wave, 75.0 - 15.0 * wave)
        };
        let text = "time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa\n".to_owned() + &(0..500).map(row).collect::<String>();
        let recording = proto::recording::Recording::parse_for("run.csv", text.as_bytes(), &rig).unwrap();
        let records = Records::new(&rig, &[recording]).unwrap();
        (rig, records)
    }

    #[test]
    fn every_level_that_nothing_recorded_came_to_is_told() {
        let (rig, records) = paper();
        let valve = &rig.valves["valve_pos"];
        assert_eq!((valve.command.as_str(), valve.from.as_str()), ("u_pos", "positive"));
        // Forces of the pressure by the nozzle's area in m². Never as open as at the highest duty and pressure together, and every other
        // row more than at 0.8 and 75 kPa.
        let open_mm2 = |duty: f64, pa: f64| {
            let force_n = pa * 0.25 * std::f64::consts::PI * (1e-3 * valve.nozzle_diameter_mm).powi(2);
            valve.input_area_mm2 * duty + valve.pressure_area_mm2_per_n * force_n - valve.spring_area_mm2
        };
        let all = candidates(&rig);
        // The pressure behind is 101 of 191 kPa at the least, and the duty goes over 0.2.
        for (id, key, unreached, reached) in [
            ("critical_ratio", "ratio", 0.5, 0.55),
            ("valve_force_curve", "inverse_full_area_per_mm2", 1.0 / open_mm2(0.9, 90e3), 1.0 / open_mm2(0.8, 75e3)),
            ("valve_hysteresis", "half_width_duty", 0.11, 0.09),
            ("valve_stiction", "band_duty", 0.21, 0.19),
        ] {
            let short = |value: f64| {
                let there =
                    all.iter().filter(|c| c.id == id && c.component == "valve_pos" && c.keys().any(|of| of == key));
                let with = |c: &Candidate| {
                    c.attached(&c.keys().map(|of| if of == key { value } else { 0.0 }).collect::<Vec<_>>())
                };
                let level = there.map(with).find_map(|attached| level(&rig, &records, &attached)).unwrap();
                assert_eq!(level.key, key);
                level.nearest_short_of_it()
            };
            assert!(short(unreached).is_some(), "{id}");
            assert_eq!(short(reached), None, "{id}");
        }
    }

    #[test]
    fn a_dead_zone_below_every_command_is_an_extrapolation() {
        let [said_of_it] = &said(0.1, [0.2, 0.9])[..] else { panic!("nothing is said of it") };
        assert!(said_of_it.contains("`drive` was never between 0 and it"), "{said_of_it}");
        assert!(said_of_it.contains("the least was 0.200"), "{said_of_it}");
        assert_eq!(said(0.3, [0.1, 0.9]), Vec::<String>::new());
    }
}

//! Where flappers lay when a recording began.
//!
//! A valve with play or dry friction has a memory that no sensor shows. What it holds at the first row stays there until the
//! duty has moved far enough: with play for the first seconds, with friction, or under commands that move less than its band,
//! for as long as the recording lasts, since every later jump starts where the one before ended. Taken for the middle where
//! it was not, the right mechanism is off by as much as a wrong one.

use model::mechanism::Mechanism;
use model::rig::Rig;

use super::arcs::{Arcs, Flapper, share_of};
use super::simulator::{Run, Simulator};

/// Rows from the start of an arc that decide: 20 s.
const DECIDING_ROWS: usize = 1000;
/// Places on either side of the middle that are looked at first, and around the best of them: so many, for where a jump
/// decides the neighbour of the right place may be behind a wrong one.
const PLACES: i32 = 8;
const NEARER: i32 = 4;
const LOOKED_AROUND: usize = 3;
/// Sides to which several flappers are tried together, where they lie first; steps in which that is done at last; and the most of them
/// that are: 3³ runs of 20 s a step.
const SIDES: [f64; 3] = [0.0, -1.0, 1.0];
const NEARER_STEPS: [f64; 5] = [0.25, 0.125, 0.0625, 0.03125, 0.015625];
const MOST_TOGETHER: usize = 3;
/// Places on either side for a rough idea.
const FEW_PLACES: i32 = 4;

/// Closeness of a look for where a flapper lay.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Look {
    /// At places a quarter of its room's half apart.
    Roughly,
    /// At places an eighth apart.
    Evenly,
    /// At the places of [`Look::Evenly`], and around the best of them in steps of a 64th.
    Closely,
}

/// Even shares on either side of the middle, up to `reach`.
fn places(each: i32, reach: f64) -> Vec<f64> {
    (-each..=each).map(|k| reach * f64::from(k) / f64::from(each)).collect()
}

/// The room in which a valve's flapper may lie when a run begins.
#[derive(Debug, Clone, PartialEq)]
pub struct Room {
    /// Name of the unknown ([`model::plant::UnobservedInitialState`]).
    pub unknown: String,
    /// The valve.
    pub valve: String,
    /// From the middle to either end, in duty.
    pub half_duty: f64,
}

/// The rooms of a rig's valves with play or friction, in the order of its mechanisms.
pub fn rooms(rig: &Rig) -> Vec<Room> {
    let of = |attached: &model::rig::MechanismInstance| {
        let (kind, half_duty) = match &attached.mechanism {
            Mechanism::ValveHysteresis(play) => ("play", play.half_width_duty),
            Mechanism::ValveStiction(stick) => ("stick", stick.band_duty),
            _ => return None,
        };
        let valve = attached.component.clone();
        Some(Room { unknown: format!("{kind}:{valve}"), valve, half_duty })
    };
    rig.mechanisms.iter().filter(|attached| attached.enabled).filter_map(of).collect()
}

/// Names of the unknowns of a rig's valves that have room to lie anywhere in.
fn lies(rig: &Rig) -> Vec<String> {
    rooms(rig).into_iter().map(|room| room.unknown).collect()
}

/// Where the flappers of some runs lie best (least absolute error of the first 20 s) at the start of each arc, by run and
/// arc; those that the arcs themselves tell stay where they are. Runs that cannot be simulated keep the usual places.
pub fn flappers_of(simulator: &Simulator<'_>, runs: &[Run], arcs: &Arcs, look: Look) -> Vec<Vec<Vec<Flapper>>> {
    let count = arcs.arcs().len();
    let mut found: Vec<Vec<Vec<Flapper>>> = runs.iter().map(|_| vec![Vec::new(); count]).collect();
    let told = |unknown: &String| arcs.arcs().iter().any(|arc| share_of(&arc.flappers, unknown).is_some());
    let open: Vec<Vec<String>> =
        runs.iter().map(|run| lies(&run.rig).into_iter().filter(|unknown| !told(unknown)).collect()).collect();
    let most = open.iter().map(Vec::len).max().unwrap_or(0);
    if most == 0 {
        return found;
    }
    let ends: Vec<usize> = (0..simulator.records().records().len())
        .map(|record| arcs.of(record).map(|arc| arc.rows.start + DECIDING_ROWS).max().unwrap_or(0))
        .collect();
    let first = arcs.clone().until(&ends);
    together(simulator, runs, &first, &open, &mut found, 1.0);
    for turn in 0..most {
        let unknown_of = |at: usize| open.get(at).and_then(|open: &Vec<String>| open.get(turn));
        let each = if look == Look::Roughly { FEW_PLACES } else { PLACES };
        let coarse: Places = vec![vec![places(each, 1.0); count]; runs.len()];
        let mut best = ranked(simulator, runs, &first, &found, &unknown_of, coarse);
        if look == Look::Closely {
            let around = |shares: &mut Vec<f64>| {
                let near = places(NEARER, 0.5 / f64::from(PLACES));
                let at = |share: &f64| near.iter().map(|by| (share + by).clamp(-1.0, 1.0)).collect::<Vec<f64>>();
                *shares = shares.iter().take(LOOKED_AROUND).flat_map(at).collect();
            };
            best.iter_mut().flatten().for_each(around);
            best = ranked(simulator, runs, &first, &found, &unknown_of, best);
        }
        take(&mut found, &best, &unknown_of);
    }
    // Each was placed with the others where they were then: together once more, ever nearer.
    if look == Look::Closely {
        for step in NEARER_STEPS {
            together(simulator, runs, &first, &open, &mut found, step);
        }
    }
    found
}

/// Places several flappers of each run together where they err least, each where it lies or a `step` to either side: one chamber's valve
/// moves the other chamber by way of the pump, so that flappers looked for one after the other end between the ends.
fn together(
    simulator: &Simulator<'_>,
    runs: &[Run],
    first: &Arcs,
    open: &[Vec<String>],
    found: &mut [Vec<Vec<Flapper>>],
    step: f64,
) {
    let mut probes = Vec::new();
    let mut of = Vec::new();
    for (at, ((run, open), found)) in runs.iter().zip(open).zip(&*found).enumerate() {
        if !(2..=MOST_TOGETHER).contains(&open.len()) {
            continue;
        }
        for combination in 0..SIDES.len().pow(open.len() as u32) {
            let mut all = found.clone();
            for (digit, unknown) in open.iter().enumerate() {
                let by = step * SIDES[combination / SIDES.len().pow(digit as u32) % SIDES.len()];
                for flappers in &mut all {
                    let share = share_of(flappers, unknown).unwrap_or(0.0) + by;
                    put(flappers, unknown, share.clamp(-1.0, 1.0));
                }
            }
            of.push((at, all.clone()));
            probes.push(Run { flappers: all, ..run.clone() });
        }
    }
    let mut least: Vec<Vec<f64>> = found.iter().map(|arcs| vec![f64::INFINITY; arcs.len()]).collect();
    for ((at, placed), trace) in of.into_iter().zip(simulator.run(&probes, first)) {
        let Ok(trace) = trace else { continue };
        for (number, flappers) in placed.into_iter().enumerate() {
            let error = error(simulator, first, number, &trace);
            if error < least[at][number] {
                (least[at][number], found[at][number]) = (error, flappers);
            }
        }
    }
}

/// Puts one flapper of each run where it errs least.
fn take<'u>(found: &mut [Vec<Vec<Flapper>>], best: &Places, unknown_of: &dyn Fn(usize) -> Option<&'u String>) {
    for (at, (flappers, best)) in found.iter_mut().zip(best).enumerate() {
        let Some(unknown) = unknown_of(at) else { continue };
        for (flappers, shares) in flappers.iter_mut().zip(best) {
            put(flappers, unknown, shares.first().copied().unwrap_or(0.0));
        }
    }
}

/// Shares by run and arc.
type Places = Vec<Vec<Vec<f64>>>;

/// Places of one flapper of each run, in each arc the one that errs least first. All probes of all runs run at once: lanes
/// are filled by runs of one structure.
fn ranked<'u>(
    simulator: &Simulator<'_>,
    runs: &[Run],
    first: &Arcs,
    found: &[Vec<Vec<Flapper>>],
    unknown_of: &dyn Fn(usize) -> Option<&'u String>,
    places: Places,
) -> Places {
    let mut probes = Vec::new();
    let mut of = Vec::new();
    for (at, ((run, found), places)) in runs.iter().zip(found).zip(&places).enumerate() {
        let Some(unknown) = unknown_of(at) else { continue };
        for which in 0..places.iter().map(Vec::len).max().unwrap_or(0) {
            let mut probe = Run { flappers: found.clone(), ..run.clone() };
            for (flappers, shares) in probe.flappers.iter_mut().zip(places) {
                put(flappers, unknown, shares.get(which).or(shares.last()).copied().unwrap_or(0.0));
            }
            of.push((at, which));
            probes.push(probe);
        }
    }
    let mut errors: Vec<Vec<Vec<(f64, f64)>>> = places.iter().map(|arcs| vec![Vec::new(); arcs.len()]).collect();
    for ((at, which), trace) in of.into_iter().zip(simulator.run(&probes, first)) {
        let Ok(trace) = trace else { continue };
        for (number, (errors, shares)) in errors[at].iter_mut().zip(&places[at]).enumerate() {
            let error = error(simulator, first, number, &trace);
            errors.extend(shares.get(which).filter(|_| error.is_finite()).map(|share| (error, *share)));
        }
    }
    let sorted = |mut errors: Vec<(f64, f64)>| {
        errors.sort_by(|a, b| a.0.total_cmp(&b.0));
        errors.into_iter().map(|(_, share)| share).collect()
    };
    errors.into_iter().map(|arcs| arcs.into_iter().map(sorted).collect()).collect()
}

/// Puts a flapper at a place.
fn put(flappers: &mut Vec<Flapper>, unknown: &str, share: f64) {
    match flappers.iter_mut().find(|flapper| flapper.unknown == unknown) {
        Some(flapper) => flapper.share = share,
        None => flappers.push(Flapper { unknown: unknown.to_owned(), share }),
    }
}

/// Sum of absolute errors from where an arc starts everything anew, channels together; infinite where the run diverged.
fn error(simulator: &Simulator<'_>, arcs: &Arcs, number: usize, trace: &[f64]) -> f64 {
    let (records, layout) = (simulator.records(), simulator.records().layout());
    let Some(arc) = arcs.arcs().get(number) else { return f64::INFINITY };
    let sum: f64 = (0..layout.channels())
        .flat_map(|channel| layout.stretch(arc.record, channel, arcs.chained(number)))
        .map(|i| (trace.get(i).unwrap_or(&f64::NAN) - records.readings_kpa().get(i).unwrap_or(&0.0)).abs())
        .sum();
    if sum.is_finite() { sum } else { f64::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::Records;
    use crate::simulate::Fidelity;
    use model::rig::MechanismInstance;
    use proto::recording::Recording;
    use proto::recording::csv::{Column, ColumnData};

    fn records(rig: &Rig, pressures: [Vec<f64>; 2]) -> Records {
        let rows = pressures[0].len();
        let numbers = |name: &str, of: Vec<f64>| Column { name: name.to_owned(), data: ColumnData::Numbers(of) };
        // Steps of 0.01 to 0.05: a band of 0.04 passes some of them on and not others.
        let duty = |k: usize| 0.8 + 0.02 * ((k / 60 * 7 % 5) as f64 - 2.0) + 0.01 * ((k / 100) % 3) as f64;
        let [pos, neg] = pressures;
        let columns = vec![
            numbers("u_pos", (0..rows).map(duty).collect()),
            numbers("u_neg", vec![0.8; rows]),
            numbers("p_pos_kpa", pos),
            numbers("p_neg_kpa", neg),
        ];
        let time_s = (0..rows).map(|k| 0.02 * k as f64).collect();
        Records::new(rig, &[Recording::new("made", time_s, columns).unwrap()]).unwrap()
    }

    /// Runs that began with the flapper at a known place: it is found there again, for play and for friction.
    #[test]
    fn a_flapper_is_found_where_it_lay() {
        let mechanisms = [
            "id = 'valve_hysteresis'\nhalf_width_duty = 0.04",
            "id = 'valve_stiction'\nband_duty = 0.04\nshort_of_it = 0.2",
            "id = 'valve_stiction'\nband_duty = 0.04\nshort_of_it = 0.2\nrubs = 'flapper'",
        ];
        for text in mechanisms {
            let mut rig = Rig::builtin("dual_pressure").unwrap();
            let attached: MechanismInstance = toml::from_str(&format!("component = 'valve_pos'\n{text}")).unwrap();
            rig.mechanisms.push(attached);
            let blank = records(&rig, [vec![90.0; 600], vec![-70.0; 600]]);
            let arcs = Arcs::free(&blank);
            let [unknown] = &lies(&rig)[..] else { panic!("one valve has room") };
            for share in [-0.8, 0.3, 0.9] {
                let flappers = vec![vec![Flapper { unknown: unknown.clone(), share }]];
                let began = Run { flappers, ..Run::from(rig.clone()) };
                let simulator = Simulator::new(&blank, Fidelity::Averaged);
                let trace = simulator.run(&[began], &arcs).pop().unwrap().unwrap();
                let read = [0, 1].map(|channel| trace[blank.layout().channel(0, channel)].to_vec());
                let made = records(&rig, read);
                let simulator = Simulator::new(&made, Fidelity::Averaged);
                let found = flappers_of(&simulator, &[Run::from(rig.clone())], &Arcs::free(&made), Look::Closely);
                let again = Run { flappers: found[0].clone(), ..Run::from(rig.clone()) };
                let again = simulator.run(&[again], &Arcs::free(&made)).pop().unwrap().unwrap();
                let off = again.iter().zip(made.readings_kpa()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                let found = &found[0][0][0];
                // It is looked for in steps of a 64th.
                assert!(
                    (found.share - share).abs() < 0.02 && off < 0.1,
                    "{text}: {found:?}, began at {share}, {off} kPa"
                );
                // Found once, it is not looked for again.
                let told = super::super::with_flappers(&simulator, &rig, &Arcs::free(&made));
                assert!(flappers_of(&simulator, &[Run::from(rig.clone())], &told, Look::Closely)[0][0].is_empty());
            }
        }
    }

    /// Two vents that were open before anything moved, which the pump couples: each found as if the other lay in its middle, both
    /// end half-way.
    #[test]
    fn flappers_of_both_valves_are_found_together() {
        let mut rig = Rig::builtin("dual_pressure").unwrap();
        for valve in ["valve_pos", "valve_neg"] {
            let text = format!("component = '{valve}'\nid = 'valve_hysteresis'\nhalf_width_duty = 0.03");
            rig.mechanisms.push(toml::from_str(&text).unwrap());
        }
        // Open for 2 s, then down in a ramp.
        let duty = |k: usize| 1.0 - 0.3 * (k.saturating_sub(100) as f64 / 500.0);
        let made = |pressures: [Vec<f64>; 2]| {
            let numbers = |name: &str, of: Vec<f64>| Column { name: name.to_owned(), data: ColumnData::Numbers(of) };
            let [pos, neg] = pressures;
            let duties = || (0..600).map(duty).collect::<Vec<f64>>();
            let columns = vec![
                numbers("u_pos", duties()),
                numbers("u_neg", duties()),
                numbers("p_pos_kpa", pos),
                numbers("p_neg_kpa", neg),
            ];
            let time_s = (0..600).map(|k| 0.02 * k as f64).collect();
            Records::new(&rig, &[Recording::new("made", time_s, columns).unwrap()]).unwrap()
        };
        let blank = made([vec![80.0; 600], vec![-64.0; 600]]);
        for shares in [[-1.0, -1.0], [1.0, 0.4], [-0.6, 0.2]] {
            let flappers = lies(&rig).into_iter().zip(shares).map(|(unknown, share)| Flapper { unknown, share });
            let began = Run { flappers: vec![flappers.collect()], ..Run::from(rig.clone()) };
            let simulator = Simulator::new(&blank, Fidelity::Averaged);
            let trace = simulator.run(&[began], &Arcs::free(&blank)).pop().unwrap().unwrap();
            let read = made([0, 1].map(|channel| trace[blank.layout().channel(0, channel)].to_vec()));
            let simulator = Simulator::new(&read, Fidelity::Averaged);
            let found = flappers_of(&simulator, &[Run::from(rig.clone())], &Arcs::free(&read), Look::Closely);
            let found: Vec<f64> = found[0][0].iter().map(|flapper| flapper.share).collect();
            // Steps of a 64th, and one step more where both are between the places that are tried together.
            let off = found.iter().zip(shares).map(|(found, share)| (found - share).abs()).fold(0.0, f64::max);
            assert!(off < 2.0 / 64.0, "{found:?}, began at {shares:?}");
        }
    }
}

//! The paper's rig against traces of other implementations, row by row.
//!
//! Two sources: `tests/golden/*.csv`, written by `tests/golden/make.py` (its head says what it does
//! differently), and, where a folder of converged traces from elsewhere is at hand, every trace in it
//! (`GOLDEN_DIR`, or `../shared/golden` beside the repository).
//!
//! Row k holds the commands that act from t_k to t_{k+1} and the pressures at t_k; rest at t = 0.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use model::plant::{Plant, Simulation};
use model::rig::{Pump, Rig};

/// Error allowed to the model, in kPa. The traces' own error, below 1e-4 kPa, is lost in it.
const TOLERANCE_KPA: f64 = 0.01;

/// Error that plain RK4 (`refine_switching = false`) leaves at 0.1 ms in the worst rows. Check valves turn inside a step, and for as long as
/// their opening drifts through the steps the errors of many revolutions add up: 0.0149 kPa at worst in the
/// traces from elsewhere, and the same to the last printed digit from a plain RK4 program in C.
const PLAIN_KPA: f64 = 0.016;

/// A trace by column.
struct Trace {
    columns: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Trace {
    fn read(path: &Path) -> Trace {
        let text = std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let mut lines = text.lines();
        let columns: Vec<_> = lines.next().unwrap().split(',').map(str::to_owned).collect();
        let rows: Vec<Vec<f64>> = lines.map(|l| l.split(',').map(|cell| cell.parse().unwrap()).collect()).collect();
        assert!(!rows.is_empty() && rows.iter().all(|r| r.len() == columns.len()), "{}", path.display());
        Trace { columns, rows }
    }

    fn column(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|c| c == name)
    }
}

/// The paper's rig with another integration step.
fn paper_rig(step_ms: f64) -> Rig {
    let mut rig = Rig::builtin("dual_pressure").unwrap();
    rig.integrator.step_ms = step_ms;
    rig
}

/// The largest deviation from a trace in kPa, positive and negative chamber.
fn deviation(rig: &Rig, trace: &Trace) -> [f64; 2] {
    let plant = Arc::new(Plant::<f64>::new(rig).unwrap());
    let inputs: Vec<(Option<usize>, Option<f64>)> =
        plant.inputs().iter().map(|i| (trace.column(&i.column), i.default)).collect();
    let read: Vec<usize> = plant.sensor_columns().iter().map(|c| trace.column(c).unwrap()).collect();
    let time = trace.column("time_s").unwrap();
    let mut simulation = Simulation::new(Arc::clone(&plant));
    let mut worst = [0.0f64; 2];
    for (k, row) in trace.rows.iter().enumerate() {
        assert!((row[time] - k as f64 * plant.tick_s()).abs() < 1e-9, "row {k} is not on the tick");
        for ((worst, column), reading) in worst.iter_mut().zip(&read).zip(simulation.readings_kpa()) {
            let off = (reading - row[*column]).abs();
            *worst = worst.max(off);
        }
        let commands: Vec<f64> =
            inputs.iter().map(|(column, default)| column.map_or_else(|| default.unwrap(), |c| row[c])).collect();
        simulation.tick(&commands);
    }
    worst
}

fn traces_in(folder: &Path) -> Vec<PathBuf> {
    let mut found: Vec<_> = std::fs::read_dir(folder)
        .unwrap_or_else(|e| panic!("{}: {e}", folder.display()))
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|e| e == "csv"))
        .collect();
    found.sort();
    found
}

#[test]
fn agrees_with_the_independent_implementation() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden");
    let traces = traces_in(&folder);
    assert_eq!(traces.len(), 4, "steps, ramps, relay, slip");
    for path in traces {
        let mut rig = paper_rig(0.1);
        if path.file_stem().unwrap() == "slip" {
            let Some(Pump::Piston(pump)) = rig.pumps.get_mut("pump") else { panic!("the paper's pump has pistons") };
            pump.speed_rpm = 2917.0;
        }
        let [pos, neg] = deviation(&rig, &Trace::read(&path));
        println!("{}: at most {pos:.5} and {neg:.5} kPa off", path.file_name().unwrap().display());
        assert!(pos.max(neg) < TOLERANCE_KPA, "{}: {pos} and {neg} kPa off", path.display());
    }
}

#[test]
fn agrees_with_traces_from_elsewhere() {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/golden");
    let folder = std::env::var_os("GOLDEN_DIR").map_or_else(beside, PathBuf::from);
    if !folder.is_dir() {
        println!("skipped: no folder {}; set GOLDEN_DIR to one with traces", folder.display());
        return;
    }
    let traces = traces_in(&folder);
    assert!(!traces.is_empty(), "no trace in {}", folder.display());
    for path in traces {
        let trace = Trace::read(&path);
        for (refine, tolerance) in [(true, TOLERANCE_KPA), (false, PLAIN_KPA)] {
            let step_ms = 0.1;
            let mut rig = paper_rig(step_ms);
            rig.integrator.refine_switching = refine;
            let [pos, neg] = deviation(&rig, &trace);
            let name = path.file_name().unwrap();
            let rows = trace.rows.len();
            println!(
                "{}: {rows} rows at {step_ms} ms, refined {refine}, at most {pos:.5} and {neg:.5} kPa off",
                name.display()
            );
            assert!(
                pos.max(neg) < tolerance,
                "{} at {step_ms} ms, refined {refine}: {pos} and {neg} kPa off",
                path.display()
            );
        }
    }
}

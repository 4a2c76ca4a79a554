//! The paper's two steps: the check valves by the simplex method, the valves by linear least squares inside it.
//!
//! For given check-valve areas the pump's flow is known and the valves are linear; what is left of the balances is the
//! objective. (Variable projection: the simplex sees two parameters, whatever the number of linear ones.) The result
//! is a start for the joint refinement that owes nothing to the rig file but the pump's geometry.

use model::rig::{Pump, Rig};

use super::weak_form::{Regression, ValveRegression, balances, pump_flows};
use crate::FitError;
use crate::data::Records;
use crate::least_squares::{Simplex, nelder_mead};
use crate::parameters::{Scatter, set_value};

/// Result of the paper's procedure.
#[derive(Debug, Clone, PartialEq)]
pub struct PaperFit {
    /// Effective areas of the inlet and outlet check valves, in mm².
    pub check_areas_mm2: [f64; 2],
    /// The chambers' regressions.
    pub valves: Vec<ValveRegression>,
    /// The rig with all of these.
    pub rig: Rig,
    /// Evaluations of the objective.
    pub evaluations: usize,
}

/// Rows, all recordings together, that the simplex looks at: a minute. The regression at its end sees all.
const SEARCHED_ROWS: usize = 3000;

/// Runs the paper's procedure; `None` for rigs that are not a piston pump between two chambers with a valve each.
///
/// # Errors
/// The recordings do not determine the valves at all.
pub fn paper_fit(
    rig: &Rig,
    records: &Records,
    weights: &[f64],
    scatter: Scatter,
) -> Result<Option<PaperFit>, FitError> {
    let Some((pump, chambers)) = balances(rig, records) else { return Ok(None) };
    let Some(Pump::Piston(piston)) = rig.pumps.get(&pump) else { return Ok(None) };
    let nominal = [piston.inlet_check_area_mm2, piston.outlet_check_area_mm2];
    let regressions = chambers
        .iter()
        .map(|balance| Regression::new(rig, records, weights, balance))
        .collect::<Result<Vec<_>, _>>()?;
    let with_areas = |logs: &[f64]| {
        let mut rig = rig.clone();
        if let Some(Pump::Piston(piston)) = rig.pumps.get_mut(&pump) {
            piston.inlet_check_area_mm2 = nominal[0] * logs.first().copied().unwrap_or(0.0).exp();
            piston.outlet_check_area_mm2 = nominal[1] * logs.get(1).copied().unwrap_or(0.0).exp();
        }
        rig
    };
    let solved = |logs: &[f64], rows: usize| {
        let flows = pump_flows(&with_areas(logs), &pump, records, rows)?;
        regressions.iter().map(|r| r.solve(&flows)).collect::<Result<Vec<_>, _>>()
    };
    let searched = SEARCHED_ROWS / records.records().len().max(1);
    let mut evaluations = 0;
    let objective = |logs: &[f64]| {
        evaluations += 1;
        let Ok(fits) = solved(logs, searched) else { return f64::INFINITY };
        // Windows overlap by half, so each pair is one piece of evidence.
        let data: f64 = fits
            .iter()
            .zip(&regressions)
            .map(|((_, misfit), regression)| 0.5 * regression.windows(searched) as f64 * misfit.max(1e-9).ln())
            .sum();
        data + logs.iter().map(|l| 0.5 * (l / scatter.check_valve).powi(2)).sum::<f64>()
    };
    // Half a per cent is finer than any recording tells.
    let settings = Simplex { step: 0.5 * scatter.check_valve, tolerance: 0.005, evaluations: 60 };
    let (logs, _) = nelder_mead(objective, &[0.0, 0.0], settings);
    let fits = solved(&logs, usize::MAX)?;
    let mut found = with_areas(&logs);
    let mut valves = Vec::new();
    for (regression, (fit, misfit)) in regressions.iter().zip(&fits) {
        let valve = regression.in_file_units(rig, fit, *misfit);
        for (path, value) in [
            format!("volumes.{}.volume_l", valve.volume),
            format!("valves.{}.input_area_mm2", valve.valve),
            format!("valves.{}.pressure_area_mm2_per_n", valve.valve),
            format!("valves.{}.spring_area_mm2", valve.valve),
        ]
        .into_iter()
        .zip(valve.coefficients)
        {
            // What the regression puts out of range (a coefficient that hardly shows) stays as it was.
            let mut changed = found.clone();
            if set_value(&mut changed, &path, value).is_ok() {
                found = changed;
            }
        }
        valves.push(valve);
    }
    let Some(Pump::Piston(piston)) = found.pumps.get(&pump) else { return Ok(None) };
    let check_areas_mm2 = [piston.inlet_check_area_mm2, piston.outlet_check_area_mm2];
    Ok(Some(PaperFit { check_areas_mm2, valves, rig: found, evaluations }))
}

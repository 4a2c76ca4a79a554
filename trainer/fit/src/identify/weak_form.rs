//! Valve coefficients by linear least squares, as in the paper, from ordinary recordings.
//!
//! The mass balance of a chamber with a pump and one valve to the atmosphere is linear in the chamber's volume and in
//! the valve's coefficients once the pump's flow is known. Multiplied by a bump `φ` that vanishes at both ends of a window
//! and integrated by parts, it needs no derivative of a noisy reading (weak form; Shinbrot 1957, Messenger & Bortz
//! 2021):
//!
//! ```text
//! ±∫φ ṁ_pump dt = (V/RT)(−∫φ̇ P dt) ± [ Ĉ_u ∫φ u F dt + Ĉ_P A ∫φ ΔP F dt − Ĉ_k ∫φ F dt ]
//! F = P_up/√(R T_up) Φ(P_up, P_down)
//! ```
//!
//! upper signs for a chamber that the pump fills and the valve empties; `ṁ_pump` is what [`DrivenPump`] delivers or draws
//! under the recorded pressures. Rows at which the valve may be shut are
//! left out, for there the area is no linear function any more.

use model::orifice::FlowFunction;
use model::rig::{ATMOSPHERE, Pump, Rig, Valve, Volume};

use super::driven_pump::DrivenPump;
use crate::FitError;
use crate::data::Records;
use crate::least_squares::{LinearFit, solve};

/// Rows of a window: 0.6 s, several revolutions and less than a chamber's time constant.
const WINDOW: usize = 30;
/// Below this area (as a share of Ĉ_u) a valve is taken as shut, noise and scatter of its coefficients included.
const SHUT: f64 = 0.05;

/// A chamber with a pump and a valve to the atmosphere.
#[derive(Debug, Clone)]
pub(super) struct ChamberBalance {
    /// Name of the volume.
    pub(super) volume: String,
    /// Name of the valve.
    pub(super) valve: String,
    /// Channel of its sensor.
    channel: usize,
    /// +1 where the pump delivers into it, −1 where it draws.
    sign: f64,
    relay: Option<String>,
}

/// The regression of one chamber.
#[derive(Debug, Clone, PartialEq)]
pub struct ValveRegression {
    /// Name of the volume.
    pub volume: String,
    /// Name of the valve.
    pub valve: String,
    /// Volume in L, Ĉ_u in mm², Ĉ_P in mm²/N, Ĉ_k in mm².
    pub coefficients: [f64; 4],
    /// Their standard errors.
    pub sd: [f64; 4],
    /// Root of the mean squared residual of the balance, as a share of the pump's flow.
    pub misfit: f64,
    /// Windows used.
    pub windows: usize,
}

/// The chambers of a rig to which the regression applies, and the name of their pump.
pub(super) fn balances(rig: &Rig, records: &Records) -> Option<(String, Vec<ChamberBalance>)> {
    let (name, pump) = rig.pumps.iter().find_map(|(name, pump)| match pump {
        Pump::Piston(piston) => Some((name.clone(), piston)),
        Pump::Flow(_) => None,
    })?;
    let channel = |volume: &str| {
        let sensor = rig.sensors.values().find(|sensor| sensor.volume == volume)?;
        records.sensors().iter().position(|column| *column == sensor.column)
    };
    let (inlet, outlet) = (channel(&pump.inlet)?, channel(&pump.outlet)?);
    let valve_of = |from: &str, to: &str| {
        let mut fitting = rig.valves.iter().filter(|(_, v)| v.from == from && v.to == to);
        match (fitting.next(), fitting.next()) {
            (Some((name, _)), None) => Some(name.clone()),
            _ => None,
        }
    };
    let one = |volume: &str, valve: String, channel, sign| ChamberBalance {
        volume: volume.to_owned(),
        valve,
        channel,
        sign,
        relay: pump.relay.clone(),
    };
    let chambers = vec![
        one(&pump.outlet, valve_of(&pump.outlet, ATMOSPHERE)?, outlet, 1.0),
        one(&pump.inlet, valve_of(ATMOSPHERE, &pump.inlet)?, inlet, -1.0),
    ];
    Some((name, chambers))
}

/// Flows drawn and delivered in kg/s, by recording and row; rows that were not asked for are missing or NaN.
pub(super) type PumpFlows = Vec<Vec<[f64; 2]>>;

/// The flows of a rig's pump under the recorded pressures, over the first `rows` rows of each recording.
pub(super) fn pump_flows(rig: &Rig, pump: &str, records: &Records, rows: usize) -> Result<PumpFlows, FitError> {
    let driven = DrivenPump::new(rig, pump).map_err(FitError::rig(rig))?;
    let Some((_, chambers)) = balances(rig, records) else { return Ok(Vec::new()) };
    let [outlet, inlet] = chambers.as_slice() else { return Ok(Vec::new()) };
    let atmosphere = rig.atmosphere.pressure_kpa_abs * 1e3;
    let mut flows = Vec::with_capacity(records.records().len());
    for (record, r) in records.records().iter().enumerate() {
        let mut of_record = Vec::with_capacity(rows.min(r.time_s.len()));
        let relay = inlet.relay.as_deref().and_then(|relay| records.input(record, relay));
        for segment in &r.segments {
            let segment = segment.start..segment.end.min(rows);
            if segment.is_empty() {
                break;
            }
            // A chamber cannot be emptied below nothing; readings near the end of the range are only nearly true.
            let pa = |channel: usize, row: usize| {
                let column = records.channel_kpa(record, channel);
                let here = column.get(row).copied().unwrap_or(0.0);
                let next = column.get(row + 1).copied().unwrap_or(here);
                (atmosphere + 0.5e3 * (here + next)).max(100.0)
            };
            let pressures: Vec<[f64; 2]> =
                segment.clone().map(|row| [pa(inlet.channel, row), pa(outlet.channel, row)]).collect();
            let on = |k: usize| relay.and_then(|relay| relay.get(segment.start + k)).is_none_or(|on| *on >= 0.5);
            of_record.extend(driven.flows_kg_per_s(&pressures, on));
        }
        flows.push(of_record);
    }
    Ok(flows)
}

/// Columns of the regression and its right-hand side, before the pump's flow is put in.
#[derive(Debug, Clone)]
pub(super) struct Regression {
    balance: ChamberBalance,
    columns: [Vec<f64>; 4],
    /// Rows of each window with the bump's weights, by (record, first row).
    windows: Vec<(usize, usize)>,
    bump: Vec<f64>,
}

impl Regression {
    /// Sets up the regression of a chamber over readings whose weight is not zero.
    pub(super) fn new(
        rig: &Rig,
        records: &Records,
        weights: &[f64],
        balance: &ChamberBalance,
    ) -> Result<Self, FitError> {
        let missing = || FitError::Singular {
            what: balance.valve.clone(),
            problem: "the valve or the volume is missing".to_owned(),
        };
        let valve = rig.valves.get(&balance.valve).ok_or_else(missing)?;
        let volume = rig.volumes.get(&balance.volume).ok_or_else(missing)?;
        let (bump, slope) = bump();
        let mut columns: [Vec<f64>; 4] = Default::default();
        let mut windows = Vec::new();
        for (record, r) in records.records().iter().enumerate() {
            let pressures = records.channel_kpa(record, balance.channel);
            let duty = records.input(record, &valve.command).unwrap_or_default();
            let counts = weights.get(records.layout().channel(record, balance.channel)).unwrap_or_default();
            for segment in &r.segments {
                let mut start = segment.start;
                while start + WINDOW < segment.end {
                    let rows = start..start + WINDOW + 1;
                    let used = counts.get(rows.clone()).is_some_and(|c| c.iter().all(|c| *c != 0.0));
                    if used
                        && let Some(row) =
                            row_of(rig, valve, volume, &bump, &slope, &pressures[rows.clone()], &duty[rows])
                    {
                        for (column, value) in columns.iter_mut().zip(row) {
                            column.push(value);
                        }
                        windows.push((record, start));
                    }
                    start += WINDOW / 2;
                }
            }
        }
        Ok(Regression { balance: balance.clone(), columns, windows, bump })
    }

    /// Windows within the first `rows` rows, which give an equation each.
    pub(super) fn windows(&self, rows: usize) -> usize {
        self.windows.iter().filter(|(_, start)| start + WINDOW < rows).count()
    }

    /// Solves it for the flows of a pump; also gives the residual as a share of the flow.
    pub(super) fn solve(&self, flows: &PumpFlows) -> Result<(LinearFit, f64), FitError> {
        let flow: Vec<f64> = self.windows.iter().map(|(record, start)| self.pumped(flows, *record, *start)).collect();
        let known: Vec<usize> = (0..flow.len()).filter(|k| flow.get(*k).is_some_and(|f| f.is_finite())).collect();
        let part = |all: &[f64]| -> Vec<f64> { known.iter().filter_map(|k| all.get(*k)).copied().collect() };
        let (flow, columns) = (part(&flow), self.columns.each_ref().map(|column| part(column)));
        let scale = (flow.iter().map(|f| f * f).sum::<f64>() / flow.len().max(1) as f64).sqrt();
        let fit = solve(&columns, &flow, &self.balance.valve)?;
        let misfit = fit.rms / scale;
        Ok((fit, misfit))
    }

    /// The pump's flow through the chamber in one window, under the bump; NaN where it was not worked out.
    fn pumped(&self, flows: &PumpFlows, record: usize, start: usize) -> f64 {
        let end = usize::from(self.balance.sign > 0.0);
        self.bump
            .iter()
            .enumerate()
            .map(|(k, phi)| {
                // Flows of a row act until the next: around a reading it is the mean of both.
                let at = |row: usize| flows.get(record).and_then(|f| f.get(row)).map_or(f64::NAN, |f| f[end]);
                if *phi == 0.0 { 0.0 } else { phi * 0.5 * (at(start + k) + at((start + k).saturating_sub(1))) }
            })
            .sum()
    }

    /// The solution in the rig file's units.
    pub(super) fn in_file_units(&self, rig: &Rig, fit: &LinearFit, misfit: f64) -> ValveRegression {
        let temperature = rig.volumes.get(&self.balance.volume).map_or(f64::NAN, |v| v.temperature_k);
        let units = [rig.gas.gas_constant_j_per_kg_k * temperature * 1e3, 1e6, 1e6, 1e6];
        let in_units =
            |numbers: &[f64]| std::array::from_fn(|k| numbers.get(k).copied().unwrap_or(f64::NAN) * units[k]);
        ValveRegression {
            volume: self.balance.volume.clone(),
            valve: self.balance.valve.clone(),
            coefficients: in_units(&fit.x),
            sd: in_units(&fit.sd),
            misfit,
            windows: self.windows.len(),
        }
    }
}

/// The bump `sin⁴` at the rows of a window and its derivative in 1/row, scaled to sum to one.
fn bump() -> (Vec<f64>, Vec<f64>) {
    let angle = |k: usize| std::f64::consts::PI * k as f64 / WINDOW as f64;
    let sum: f64 = (0..=WINDOW).map(|k| angle(k).sin().powi(4)).sum();
    let value = (0..=WINDOW).map(|k| angle(k).sin().powi(4) / sum).collect();
    let slope = (0..=WINDOW)
        .map(|k| 4.0 * angle(k).sin().powi(3) * angle(k).cos() * std::f64::consts::PI / WINDOW as f64 / sum)
        .collect();
    (value, slope)
}

fn nozzle_m2(valve: &Valve) -> f64 {
    std::f64::consts::PI * (valve.nozzle_diameter_mm * 1e-3).powi(2) / 4.0
}

/// One equation: the four integrals of a window, or `None` where the valve may be shut.
fn row_of(
    rig: &Rig,
    valve: &Valve,
    volume: &Volume,
    bump: &[f64],
    slope: &[f64],
    pressures_kpa: &[f64],
    duty: &[f64],
) -> Option<[f64; 4]> {
    let law = FlowFunction::nozzle(rig.gas.heat_capacity_ratio);
    let gas = rig.gas.gas_constant_j_per_kg_k;
    let atmosphere = rig.atmosphere.pressure_kpa_abs * 1e3;
    let fills = valve.from == ATMOSPHERE;
    let upstream_k = if fills { rig.atmosphere.temperature_k } else { volume.temperature_k };
    let inverse_speed = 1.0 / (gas * upstream_k).sqrt();
    let nozzle = nozzle_m2(valve);
    let period = proto::recording::PERIOD_S;
    let mut row = [0.0; 4];
    for (k, (phi, slope)) in bump.iter().zip(slope).enumerate() {
        // The command of a row acts until the next: what acts around a reading is the mean of both.
        let acting = 0.5 * (duty.get(k)? + duty.get(k.saturating_sub(1))?);
        let chamber = atmosphere + pressures_kpa.get(k)? * 1e3;
        let (up, down) = if fills { (atmosphere, chamber) } else { (chamber, atmosphere) };
        let drop = up - down;
        let area =
            valve.input_area_mm2 * acting + valve.pressure_area_mm2_per_n * nozzle * drop - valve.spring_area_mm2;
        if area < SHUT * valve.input_area_mm2 || drop <= 0.0 {
            return None;
        }
        let flux = inverse_speed * up * law.at_drop(drop / up);
        // Upper signs for a chamber that the pump fills; a chamber that it empties loses what the other gains.
        let storage = if fills { 1.0 } else { -1.0 } * slope / period * chamber;
        row[0] += storage;
        row[1] += phi * acting * flux;
        row[2] += phi * nozzle * drop * flux;
        row[3] -= phi * flux;
    }
    Some(row)
}

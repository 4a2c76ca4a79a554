//! Reconstruction, along the recordings, of what is missing from each balance and each reading.
//!
//! The re-identified rig is run freely; what the recordings differ from it by is handed to the
//! [`smoother`](super::smoother). Each suspect is switched on alone (CTSM's way of asking which equation is deficient):
//! a flow into one chamber, a flow that the pump moves from one to the other, an error of one reading. The pump carries
//! gas from chamber to chamber, so a real loss of mass in one shows in the other a moment later; a sensor's error does
//! not. That is what tells the two apart, and the likelihood weighs it.

use fit::simulate::{Arcs, Run};
use model::rig::{Pump, Rig};

use super::smoother::{Latent, MOST_CHANNELS, Series, Smoothed, log_likelihood, smooth};
use crate::bench::Bench;
use crate::error::DiagnoseError;

/// Correlation lengths that are tried, in s.
const LENGTHS_S: [f64; 4] = [0.08, 0.4, 2.0, 20.0];
/// Standard deviations of a flow that are tried, in kPa/s.
const RATES_KPA_S: [f64; 6] = [0.03, 0.1, 0.3, 1.0, 3.0, 10.0];
/// Standard deviations of a reading's error that are tried, in kPa.
const ERRORS_KPA: [f64; 6] = [0.03, 0.1, 0.3, 0.7, 1.5, 4.0];
/// Shift by which a balance's memory is measured, in kPa.
const NUDGE_KPA: f64 = 0.5;
/// Variance of the first row's error in kPa².
const START_KPA2: f64 = 0.04;

/// Where something may be missing.
#[derive(Debug, Clone, PartialEq)]
pub enum Suspect {
    /// A flow into the chamber of this channel.
    Balance {
        /// The channel.
        channel: usize,
    },
    /// A flow from one chamber into another, as the pump makes.
    Transfer {
        /// Channel it comes from.
        from: usize,
        /// Channel it goes to.
        to: usize,
    },
    /// An error of the reading of this channel.
    Reading {
        /// The channel.
        channel: usize,
    },
}

/// A suspect and what the recordings say of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Suspicion {
    /// Where.
    pub suspect: Suspect,
    /// Gain in log-likelihood over nothing missing, at the best scale.
    pub gain: f64,
    /// Time scale of what is missing there, in s.
    pub length_s: f64,
    /// Size of what is missing there: kPa/s for a flow, kPa for a reading.
    pub size: f64,
}

/// Missing flow along one channel of one recording.
#[derive(Debug, Clone, PartialEq)]
pub struct MissingFlow {
    /// The recording.
    pub record: usize,
    /// The channel.
    pub channel: usize,
    /// Missing mass flow into the chamber, in kg/s, by row.
    pub flow_kg_s: Vec<f64>,
    /// Standard deviation of that flow in kg/s, by row.
    pub sd_kg_s: Vec<f64>,
}

/// The whole reconstruction.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Missing {
    /// Suspects, strongest first.
    pub suspicions: Vec<Suspicion>,
    /// Missing flows by recording and channel.
    pub flows: Vec<MissingFlow>,
    /// Gain of flows missing from every balance at once.
    pub all_flows_gain: f64,
}

impl Suspect {
    /// Tells whether it is about this channel.
    pub fn concerns(&self, channel: usize) -> bool {
        match self {
            Suspect::Balance { channel: own } | Suspect::Reading { channel: own } => *own == channel,
            Suspect::Transfer { from, to } => *from == channel || *to == channel,
        }
    }
}

impl Missing {
    /// Puts the reading of a channel before all others: a formula for it has settled where that channel's mismatch lies.
    pub fn settle_on_reading(&mut self, channel: usize) {
        self.suspicions.sort_by_key(|suspicion| suspicion.suspect != Suspect::Reading { channel });
    }
}

/// The residual of one recording, ready for the smoother.
struct Prepared {
    residual: Vec<f64>,
    transition: Vec<f64>,
    segments: Vec<std::ops::Range<usize>>,
}

/// Reconstructs what `rig`, run freely as `trace`, leaves out. `thorough` spends more time on scales.
///
/// # Errors
/// The rig cannot be simulated.
pub fn reconstruct(bench: &Bench<'_>, rig: &Rig, trace: &[f64], thorough: bool) -> Result<Missing, DiagnoseError> {
    let channels = bench.records.layout().channels();
    if channels == 0 || channels > MOST_CHANNELS {
        return Ok(Missing::default());
    }
    let prepared = prepare(bench, rig, trace)?;
    let noise_kpa2 = variances(bench);
    let likelihood = |latents: &[Latent]| -> f64 {
        prepared
            .iter()
            .flat_map(|p| p.series(channels, noise_kpa2))
            .map(|series| log_likelihood(series, latents).unwrap_or(f64::NEG_INFINITY))
            .sum()
    };
    let nothing = likelihood(&[]);
    let mut suspicions = Vec::new();
    for suspect in suspects(rig, channels) {
        let sizes = if matches!(suspect, Suspect::Reading { .. }) { ERRORS_KPA } else { RATES_KPA_S };
        let mut best: Option<Suspicion> = None;
        for length_s in LENGTHS_S {
            let mut last = f64::NEG_INFINITY;
            for size in sizes.iter().step_by(if thorough { 1 } else { 2 }) {
                let latent = latent(bench, rig, &suspect, length_s, *size);
                let gain = likelihood(&[latent]) - nothing;
                if best.as_ref().is_none_or(|b| gain > b.gain) {
                    best = Some(Suspicion { suspect: suspect.clone(), gain, length_s, size: *size });
                }
                // The likelihood has one maximum in the size.
                if gain < last {
                    break;
                }
                last = gain;
            }
        }
        suspicions.extend(best);
    }
    let flows: Vec<Suspicion> =
        suspicions.iter().filter(|s| matches!(s.suspect, Suspect::Balance { .. })).cloned().collect();
    suspicions.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let latents: Vec<Latent> =
        flows.iter().map(|s| latent(bench, rig, &s.suspect, s.length_s.max(0.2), s.size)).collect();
    let all_flows_gain = likelihood(&latents) - nothing;
    let mut out = Missing { suspicions, flows: Vec::new(), all_flows_gain };
    for (record, p) in prepared.iter().enumerate() {
        let smoothed: Vec<Smoothed> =
            p.series(channels, noise_kpa2).filter_map(|series| smooth(series, &latents)).collect();
        for (i, flow) in flows.iter().enumerate() {
            let Suspect::Balance { channel } = flow.suspect else { continue };
            let to_kg_s = capacity_kg_per_kpa(bench, rig, channel);
            let joined = |of: &dyn Fn(&Smoothed) -> Option<Vec<f64>>| -> Vec<f64> {
                smoothed.iter().filter_map(of).flatten().map(|kpa_s| kpa_s * to_kg_s).collect()
            };
            out.flows.push(MissingFlow {
                record,
                channel,
                flow_kg_s: joined(&|s| s.mean.get(i).cloned()),
                sd_kg_s: joined(&|s| s.sd.get(i).cloned()),
            });
        }
    }
    Ok(out)
}

impl Prepared {
    fn series(&self, channels: usize, noise_kpa2: [f64; MOST_CHANNELS]) -> impl Iterator<Item = Series<'_>> {
        self.segments.iter().map(move |rows| Series {
            channels,
            residual_kpa: self.residual.get(rows.start * channels..rows.end * channels).unwrap_or_default(),
            transition: self
                .transition
                .get(rows.start * channels * channels..rows.end * channels * channels)
                .unwrap_or_default(),
            step_s: proto::recording::PERIOD_S,
            noise_kpa2,
            start_kpa2: START_KPA2,
        })
    }
}

/// Residuals by row and the balances' memory along the run.
fn prepare(bench: &Bench<'_>, rig: &Rig, trace: &[f64]) -> Result<Vec<Prepared>, DiagnoseError> {
    let records = bench.records;
    let layout = records.layout();
    let channels = layout.channels();
    // Two rows from every second row's own pressures: what a nudge has become one row later is F.
    let arcs = Arcs::windows(records, 2, trace);
    let runs = Run::nudged(rig, channels, NUDGE_KPA);
    let traces = bench
        .simulator
        .run(&runs, &arcs)
        .into_iter()
        .collect::<Result<Vec<_>, _>>()
        .map_err(DiagnoseError::rig(rig))?;
    let Some((base, nudged)) = traces.split_first() else { return Ok(Vec::new()) };
    let mut prepared = Vec::new();
    for (record, r) in records.records().iter().enumerate() {
        let rows = layout.rows(record);
        let mut residual = vec![0.0; rows * channels];
        let mut transition = vec![0.0; rows * channels * channels];
        for channel in 0..channels {
            let range = layout.channel(record, channel);
            for (row, index) in range.enumerate() {
                let recorded = records.readings_kpa().get(index).copied().unwrap_or(f64::NAN);
                let simulated = trace.get(index).copied().unwrap_or(f64::NAN);
                residual[row * channels + channel] = recorded - simulated;
            }
        }
        let windows: Vec<_> = arcs.arcs().iter().filter(|arc| arc.record == record).collect();
        for arc in windows {
            for to in 0..channels {
                for (from, nudged) in nudged.iter().enumerate() {
                    let index = layout.channel(record, to).start + arc.rows.start + 1;
                    let moved = nudged.get(index).unwrap_or(&0.0) - base.get(index).unwrap_or(&0.0);
                    for row in arc.rows.clone() {
                        transition[(row * channels + to) * channels + from] = (moved / NUDGE_KPA).clamp(-0.5, 0.9999);
                    }
                }
            }
        }
        prepared.push(Prepared { residual, transition, segments: r.segments.clone() });
    }
    Ok(prepared)
}

fn variances(bench: &Bench<'_>) -> [f64; MOST_CHANNELS] {
    let sigma = bench.sigma_kpa();
    std::array::from_fn(|c| sigma.get(c).map_or(0.01, |s| s * s))
}

/// Everything that is asked about.
fn suspects(rig: &Rig, channels: usize) -> Vec<Suspect> {
    let mut all: Vec<Suspect> = (0..channels).map(|channel| Suspect::Balance { channel }).collect();
    for pump in rig.pumps.values() {
        let (inlet, outlet) = match pump {
            Pump::Piston(p) => (&p.inlet, &p.outlet),
            Pump::Flow(p) => (&p.inlet, &p.outlet),
        };
        let channel = |volume: &str| crate::search::place::channel_of(rig, volume);
        if let (Some(from), Some(to)) = (channel(inlet), channel(outlet)) {
            all.push(Suspect::Transfer { from, to });
        }
    }
    all.extend((0..channels).map(|channel| Suspect::Reading { channel }));
    all
}

fn latent(bench: &Bench<'_>, rig: &Rig, suspect: &Suspect, length_s: f64, sd: f64) -> Latent {
    let mut latent = Latent { into_rate: [0.0; MOST_CHANNELS], into_reading: [0.0; MOST_CHANNELS], length_s, sd };
    match suspect {
        Suspect::Balance { channel } => latent.into_rate[*channel] = 1.0,
        Suspect::Reading { channel } => latent.into_reading[*channel] = 1.0,
        Suspect::Transfer { from, to } => {
            // The same mass moves a small chamber further.
            let ratio = capacity_kg_per_kpa(bench, rig, *to) / capacity_kg_per_kpa(bench, rig, *from);
            latent.into_rate[*to] = 1.0;
            latent.into_rate[*from] = -ratio;
        }
    }
    latent
}

/// Mass per pressure of the chamber of a channel, V/(R T), in kg/kPa.
pub fn capacity_kg_per_kpa(bench: &Bench<'_>, rig: &Rig, channel: usize) -> f64 {
    let column = bench.records.sensors().get(channel);
    let sensor = rig.sensors.values().find(|s| Some(&s.column) == column);
    sensor.and_then(|s| rig.volumes.get(&s.volume)).map_or(f64::NAN, |volume| {
        volume.volume_l * 1e-3 / (rig.gas.gas_constant_j_per_kg_k * volume.temperature_k) * 1e3
    })
}

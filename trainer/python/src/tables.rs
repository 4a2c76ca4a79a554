//! Open-loop simulation and recordings.

use std::borrow::Cow;
use std::path::Path;

use model::observation::Pair;
use model::predict::DualPressureRig;
use proto::recording::Recording;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::{bytes_of, doubles, refused};

/// Both pressures of a rig under given duties, one tick of 20 ms each; positive readings first, then negative, kPa gauge.
///
/// # Errors
/// `ValueError` if the rig is unsound, lacks a port, or a duty is not within 0 … 1.
#[pyfunction]
pub(crate) fn simulate<'py>(
    py: Python<'py>,
    rig: &str,
    u_pos: &[u8],
    u_neg: &[u8],
    pump_on: Option<&[u8]>,
    start_kpa: Option<(f64, f64)>,
) -> PyResult<Bound<'py, PyBytes>> {
    let rig = proto::rig_file::load(rig).map_err(refused)?;
    let mut plant = DualPressureRig::new(&rig).map_err(refused)?;
    let duties: Vec<Pair> = doubles(u_pos).into_iter().zip(doubles(u_neg)).map(|(pos, neg)| [pos, neg]).collect();
    if let Some((row, duty)) = duties.iter().enumerate().find(|(_, d)| !d.iter().all(|u| (0.0..=1.0).contains(u))) {
        return Err(refused(format!("row {row}: duties {duty:?} are not within 0 … 1")));
    }
    let first = duties.first().copied().unwrap_or([1.0; 2]);
    if let Some((pos, neg)) = start_kpa {
        plant.start_from([pos, neg], first);
    }
    let mut readings: [Vec<f64>; 2] = Default::default();
    for (tick, duty) in duties.iter().enumerate() {
        for (column, reading) in readings.iter_mut().zip(plant.readings_kpa()) {
            column.push(reading);
        }
        plant.tick(*duty, pump_on.is_none_or(|on| on.get(tick) != Some(&0)));
    }
    Ok(PyBytes::new(py, &bytes_of(readings.into_iter().flatten(), f64::to_le_bytes)))
}

/// A column that crosses the border: bytes of doubles, or texts.
#[derive(IntoPyObject)]
pub(crate) enum ColumnOut {
    /// Little-endian doubles.
    Numbers(Cow<'static, [u8]>),
    /// Texts.
    Texts(Vec<String>),
}

/// A recording's columns by name, `time_s` first.
///
/// # Errors
/// `ValueError` with the reader's line: file, line or column, what is wrong, and the fix.
#[pyfunction]
#[pyo3(signature = (file, rig=None))]
pub(crate) fn read_recording(file: &str, rig: Option<&str>) -> PyResult<Vec<(String, ColumnOut)>> {
    let path = Path::new(file);
    let recording = match rig {
        Some(rig) => Recording::read_for(path, &proto::rig_file::load(rig).map_err(refused)?),
        None => Recording::read(path),
    }
    .map_err(refused)?;
    let numbers = |values: &[f64]| ColumnOut::Numbers(Cow::Owned(bytes_of(values.iter().copied(), f64::to_le_bytes)));
    let mut columns = vec![("time_s".to_owned(), numbers(recording.time_s()))];
    for name in recording.names().filter(|name| *name != "time_s") {
        if let Some(values) = recording.column(name) {
            columns.push((name.to_owned(), numbers(values)));
        } else if let Some(texts) = recording.text_column(name) {
            columns.push((name.to_owned(), ColumnOut::Texts(texts.to_vec())));
        }
    }
    Ok(columns)
}

//! The native half of the Python package `dual_pressure`.
//!
//! | module | subject |
//! | --- | --- |
//! | `episode` | the rig as a learning problem, one rig at a time, for Gymnasium |
//! | `tables` | open-loop simulation and recordings |
//!
//! Arrays cross the border as bytes of little-endian numbers: the stable ABI down to Python 3.9 has no buffer
//! protocol, and a copy of a recording costs nothing beside reading it.

mod episode;
mod tables;

use std::fmt::Display;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// A Python `ValueError` with the one line that says what is wrong.
fn refused(error: impl Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// Bytes of numbers, little-endian.
fn bytes_of<const N: usize, T>(values: impl IntoIterator<Item = T>, encode: impl Fn(T) -> [u8; N]) -> Vec<u8> {
    values.into_iter().flat_map(encode).collect()
}

/// Numbers from little-endian bytes; a remainder that is no whole number is left out.
fn doubles(bytes: &[u8]) -> Vec<f64> {
    bytes.as_chunks::<8>().0.iter().map(|chunk| f64::from_le_bytes(*chunk)).collect()
}

#[pymodule]
mod _native {
    #[pymodule_export]
    use crate::episode::Env;
    #[pymodule_export]
    use crate::tables::read_recording;
    #[pymodule_export]
    use crate::tables::read_ticks;
    #[pymodule_export]
    use crate::tables::simulate;
    use pyo3::prelude::*;

    /// Integrator steps per step of the rig file, unless another number is asked for.
    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("REFINE", free_run::refine::REFINE)
    }
}

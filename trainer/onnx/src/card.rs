//! Metadata of a policy file: what it says about itself.
//!
//! | key | holds |
//! | --- | --- |
//! | `contract`, `rate_hz` | version of the observation contract; ticks per second |
//! | `input_unit`, `output_unit` | the unit, where all values have one |
//! | `input_units`, `output_units` | one unit for each value, where they differ |
//! | `input_names`, `output_names` | in the order of the tensor |
//! | `rig`, `rig_hash`, `seed`, `steps`, `variant`, `preset`, `trainer` | where it comes from: [`Provenance`] |
//! | `golden_input`, `golden_output` | answers to reproduce: [`GoldenPair`] |
//! | `export_format`, `content_sha256` | the file's hash of itself, see `seal` |
//!
//! Lists are parted by commas, golden pairs by semicolons. Numbers are the shortest decimals that read back to the
//! same f32.

use crate::error::ExportError;
use crate::network::PolicyGraph;
use model::ports::{Port, Ports};

/// Golden pairs that the controller reads.
const MOST_GOLDEN_PAIRS: usize = 256;
/// Largest difference of the caller's answer to the graph in f64. Sums of some hundred products of order one are
/// good to about 1e-6 in f32; a wrong sign, order or layer shows as 1e-3 and more.
const GOLDEN_TOLERANCE: f32 = 1e-5;

/// Where a policy comes from.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Provenance {
    /// Name of the rig it was trained on.
    pub rig: String,
    /// Hash of the rig's file.
    pub rig_hash: String,
    /// Seed of the training.
    pub seed: u64,
    /// Steps trained.
    pub steps: u64,
    /// Parts of the paper's that were switched on.
    pub variant: String,
    /// Name of the set of settings.
    pub preset: String,
    /// Version of the trainer.
    pub trainer: String,
    /// Further keys and values, for example command and commit.
    pub more: Vec<(String, String)>,
}

/// An observation and the answer that the trainer's own network gave to it.
#[derive(Debug, Clone, PartialEq)]
pub struct GoldenPair {
    /// The observation, in the contract's units.
    pub input: Vec<f32>,
    /// The answer.
    pub output: Vec<f32>,
}

/// Keys and values in the order of the file.
///
/// # Errors
/// [`ExportError::KeyTaken`].
pub(crate) fn entries(
    ports: &Ports,
    provenance: &Provenance,
    golden: &[GoldenPair],
) -> Result<Vec<(String, String)>, ExportError> {
    let names = |ports: &[Port]| joined(ports.iter().map(|p| p.name.as_str()), ",");
    let Provenance { rig, rig_hash, seed, steps, variant, preset, trainer, more } = provenance;
    let mut entries = vec![
        ("contract", ports.contract.to_string()),
        ("rate_hz", ports.rate_hz.to_string()),
        units(&ports.inputs, "input_unit", "input_units"),
        units(&ports.outputs, "output_unit", "output_units"),
        ("input_names", names(&ports.inputs)),
        ("output_names", names(&ports.outputs)),
        ("rig", rig.clone()),
        ("rig_hash", rig_hash.clone()),
        ("seed", seed.to_string()),
        ("steps", steps.to_string()),
        ("variant", variant.clone()),
        ("preset", preset.clone()),
        ("trainer", trainer.clone()),
    ];
    if !golden.is_empty() {
        entries.push(("golden_input", rows(golden.iter().map(|p| p.input.as_slice()))));
        entries.push(("golden_output", rows(golden.iter().map(|p| p.output.as_slice()))));
    }
    let mut entries: Vec<(String, String)> = entries.into_iter().map(|(k, v)| (k.to_owned(), v)).collect();
    for (key, value) in more {
        let sealing = ["export_format", "content_sha256"].contains(&key.as_str());
        if sealing || entries.iter().any(|(taken, _)| taken == key) {
            return Err(ExportError::KeyTaken { key: key.clone() });
        }
        entries.push((key.clone(), value.clone()));
    }
    Ok(entries)
}

/// Compares golden pairs with the graph in f64.
///
/// # Errors
/// [`ExportError::TooManyGolden`], [`ExportError::RowLength`], [`ExportError::NotFinite`],
/// [`ExportError::GoldenDiffers`].
pub(crate) fn check_golden(graph: &PolicyGraph, golden: &[GoldenPair]) -> Result<(), ExportError> {
    if golden.len() > MOST_GOLDEN_PAIRS {
        return Err(ExportError::TooManyGolden { found: golden.len(), limit: MOST_GOLDEN_PAIRS });
    }
    let length = |what, found, expected| match found == expected {
        true => Ok(()),
        false => Err(ExportError::RowLength { what, found, expected }),
    };
    for (pair, GoldenPair { input, output }) in golden.iter().enumerate() {
        length("a golden input", input.len(), graph.inputs)?;
        length("a golden output", output.len(), graph.outputs.len())?;
        if let Some((place, &value)) = input.iter().enumerate().find(|(_, v)| !v.is_finite()) {
            return Err(ExportError::NotFinite { what: "golden observation", place, value });
        }
        for (output, (&expected, exported)) in output.iter().zip(graph.answer(input)).enumerate() {
            let off = (expected - exported).abs();
            if off.is_nan() || off > GOLDEN_TOLERANCE {
                return Err(ExportError::GoldenDiffers { pair, output, expected, exported });
            }
        }
    }
    Ok(())
}

/// The unit under `one` where all ports have the same, all units under `each` otherwise.
fn units(ports: &[Port], one: &'static str, each: &'static str) -> (&'static str, String) {
    match ports {
        [first, rest @ ..] if rest.iter().all(|p| p.unit == first.unit) => (one, first.unit.to_owned()),
        _ => (each, joined(ports.iter().map(|p| p.unit), ",")),
    }
}

fn rows<'a>(rows: impl Iterator<Item = &'a [f32]>) -> String {
    joined(rows.map(|row| joined(row.iter(), ",")), ";")
}

/// Rust writes a float as the shortest decimal that reads back to it.
fn joined(words: impl Iterator<Item = impl std::fmt::Display>, separator: &str) -> String {
    let words: Vec<String> = words.map(|w| w.to_string()).collect();
    words.join(separator)
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::observation::ObservationLayout;
    use proptest::prelude::*;

    fn value(entries: &[(String, String)], key: &str) -> Option<String> {
        entries.iter().find(|(k, _)| k == key).map(|(_, v)| v.clone())
    }

    #[test]
    fn units_are_one_word_where_they_are_one() {
        let entries = |c| entries(&Ports::of(c), &Provenance::default(), &[]).unwrap();
        let (paper, correction) = (entries(ObservationLayout::Paper), entries(ObservationLayout::Correction));
        assert_eq!(value(&paper, "input_unit").as_deref(), Some("kPa gauge"));
        assert_eq!(value(&correction, "output_unit").as_deref(), Some("duty"));
        assert_eq!((value(&correction, "input_unit"), value(&paper, "input_units")), (None, None));
        let each = value(&correction, "input_units").unwrap();
        let each: Vec<&str> = each.split(',').collect();
        assert_eq!((each.len(), each[83], each[84]), (124, "kPa gauge", "duty"));
        assert_eq!(value(&paper, "golden_input"), None);
    }

    #[test]
    fn a_key_is_written_once() {
        let taken = |key: &str| {
            let more = vec![("commit".to_owned(), "b9ce2cb".to_owned()), (key.to_owned(), String::new())];
            entries(&Ports::of(ObservationLayout::Paper), &Provenance { more, ..Default::default() }, &[])
        };
        assert!(taken("command").is_ok());
        for key in ["seed", "commit"] {
            assert!(matches!(taken(key), Err(ExportError::KeyTaken { .. })), "{key}");
        }
    }

    proptest! {
        /// Any finite f32, subnormals and negative zero among them.
        #[test]
        fn golden_numbers_read_back_to_the_same_bits(values in proptest::collection::vec(
            proptest::num::f32::NORMAL | proptest::num::f32::SUBNORMAL | proptest::num::f32::ZERO, 1..20)) {
            let text = rows([values.as_slice()].into_iter());
            let back: Vec<u32> = text.split(',').map(|w| w.parse::<f32>().unwrap().to_bits()).collect();
            let bits: Vec<u32> = values.iter().map(|v| v.to_bits()).collect();
            prop_assert_eq!(back, bits);
        }
    }
}

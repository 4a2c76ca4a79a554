//! Metadata of a policy: ONNX `metadata_props`, all of them optional.
//!
//! | key | holds | if it is there |
//! | --- | --- | --- |
//! | `contract` | version of the observation contract, `1` | must be one that the caller knows |
//! | `rate_hz` | control rate, `50` | must be the contract's |
//! | `input_unit`, `output_unit` | one unit for all values, or one per value, comma-separated | must be the contract's; case, spaces, `_`, `-`, `(` and `)` do not count |
//! | `input_units`, `output_units` | one unit per value, comma-separated, where they differ | as above |
//! | `input_names`, `output_names` | comma-separated, in the order of the tensor | must be the contract's |
//! | `golden_input`, `golden_output` | pairs to reproduce: numbers parted by commas, pairs by semicolons | checked to 1e-4 |
//!
//! Golden numbers are decimals that read back to the same f32 (nine significant digits do). Other keys
//! (`name`, `rig_hash`, `seed`, `steps`, `variant`, ...) are kept and shown, not judged.

use tract_onnx::pb::ModelProto;

use crate::error::Fault;
use crate::golden_problem::GoldenProblem;
use crate::policy_signature::{Channel, PolicySignature};
use crate::wording::shown;

/// Golden pairs that are read; more only make loading slow.
const MOST_GOLDEN_PAIRS: usize = 256;

/// Meaning of a list in the metadata.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Told {
    /// One unit for all of them, or one for each.
    UnitOrUnits,
    /// A unit for each.
    Units,
    /// A name for each.
    Names,
}

/// Keys and values in the order of the file.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Metadata(Vec<(String, String)>);

/// An observation and the action that belongs to it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct GoldenPair {
    pub(crate) input: Vec<f32>,
    pub(crate) output: Vec<f32>,
}

impl Metadata {
    /// The value of a key.
    pub fn get(&self, key: &str) -> Option<&str> {
        self.iter().find(|(k, _)| *k == key).map(|(_, v)| v)
    }

    /// All keys and values in the order of the file.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &str)> {
        self.0.iter().map(|(k, v)| (k.as_str(), v.as_str()))
    }

    /// Reads them out of a model.
    ///
    /// # Errors
    /// [`Fault::MetadataTwice`].
    pub(crate) fn read(model: &ModelProto) -> Result<Self, Fault> {
        let mut seen = Self::default();
        for entry in &model.metadata_props {
            if seen.get(&entry.key).is_some() {
                return Err(Fault::MetadataTwice { key: shown(&entry.key) });
            }
            seen.0.push((entry.key.clone(), entry.value.clone()));
        }
        Ok(seen)
    }

    /// The contract version that the file names.
    ///
    /// # Errors
    /// [`Fault::ContractUnknown`] if none of `known` has it.
    pub(crate) fn contract<'c>(&self, known: &'c [PolicySignature]) -> Result<Option<&'c PolicySignature>, Fault> {
        let Some(text) = self.get("contract") else { return Ok(None) };
        let version = text.trim().parse::<u32>().ok();
        let found = known.iter().find(|c| Some(c.version) == version);
        found.map(Some).ok_or_else(|| Fault::ContractUnknown {
            found: shown(text),
            known: known.iter().map(|c| c.version).collect(),
        })
    }

    /// Compares rate, units and names with the contract.
    ///
    /// # Errors
    /// [`Fault::MetadataContradicts`].
    pub(crate) fn check(&self, contract: &PolicySignature) -> Result<(), Fault> {
        if let Some(text) = self.get("rate_hz") {
            // A rate is a small decimal; a thousandth is far below any that differ.
            let same = text.trim().parse::<f64>().is_ok_and(|r| (r - contract.rate_hz).abs() < 1e-3);
            if !same {
                return Err(contradicts("rate_hz", text, &contract.rate_hz.to_string(), contract));
            }
        }
        self.check_list("input_unit", contract, &contract.inputs, Told::UnitOrUnits)?;
        self.check_list("output_unit", contract, &contract.outputs, Told::UnitOrUnits)?;
        self.check_list("input_units", contract, &contract.inputs, Told::Units)?;
        self.check_list("output_units", contract, &contract.outputs, Told::Units)?;
        self.check_list("input_names", contract, &contract.inputs, Told::Names)?;
        self.check_list("output_names", contract, &contract.outputs, Told::Names)
    }

    fn check_list(
        &self,
        key: &'static str,
        contract: &PolicySignature,
        channels: &[Channel],
        told: Told,
    ) -> Result<(), Fault> {
        let Some(text) = self.get(key) else { return Ok(()) };
        let words: Vec<&str> = text.split(',').map(str::trim).collect();
        let one_for_all = told == Told::UnitOrUnits && words.len() == 1;
        if !one_for_all && words.len() != channels.len() {
            let found = format!("{} entries", words.len());
            return Err(contradicts(key, &found, &format!("{} entries", channels.len()), contract));
        }
        // One word stands for all values, and only where all have that unit.
        let words = words.iter().cycle();
        for (i, (channel, word)) in channels.iter().zip(words).enumerate() {
            let wanted = if told == Told::Names { &channel.name } else { &channel.unit };
            let same = if told == Told::Names { word == wanted } else { plain(word) == plain(wanted) };
            if !same {
                // The first value speaks for all where the contract has one unit.
                let for_all = one_for_all && i == 0;
                let at = |text: &str| if for_all { text.to_owned() } else { format!("{text} (value {i})") };
                return Err(contradicts(key, &at(&shown(word)), &at(wanted), contract));
            }
        }
        Ok(())
    }

    /// The golden pairs, none if the file has none.
    ///
    /// # Errors
    /// [`Fault::GoldenUnreadable`].
    pub(crate) fn golden(&self, contract: &PolicySignature) -> Result<Vec<GoldenPair>, Fault> {
        let rows = |key| self.get(key).map_or_else(Vec::new, |text| parted(text, ';'));
        let (inputs, outputs) = (rows("golden_input"), rows("golden_output"));
        let wrong =
            |pairs: usize, problem| Err(Fault::GoldenUnreadable { key: "golden_input", pair: pairs + 1, problem });
        let (given, answered) = (inputs.len(), outputs.len());
        if given != answered {
            return wrong(given.min(answered), GoldenProblem::Count { inputs: given, outputs: answered });
        }
        if given > MOST_GOLDEN_PAIRS {
            return wrong(MOST_GOLDEN_PAIRS, GoldenProblem::TooMany { found: given, most: MOST_GOLDEN_PAIRS });
        }
        let pairs = inputs.iter().zip(&outputs).enumerate();
        pairs
            .map(|(i, (input, output))| {
                Ok(GoldenPair {
                    input: numbers("golden_input", i + 1, input, contract.inputs.len())?,
                    output: numbers("golden_output", i + 1, output, contract.outputs.len())?,
                })
            })
            .collect()
    }
}

/// Parts of a text; a separator at the end starts no further part.
fn parted(text: &str, separator: char) -> Vec<&str> {
    let text = text.trim();
    let text = text.strip_suffix(separator).unwrap_or(text);
    if text.is_empty() { Vec::new() } else { text.split(separator).collect() }
}

fn numbers(key: &'static str, pair: usize, row: &str, expected: usize) -> Result<Vec<f32>, Fault> {
    let fault = |problem| Fault::GoldenUnreadable { key, pair, problem };
    let words = parted(row, ',');
    if words.len() != expected {
        return Err(fault(GoldenProblem::Width { found: words.len(), expected }));
    }
    let number = |word: &&str| match word.trim().parse::<f32>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(fault(GoldenProblem::Number { text: shown(word) })),
    };
    words.iter().map(number).collect()
}

/// A unit without what writers vary: `kPa (gauge)`, `kpa_gauge` and `kPa gauge` are one.
fn plain(unit: &str) -> String {
    let kept = unit.chars().filter(|c| !matches!(c, ' ' | '_' | '(' | ')' | '-'));
    kept.flat_map(char::to_lowercase).collect()
}

fn contradicts(key: &'static str, found: &str, expected: &str, contract: &PolicySignature) -> Fault {
    Fault::MetadataContradicts { key, found: shown(found), expected: expected.to_owned(), contract: contract.version }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn metadata(entries: &[(&str, &str)]) -> Metadata {
        Metadata(entries.iter().map(|(k, v)| (k.to_string(), v.to_string())).collect())
    }

    #[test]
    fn units_are_compared_by_meaning_not_by_spelling() {
        let contract = PolicySignature::pressures_to_duties(1, 2, 1);
        for unit in ["kPa gauge", "kpa_gauge", "KPA (gauge)", "kPa gauge, kPa gauge"] {
            metadata(&[("input_unit", unit)]).check(&contract).unwrap();
        }
        for unit in ["kPa", "Pa", "kPa absolute", "bar", "", "kPa gauge,kPa"] {
            let refused = metadata(&[("input_unit", unit)]).check(&contract);
            assert!(matches!(refused, Err(Fault::MetadataContradicts { .. })), "{unit}");
        }
    }

    /// A contract whose values differ in unit: one word cannot say it, a list must say it for every value.
    #[test]
    fn mixed_units_are_told_value_by_value() {
        let mut contract = PolicySignature::pressures_to_duties(2, 3, 1);
        contract.inputs[2].unit = "duty".into();
        for key in ["input_unit", "input_units"] {
            metadata(&[(key, "kPa gauge, kPa (gauge), duty")]).check(&contract).unwrap();
        }
        let refused = |key, text| match metadata(&[(key, text)]).check(&contract) {
            Err(Fault::MetadataContradicts { key: told, found, expected, .. }) => {
                assert_eq!(told, key);
                (found, expected)
            }
            other => panic!("{key} {text}: {other:?}"),
        };
        let said = |found: &str, expected: &str| (found.to_owned(), expected.to_owned());
        assert_eq!(refused("input_unit", "kPa gauge"), said("kPa gauge (value 2)", "duty (value 2)"));
        assert_eq!(refused("input_units", "kPa gauge"), said("1 entries", "3 entries"));
        assert_eq!(refused("input_units", "duty,kPa gauge,duty"), said("duty (value 0)", "kPa gauge (value 0)"));
        assert_eq!(refused("output_units", "V"), said("V (value 0)", "duty (value 0)"));
        metadata(&[("output_unit", "duty"), ("output_units", "duty")]).check(&contract).unwrap();
    }

    #[test]
    fn golden_pairs_are_numbers_in_rows() {
        let contract = PolicySignature::pressures_to_duties(1, 2, 1);
        let good = metadata(&[("golden_input", "1.5, -2;3e1,4;"), ("golden_output", "0.25; 1")]);
        let pairs = good.golden(&contract).unwrap();
        assert_eq!(pairs[0], GoldenPair { input: vec![1.5, -2.0], output: vec![0.25] });
        assert_eq!(pairs[1], GoldenPair { input: vec![30.0, 4.0], output: vec![1.0] });
        assert_eq!(metadata(&[]).golden(&contract).unwrap(), []);
        for (input, output) in [("1,2", ""), ("1", "1"), ("1,x", "1"), ("1,nan", "1"), ("1,2;3,4", "1"), ("1,2", "1,1")]
        {
            let bad = metadata(&[("golden_input", input), ("golden_output", output)]);
            let refused = bad.golden(&contract);
            assert!(matches!(refused, Err(Fault::GoldenUnreadable { .. })), "{input}/{output}");
        }
    }
}

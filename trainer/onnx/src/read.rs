//! A policy file read back: what this crate wrote, and nothing else.
//!
//! A run that was published as `policy.onnx` can be flown again by the trainer, in the very bits that were trained. Files that
//! others wrote are the `policy` crate's matter; here they are refused with a word.

use std::collections::BTreeMap;

use crate::card::{GoldenPair, check_golden};
use crate::error::{ExportError, ImportError};
use crate::network::{Dense, FeatureTerm, OutputMap, PolicyGraph};
use crate::protobuf::{Fields, Value};

/// A policy file as it was read back.
#[derive(Debug, Clone, PartialEq)]
pub struct Exported {
    /// The network.
    pub graph: PolicyGraph,
    /// Metadata of the file, by key ([`crate::card`]).
    pub metadata: BTreeMap<String, String>,
}

/// Reads the bytes of an ONNX file that [`crate::to_onnx`] made, and compares it with the golden pairs that it carries.
///
/// # Errors
/// [`ImportError`]: no ONNX, other operators or constants than this crate writes, or a network that does not answer as its
/// golden pairs say.
pub fn from_onnx(bytes: &[u8]) -> Result<Exported, ImportError> {
    let (mut graph, mut metadata) = (None, BTreeMap::new());
    for (field, value) in Fields::of(bytes)? {
        match (field, value) {
            (7, Value::Bytes(inside)) => graph = Some(inside),
            (14, Value::Bytes(inside)) => {
                metadata.insert(text(inside, 1)?, text(inside, 2)?);
            }
            _ => {}
        }
    }
    let graph = graph_of(graph.ok_or(ImportError::Foreign { what: "no graph".into() })?)?;
    graph.check().map_err(ImportError::Network)?;
    check_golden(&graph, &golden(&metadata)?).map_err(|error| match error {
        ExportError::GoldenDiffers { pair, .. } => ImportError::Answers { pair },
        other => ImportError::Network(other),
    })?;
    Ok(Exported { graph, metadata })
}

/// The network of a GraphProto: 1 node, 5 initializer.
fn graph_of(bytes: &[u8]) -> Result<PolicyGraph, ImportError> {
    let (mut operators, mut constants) = (Vec::new(), BTreeMap::new());
    for (field, value) in Fields::of(bytes)? {
        match (field, value) {
            // NodeProto: 4 op_type.
            (1, Value::Bytes(inside)) => operators.push(text(inside, 4)?),
            (5, Value::Bytes(inside)) => {
                let (name, tensor) = tensor(inside)?;
                constants.insert(name, tensor);
            }
            _ => {}
        }
    }
    let layers = operators.iter().filter(|operator| *operator == "Gemm").count();
    let expected: Vec<&str> = ["MatMul", "Sub", "Mul"]
        .into_iter()
        .chain((0..layers).flat_map(|layer| if layer == 0 { vec!["Gemm"] } else { vec!["Relu", "Gemm"] }))
        .chain(["Tanh", "Mul", "Add"])
        .collect();
    if operators != expected {
        return Err(ImportError::Foreign { what: format!("operators {}", operators.join(", ")) });
    }
    let mut take =
        |name: &str| constants.remove(name).ok_or_else(|| ImportError::Foreign { what: format!("no constant {name}") });
    let (picked, offsets, scales) = (take("pick")?, take("offset")?, take("scale")?);
    let mut dense = Vec::with_capacity(layers);
    for layer in 0..layers {
        let (weights, biases) = (take(&format!("weights_{layer}"))?, take(&format!("biases_{layer}"))?);
        let [inputs, outputs] = shape(&weights)?;
        dense.push(Dense { inputs, outputs, weights: weights.values, biases: biases.values });
    }
    let (half_ranges, middles) = (take("half_range")?, take("middle")?);
    Ok(PolicyGraph {
        inputs: shape(&picked)?[0],
        features: features(&picked, &offsets.values, &scales.values)?,
        layers: dense,
        outputs: half_ranges
            .values
            .iter()
            .zip(&middles.values)
            .map(|(scale, shift)| OutputMap { scale: *scale, shift: *shift })
            .collect(),
    })
}

/// Features that the columns of the picking matrix pick.
fn features(picked: &Tensor, offsets: &[f32], scales: &[f32]) -> Result<Vec<FeatureTerm>, ImportError> {
    let [inputs, features] = shape(picked)?;
    let place = |feature: usize, sign: f32| {
        (0..inputs).find(|input| picked.values.get(input * features + feature).is_some_and(|value| *value == sign))
    };
    (0..features)
        .map(|feature| {
            let (Some(plus), Some(offset), Some(scale)) =
                (place(feature, 1.0), offsets.get(feature), scales.get(feature))
            else {
                return Err(ImportError::Foreign { what: format!("feature {feature} picks nothing") });
            };
            Ok(FeatureTerm { plus, minus: place(feature, -1.0), offset: *offset, scale: *scale })
        })
        .collect()
}

/// A constant.
struct Tensor {
    shape: Vec<u64>,
    values: Vec<f32>,
}

/// TensorProto: 1 dims, 8 name, 9 raw_data.
fn tensor(bytes: &[u8]) -> Result<(String, Tensor), ImportError> {
    let (mut name, mut shape, mut raw): (_, _, &[u8]) = (String::new(), Vec::new(), &[]);
    for (field, value) in Fields::of(bytes)? {
        match (field, value) {
            (1, Value::Number(size)) => shape.push(size),
            (8, Value::Bytes(inside)) => name = utf8(inside)?,
            (9, Value::Bytes(inside)) => raw = inside,
            _ => {}
        }
    }
    let (values, rest) = raw.as_chunks::<4>();
    let expected = shape.iter().try_fold(1_u64, |product, size| product.checked_mul(*size));
    if !rest.is_empty() || expected != Some(values.len() as u64) {
        return Err(ImportError::Foreign { what: format!("constant {name} is not filled with float32") });
    }
    Ok((name, Tensor { shape, values: values.iter().map(|four| f32::from_le_bytes(*four)).collect() }))
}

/// Rows and columns; their product was found to be the number of values.
fn shape(tensor: &Tensor) -> Result<[usize; 2], ImportError> {
    match tensor.shape.as_slice() {
        [rows, columns] => Ok([*rows as usize, *columns as usize]),
        other => Err(ImportError::Foreign { what: format!("a matrix of {} dimensions", other.len()) }),
    }
}

/// The golden pairs of the metadata; none where there are none.
fn golden(metadata: &BTreeMap<String, String>) -> Result<Vec<GoldenPair>, ImportError> {
    let rows = |key: &str| -> Result<Vec<Vec<f32>>, ImportError> {
        let Some(text) = metadata.get(key) else { return Ok(Vec::new()) };
        let number = |word: &str| {
            word.parse().map_err(|_| ImportError::Foreign { what: format!("{key} holds {word:?}, which is no number") })
        };
        text.split(';').map(|row| row.split(',').map(number).collect()).collect()
    };
    let (inputs, outputs) = (rows("golden_input")?, rows("golden_output")?);
    if inputs.len() != outputs.len() {
        let (found, expected) = (outputs.len(), inputs.len());
        return Err(ImportError::Network(ExportError::RowLength { what: "golden_output", found, expected }));
    }
    Ok(inputs.into_iter().zip(outputs).map(|(input, output)| GoldenPair { input, output }).collect())
}

/// The text of a message's field; empty where it is not there.
fn text(bytes: &[u8], wanted: u64) -> Result<String, ImportError> {
    let mut found = String::new();
    for (field, value) in Fields::of(bytes)? {
        if let (true, Value::Bytes(inside)) = (field == wanted, value) {
            found = utf8(inside)?;
        }
    }
    Ok(found)
}

fn utf8(bytes: &[u8]) -> Result<String, ImportError> {
    std::str::from_utf8(bytes).map(str::to_owned).map_err(|_| ImportError::Damaged)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::card::Provenance;
    use crate::to_onnx;
    use model::observation::ObservationLayout;
    use model::ports::Ports;
    use proptest::prelude::*;

    fn graph(numbers: &[f32]) -> PolicyGraph {
        let mut next = numbers.iter().copied().cycle();
        let mut many = |count: usize| -> Vec<f32> { (&mut next).take(count).collect() };
        let features = (0..5)
            .map(|k| FeatureTerm {
                plus: 3 * k,
                minus: (k % 2 == 1).then_some(3 * k + 1),
                offset: many(1)[0],
                scale: 0.1,
            })
            .collect();
        let layers = [(5, 7), (7, 6), (6, 12)].map(|(inputs, outputs)| Dense {
            inputs,
            outputs,
            weights: many(inputs * outputs),
            biases: many(outputs),
        });
        let outputs = vec![OutputMap::onto(0.0, 1.0); 12];
        PolicyGraph { inputs: 84, features, layers: layers.to_vec(), outputs }
    }

    fn file(graph: &PolicyGraph) -> Vec<u8> {
        let input: Vec<f32> = (0..84).map(|k| k as f32).collect();
        let golden = [GoldenPair { output: graph.run(&input).unwrap(), input }];
        let provenance = Provenance { rig: "bench".into(), steps: 512_000, ..Provenance::default() };
        to_onnx(graph, &Ports::of(ObservationLayout::Paper), &provenance, &golden).unwrap()
    }

    proptest! {
        #[test]
        fn what_was_written_is_read_back(numbers in prop::collection::vec(-1.0_f32..1.0, 50)) {
            let graph = graph(&numbers);
            let read = from_onnx(&file(&graph)).unwrap();
            prop_assert_eq!(read.graph, graph);
            prop_assert_eq!(read.metadata["rig"].as_str(), "bench");
            prop_assert_eq!(read.metadata["steps"].as_str(), "512000");
        }

        /// No bytes make it panic, and a file cut short is no policy.
        #[test]
        fn what_is_cut_or_garbled_is_refused(cut in 0.0_f64..1.0, garbage in prop::collection::vec(any::<u8>(), 0..200)) {
            let whole = file(&graph(&[0.3, -0.2, 0.7]));
            let kept = (cut * whole.len() as f64) as usize;
            let read = from_onnx(&whole[..kept]);
            // Metadata stands last: without all of it a network may be whole, and then answers as it did.
            prop_assert!(read.is_err() || read.is_ok_and(|read| read.graph == graph(&[0.3, -0.2, 0.7])));
            let _ = from_onnx(&garbage);
        }
    }

    #[test]
    fn another_weight_than_was_compared_is_refused() {
        let graph = graph(&[0.5, -0.4]);
        let mut bytes = file(&graph);
        let half = 0.5_f32.to_le_bytes();
        // A bias of the last layer, which nothing rectifies; its name stands in the node and then with its values.
        let name = bytes.windows(8).rposition(|w| w == b"biases_2").unwrap();
        let at = bytes.iter().skip(name).zip(name..).find(|(_, k)| bytes[*k..].starts_with(&half)).unwrap().1;
        bytes[at..at + 4].copy_from_slice(&0.9_f32.to_le_bytes());
        let refused = from_onnx(&bytes).unwrap_err().to_string();
        assert!(refused.contains("golden pair 0"), "{refused}");
    }
}

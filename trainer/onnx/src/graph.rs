//! The network as ONNX operators (onnx.proto of ONNX 1.12, operators of opset 17).
//!
//! | nodes | compute |
//! | --- | --- |
//! | `MatMul` | picks each feature's observation, less the one taken off: a matrix of 0, 1 and −1 |
//! | `Sub`, `Mul` | offset and scale of each feature |
//! | `Gemm`, `Relu` | dense layers |
//! | `Tanh`, `Mul`, `Add` | the answers, mapped to their ranges |
//!
//! Products with 0, 1 and −1 are exact, so the picked difference is rounded once whatever order a runtime sums in. The
//! offset is a `Sub` because runtimes fuse an `Add` into the product before it, which would round otherwise.

use crate::card::{self, GoldenPair, Provenance};
use crate::error::ExportError;
use crate::network::{OutputMap, PolicyGraph};
use crate::protobuf::Message;
use crate::seal;
use model::ports::{Port, Ports};

/// Name of the input tensor.
pub const INPUT: &str = "observation";
/// Name of the output tensor.
pub const OUTPUT: &str = "action";

const OPSET: u64 = 17;
/// The file format's version that came with opset 17.
const IR_VERSION: u64 = 8;
/// `TensorProto.DataType.FLOAT`.
const FLOAT32: u64 = 1;
/// Amount by which an output may leave its range by rounding of the map, in the output's unit; the controller takes ten times this.
const RANGE_TOLERANCE: f32 = 1e-6;

/// Encodes a policy as the bytes of an ONNX file.
///
/// `ports` are those of the contract it was trained for, [`Ports::of`]. Every golden pair must be what the trainer's
/// own network answered; the graph is compared with it, to 1e-5, before anything is encoded.
///
/// # Errors
/// [`ExportError`]: sizes, places, values that are not finite, an output that can leave its range, a golden pair that
/// differs, a metadata key given twice.
pub fn to_onnx(
    graph: &PolicyGraph,
    ports: &Ports,
    provenance: &Provenance,
    golden: &[GoldenPair],
) -> Result<Vec<u8>, ExportError> {
    graph.check()?;
    fits("inputs", graph.inputs, &ports.inputs, ports)?;
    fits("outputs", graph.outputs.len(), &ports.outputs, ports)?;
    for (map, port) in graph.outputs.iter().zip(&ports.outputs) {
        in_range(*map, port, ports)?;
    }
    card::check_golden(graph, golden)?;
    let metadata = card::entries(ports, provenance, golden)?;
    // ModelProto: 1 ir_version, 2 producer_name, 3 producer_version, 7 graph, 8 opset_import, 14 metadata_props.
    let model = seal::promised()
        .number(1, IR_VERSION)
        .text(2, "trainer")
        .text(3, &provenance.trainer)
        .message(7, graph_proto(graph))
        .message(8, Message::default().text(1, "").number(2, OPSET))
        .each(metadata, |model, (key, value)| model.message(14, Message::default().text(1, &key).text(2, &value)));
    Ok(seal::sealed(model))
}

fn fits(side: &'static str, found: usize, expected: &[Port], ports: &Ports) -> Result<(), ExportError> {
    match expected.len() == found {
        true => Ok(()),
        false => Err(ExportError::Width { side, found, expected: expected.len(), contract: ports.contract }),
    }
}

fn in_range(map: OutputMap, port: &Port, ports: &Ports) -> Result<(), ExportError> {
    let (low, high) = (map.shift - map.scale.abs(), map.shift + map.scale.abs());
    if low >= port.low - RANGE_TOLERANCE && high <= port.high + RANGE_TOLERANCE {
        return Ok(());
    }
    let (lowest, highest) = (port.low, port.high);
    Err(ExportError::OutputRange { name: port.name.clone(), low, high, lowest, highest, contract: ports.contract })
}

/// GraphProto: 1 node, 2 name, 5 initializer, 11 input, 12 output.
fn graph_proto(graph: &PolicyGraph) -> Message {
    let features = graph.features.len();
    let mut chain = Chain { message: Message::default().text(2, "policy"), value: INPUT.to_owned() };
    let mut picked = vec![0.0; graph.inputs * features];
    for (k, term) in graph.features.iter().enumerate() {
        for (place, sign) in [(Some(term.plus), 1.0), (term.minus, -1.0)] {
            if let Some(weight) = place.and_then(|place| picked.get_mut(place * features + k)) {
                *weight += sign;
            }
        }
    }
    let offsets: Vec<f32> = graph.features.iter().map(|t| t.offset).collect();
    let scales: Vec<f32> = graph.features.iter().map(|t| t.scale).collect();
    chain.with("MatMul", "picked", &[("pick", &[graph.inputs, features], &picked)]);
    chain.with("Sub", "centred", &[("offset", &[features], &offsets)]);
    chain.with("Mul", "features", &[("scale", &[features], &scales)]);
    for (l, layer) in graph.layers.iter().enumerate() {
        if l > 0 {
            chain.with("Relu", &format!("rectified_{l}"), &[]);
        }
        let (weights, biases) = (format!("weights_{l}"), format!("biases_{l}"));
        chain.with(
            "Gemm",
            &format!("layer_{l}"),
            &[(&weights, &[layer.inputs, layer.outputs], &layer.weights), (&biases, &[layer.outputs], &layer.biases)],
        );
    }
    let outputs = graph.outputs.len();
    let half_ranges: Vec<f32> = graph.outputs.iter().map(|m| m.scale).collect();
    let middles: Vec<f32> = graph.outputs.iter().map(|m| m.shift).collect();
    chain.with("Tanh", "squashed", &[]);
    chain.with("Mul", "ranged", &[("half_range", &[outputs], &half_ranges)]);
    chain.with("Add", OUTPUT, &[("middle", &[outputs], &middles)]);
    chain.message.message(11, value_info(INPUT, graph.inputs)).message(12, value_info(OUTPUT, outputs))
}

/// A graph that grows node by node, each reading the value that the last one made.
struct Chain {
    message: Message,
    value: String,
}

impl Chain {
    /// Adds a node that makes `output` of the running value and of constants (name, shape, values in row-major order).
    fn with(&mut self, operator: &str, output: &str, constants: &[(&str, &[usize], &[f32])]) {
        // NodeProto: 1 input, 2 output, 3 name, 4 op_type.
        let node = Message::default()
            .text(1, &self.value)
            .each(constants, |node, (name, ..)| node.text(1, name))
            .text(2, output)
            .text(3, output)
            .text(4, operator);
        let message = std::mem::take(&mut self.message).message(1, node);
        self.message =
            message.each(constants, |graph, (name, shape, values)| graph.message(5, tensor(name, shape, values)));
        output.clone_into(&mut self.value);
    }
}

/// TensorProto: 1 dims, 2 data_type, 8 name, 9 raw_data (little-endian).
fn tensor(name: &str, shape: &[usize], values: &[f32]) -> Message {
    let raw: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    Message::default()
        .each(shape, |tensor, &size| tensor.number(1, size as u64))
        .number(2, FLOAT32)
        .text(8, name)
        .bytes(9, &raw)
}

/// ValueInfoProto of a float32 tensor `[batch, width]`: 1 name, 2 type; TypeProto: 1 tensor_type; its Tensor:
/// 1 elem_type, 2 shape; TensorShapeProto: 1 dim; Dimension: 1 dim_value, 2 dim_param.
fn value_info(name: &str, width: usize) -> Message {
    let sizes = [Message::default().text(2, "batch"), Message::default().number(1, width as u64)];
    let shape = Message::default().each(sizes, |shape, size| shape.message(1, size));
    let tensor = Message::default().number(1, FLOAT32).message(2, shape);
    Message::default().text(1, name).message(2, Message::default().message(1, tensor))
}

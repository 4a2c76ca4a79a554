//! Writes small ONNX files, sound and broken ones, from tract's protobuf structs.
// Each test file compiles this module for itself and uses part of it.
#![allow(dead_code, unused_imports, unreachable_pub, missing_docs)]

use std::path::PathBuf;

use policy::PolicySignature;
use prost::Message;
use tract_onnx::pb::{
    self, AttributeProto, GraphProto, ModelProto, NodeProto, OperatorSetIdProto, StringStringEntryProto, TensorProto,
    TensorShapeProto, TypeProto, ValueInfoProto, attribute_proto::AttributeType, tensor_proto::DataType,
    tensor_shape_proto::Dimension, tensor_shape_proto::dimension::Value as Size, type_proto,
};

/// A size in a port's shape.
#[derive(Clone, Copy)]
pub enum Dim {
    Fixed(i64),
    Named(&'static str),
}

/// The paper's contract: 84 pressures in, 12 duties out.
pub fn paper() -> Vec<PolicySignature> {
    vec![PolicySignature::pressures_to_duties(1, 84, 12)]
}

/// A graph under construction.
#[derive(Clone)]
pub struct Onnx(pub ModelProto);

impl Onnx {
    /// An empty graph with input `obs` of `[batch, inputs]` and output `action` of `[batch, outputs]`.
    pub fn new(inputs: i64, outputs: i64) -> Self {
        let graph = GraphProto {
            name: "policy".into(),
            input: vec![port("obs", DataType::Float, &[Dim::Named("batch"), Dim::Fixed(inputs)])],
            output: vec![port("action", DataType::Float, &[Dim::Named("batch"), Dim::Fixed(outputs)])],
            ..GraphProto::default()
        };
        Self(ModelProto {
            ir_version: 8,
            opset_import: vec![OperatorSetIdProto { domain: String::new(), version: 17 }],
            producer_name: "policy-tests".into(),
            graph: Some(graph),
            ..ModelProto::default()
        })
    }

    pub fn graph(&mut self) -> &mut GraphProto {
        self.0.graph.as_mut().unwrap()
    }

    pub fn node(&mut self, op: &str, inputs: &[&str], output: &str, attributes: Vec<AttributeProto>) -> &mut Self {
        self.graph().node.push(NodeProto {
            name: format!("{op}_{output}"),
            op_type: op.into(),
            input: inputs.iter().map(|s| s.to_string()).collect(),
            output: vec![output.into()],
            attribute: attributes,
            ..NodeProto::default()
        });
        self
    }

    pub fn weight(&mut self, name: &str, dims: &[i64], values: &[f32]) -> &mut Self {
        self.graph().initializer.push(TensorProto {
            name: name.into(),
            dims: dims.to_vec(),
            data_type: DataType::Float as i32,
            raw_data: values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            ..TensorProto::default()
        });
        self
    }

    pub fn shape(&mut self, name: &str, values: &[i64]) -> &mut Self {
        self.graph().initializer.push(TensorProto {
            name: name.into(),
            dims: vec![values.len() as i64],
            data_type: DataType::Int64 as i32,
            int64_data: values.to_vec(),
            ..TensorProto::default()
        });
        self
    }

    pub fn metadata(&mut self, key: &str, value: &str) -> &mut Self {
        self.0.metadata_props.push(StringStringEntryProto { key: key.into(), value: value.into() });
        self
    }

    pub fn bytes(&self) -> Vec<u8> {
        self.0.encode_to_vec()
    }

    /// Writes the file into this crate's own test folder.
    pub fn save(&self, name: &str) -> PathBuf {
        save(name, &self.bytes())
    }
}

pub fn save(name: &str, bytes: &[u8]) -> PathBuf {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

pub fn port(name: &str, data_type: DataType, dims: &[Dim]) -> ValueInfoProto {
    let size = |dim: &Dim| Dimension {
        value: Some(match dim {
            Dim::Fixed(n) => Size::DimValue(*n),
            Dim::Named(name) => Size::DimParam((*name).into()),
        }),
        ..Dimension::default()
    };
    let tensor = type_proto::Tensor {
        elem_type: data_type as i32,
        shape: Some(TensorShapeProto { dim: dims.iter().map(size).collect() }),
    };
    let r#type = TypeProto { value: Some(type_proto::Value::TensorType(tensor)), ..TypeProto::default() };
    ValueInfoProto { name: name.into(), r#type: Some(r#type), ..ValueInfoProto::default() }
}

pub fn float(name: &str, value: f32) -> AttributeProto {
    let r#type = AttributeType::Float as i32;
    AttributeProto { name: name.into(), r#type, f: value, ..AttributeProto::default() }
}

pub fn int(name: &str, value: i64) -> AttributeProto {
    let r#type = AttributeType::Int as i32;
    AttributeProto { name: name.into(), r#type, i: value, ..AttributeProto::default() }
}

pub fn ints(name: &str, values: &[i64]) -> AttributeProto {
    let r#type = AttributeType::Ints as i32;
    AttributeProto { name: name.into(), r#type, ints: values.to_vec(), ..AttributeProto::default() }
}

pub fn tensor(name: &str, tensor: TensorProto) -> AttributeProto {
    let r#type = AttributeType::Tensor as i32;
    AttributeProto { name: name.into(), r#type, t: Some(tensor), ..AttributeProto::default() }
}

/// Numbers in -1..1 from a linear congruential generator; the tests need no better.
pub struct Draw(pub u32);

impl Draw {
    pub fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (self.0 >> 8) as f32 / 8_388_608.0 - 1.0
    }

    pub fn many(&mut self, count: usize, scale: f32) -> Vec<f32> {
        (0..count).map(|_| scale * self.next()).collect()
    }
}

/// Weights of a network with one normalisation, `weights[layer][input * outputs + output]`.
pub struct Mlp {
    pub sizes: Vec<usize>,
    pub mean: Vec<f32>,
    pub deviation: Vec<f32>,
    pub weights: Vec<Vec<f32>>,
    pub biases: Vec<Vec<f32>>,
}

impl Mlp {
    /// Weights of the usual scale 1/sqrt(inputs), normalisation for gauge kPa.
    pub fn new(sizes: &[usize], seed: u32) -> Self {
        let mut draw = Draw(seed);
        let inputs = sizes[0];
        let layer = |draw: &mut Draw, pair: &[usize]| draw.many(pair[0] * pair[1], 1.7 / (pair[0] as f32).sqrt());
        Self {
            sizes: sizes.to_vec(),
            mean: (0..inputs).map(|i| if i % 2 == 0 { 60.0 } else { -40.0 }).collect(),
            deviation: (0..inputs).map(|i| 30.0 + 5.0 * draw.next() + i as f32 * 0.1).collect(),
            weights: sizes.windows(2).map(|pair| layer(&mut draw, pair)).collect(),
            biases: sizes.windows(2).map(|pair| draw.many(pair[1], 0.1)).collect(),
        }
    }

    /// The network in f64, layer by layer as written on paper.
    pub fn exact(&self, input: &[f32], hidden: fn(f64) -> f64, last: fn(f64) -> f64) -> Vec<f64> {
        let scaled = input.iter().zip(&self.mean).zip(&self.deviation);
        let mut x: Vec<f64> = scaled.map(|((x, m), d)| f64::from(x - m) / f64::from(*d)).collect();
        let count = self.weights.len();
        for (layer, (w, b)) in self.weights.iter().zip(&self.biases).enumerate() {
            let f = if layer + 1 == count { last } else { hidden };
            let n = b.len();
            x = (0..n)
                .map(|j| {
                    let sum: f64 = x.iter().enumerate().map(|(i, x)| x * f64::from(w[i * n + j])).sum();
                    f(sum + f64::from(b[j]))
                })
                .collect();
        }
        x
    }

    /// As torch exports `nn.Linear`: `Gemm` with `transB = 1`.
    pub fn torch(&self, hidden: &str, last: &str) -> Onnx {
        let mut onnx = self.start();
        let mut value = "scaled".to_owned();
        for layer in 0..self.weights.len() {
            let (inputs, outputs) = (self.sizes[layer], self.sizes[layer + 1]);
            let mut transposed = Vec::new();
            for j in 0..outputs {
                transposed.extend((0..inputs).map(|i| self.weights[layer][i * outputs + j]));
            }
            let (w, b, y) = (format!("l{layer}.weight"), format!("l{layer}.bias"), format!("y{layer}"));
            onnx.weight(&w, &[outputs as i64, inputs as i64], &transposed);
            onnx.weight(&b, &[outputs as i64], &self.biases[layer]);
            let attributes = vec![float("alpha", 1.0), float("beta", 1.0), int("transB", 1)];
            onnx.node("Gemm", &[&value, &w, &b], &y, attributes);
            value = self.activate(&mut onnx, layer, &y, hidden, last);
        }
        onnx
    }

    /// As `MatMul` and `Add`, the way some exporters write `x @ w + b`.
    pub fn matmul_add(&self, hidden: &str, last: &str) -> Onnx {
        let mut onnx = self.start();
        let mut value = "scaled".to_owned();
        for layer in 0..self.weights.len() {
            let (inputs, outputs) = (self.sizes[layer] as i64, self.sizes[layer + 1] as i64);
            let (w, b) = (format!("w{layer}"), format!("b{layer}"));
            let (product, y) = (format!("p{layer}"), format!("y{layer}"));
            onnx.weight(&w, &[inputs, outputs], &self.weights[layer]);
            onnx.weight(&b, &[outputs], &self.biases[layer]);
            onnx.node("MatMul", &[&value, &w], &product, vec![]);
            onnx.node("Add", &[&b, &product], &y, vec![]);
            value = self.activate(&mut onnx, layer, &y, hidden, last);
        }
        onnx
    }

    fn start(&self) -> Onnx {
        let (inputs, outputs) = (self.sizes[0] as i64, self.sizes[self.sizes.len() - 1] as i64);
        let mut onnx = Onnx::new(inputs, outputs);
        onnx.weight("mean", &[inputs], &self.mean).weight("deviation", &[1, inputs], &self.deviation);
        onnx.node("Sub", &["obs", "mean"], "centred", vec![]);
        onnx.node("Div", &["centred", "deviation"], "scaled", vec![]);
        onnx
    }

    fn activate(&self, onnx: &mut Onnx, layer: usize, y: &str, hidden: &str, last: &str) -> String {
        let end = layer + 1 == self.weights.len();
        let (op, name) = if end { (last, "action".into()) } else { (hidden, format!("h{layer}")) };
        if op == "Clip" {
            onnx.weight("low", &[], &[0.0]).weight("high", &[], &[1.0]);
            onnx.node(op, &[y, "low", "high"], &name, vec![]);
        } else {
            onnx.node(op, &[y], &name, vec![]);
        }
        name
    }
}

/// The usual test policy: 84-32-32-12 with Relu and Sigmoid, torch style.
pub fn sound() -> Onnx {
    Mlp::new(&[84, 32, 32, 12], 1).torch("Relu", "Sigmoid")
}

/// Observations over the physical range.
pub fn observation(draw: &mut Draw, inputs: usize) -> Vec<f32> {
    (0..inputs).map(|i| if i % 2 == 0 { 80.0 + 80.0 * draw.next() } else { -47.5 + 47.5 * draw.next() }).collect()
}

/// The node of this graph that makes `output`.
pub fn node_of<'a>(onnx: &'a mut Onnx, output: &str) -> &'a mut NodeProto {
    onnx.graph().node.iter_mut().find(|n| n.output[0] == output).unwrap()
}

/// The weight called `name`.
pub fn weight_of<'a>(onnx: &'a mut Onnx, name: &str) -> &'a mut TensorProto {
    onnx.graph().initializer.iter_mut().find(|t| t.name == name).unwrap()
}

pub use pb::tensor_proto;

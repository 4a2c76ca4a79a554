//! The graph as a chain of layers, or the reason why it is none.
//!
//! A policy's graph is a path: each node takes the running value and constants and makes the next
//! running value. What is folded at load: `MatMul` with the `Add` after it, `Gemm`'s `alpha`, `beta`,
//! `transA` (of one row, hence only at width 1) and `transB`, constant nodes, casts, transposes, roots, sums, differences,
//! products and quotients of constants, and the operators that change nothing at a batch of one (`Identity`, `Flatten` at axis
//! 1, `Reshape` to the same shape, `Cast` to float32).
//!
//! | operator | computes (ONNX standard, opsets 13 to 20) |
//! | --- | --- |
//! | Gemm | alpha A B + beta C, B or its transpose constant |
//! | MatMul | A B, B constant |
//! | Add, Sub, Mul, Div | with a constant on either side, one number or one per value |
//! | Sqrt | of a constant |
//! | Relu, LeakyRelu, Elu, Tanh, Sigmoid, Softplus, Clip | each value by itself |

use std::collections::{HashMap, HashSet};

use tract_onnx::pb::{NodeProto, tensor_proto::DataType};

use crate::activation::Activation;
use crate::constant::{Constant, Data, transposed};
use crate::error::Fault;
use crate::graph_signature::GraphSignature;
use crate::kernel::{Arithmetic, Dense, Layer};
use crate::node::Node;
use crate::wording::shown;

/// The operators that a policy may use.
pub const SUPPORTED_OPS: [&str; 20] = [
    "Add",
    "Cast",
    "Clip",
    "Constant",
    "Div",
    "Elu",
    "Flatten",
    "Gemm",
    "Identity",
    "LeakyRelu",
    "MatMul",
    "Mul",
    "Relu",
    "Reshape",
    "Sigmoid",
    "Softplus",
    "Sqrt",
    "Sub",
    "Tanh",
    "Transpose",
];

/// Operations a policy may need in a tick, about 0.1 ms; 84-256-256-12 needs 0.14 million.
const MOST_OPERATIONS: u64 = 2_000_000;
/// Cost of one activation, in multiply-adds of a dense layer: `benches/run.rs` measured 70 for tanh,
/// 150 for softplus, 1 for relu.
const ACTIVATION_OPERATIONS: u64 = 100;
/// Numbers that folded constants may hold together, twice what the largest file can.
const MOST_CONSTANTS: usize = 8 << 20;

/// Compiles the graph behind a signature.
///
/// # Errors
/// Every [`Fault`] about nodes and weights.
pub(crate) fn compile(signature: &GraphSignature) -> Result<Vec<Layer>, Fault> {
    let mut builder = Builder::new(signature)?;
    for node in &signature.graph.node {
        builder.take(node)?;
    }
    builder.finish(signature)
}

struct Builder<'a> {
    constants: HashMap<&'a str, Constant>,
    /// Running values that exist; only `current` may still be read.
    running: HashSet<&'a str>,
    current: &'a str,
    width: usize,
    layers: Vec<Layer>,
    /// The last layer is a `MatMul`, whose bias may still come.
    open_matmul: bool,
    operations: u64,
}

impl<'a> Builder<'a> {
    fn new(signature: &GraphSignature<'a>) -> Result<Self, Fault> {
        let mut builder = Self {
            constants: HashMap::new(),
            running: HashSet::from([signature.input]),
            current: signature.input,
            width: signature.inputs,
            layers: Vec::new(),
            open_matmul: false,
            operations: 0,
        };
        for tensor in &signature.graph.initializer {
            builder.define(&tensor.name, Constant::decode(tensor)?)?;
        }
        Ok(builder)
    }

    fn define(&mut self, name: &'a str, constant: Constant) -> Result<(), Fault> {
        let held: usize = self.constants.values().map(Constant::len).sum();
        let found = held + constant.len();
        if found > MOST_CONSTANTS {
            return Err(Fault::TooMany { what: "numbers", found, limit: MOST_CONSTANTS });
        }
        let twice = self.running.contains(name) || self.constants.insert(name, constant).is_some();
        if twice { Err(Fault::DuplicateValue { value: shown(name) }) } else { Ok(()) }
    }

    /// Takes the next node in topological order.
    fn take(&mut self, proto: &'a NodeProto) -> Result<(), Fault> {
        let node = Node::new(proto);
        node.check_op(&SUPPORTED_OPS)?;
        let result = node.single_output()?;
        let mut live = Vec::new();
        for (place, value) in node.inputs().iter().enumerate() {
            if self.running.contains(value.as_str()) {
                live.push((place, value.as_str()));
            } else if !value.is_empty() && !self.constants.contains_key(value.as_str()) {
                return Err(node.unknown(value));
            }
        }
        match live.as_slice() {
            [] => {
                let constant = self.fold(&node)?;
                self.define(result, constant)
            }
            [(_, value)] if *value != self.current => {
                Err(node.not_a_chain("reads a value that another node has already taken"))
            }
            [(place, _)] => {
                self.layer(&node, *place)?;
                if self.constants.contains_key(result) || !self.running.insert(result) {
                    return Err(Fault::DuplicateValue { value: shown(result) });
                }
                self.current = result;
                Ok(())
            }
            _ => Err(node.not_a_chain("joins two running values")),
        }
    }

    /// A node that reads constants alone.
    fn fold(&self, node: &Node<'a>) -> Result<Constant, Fault> {
        match node.op() {
            "Constant" => node.constant(),
            "Identity" => {
                node.allow(&[])?;
                Ok(self.constant(node, 0)?.clone())
            }
            "Cast" => {
                check_cast(node)?;
                self.constant(node, 0)?.cast_f32(node.input(0))
            }
            "Transpose" => self.transpose(node),
            "Add" => self.combine(node, |a, b| a + b),
            "Sub" => self.combine(node, |a, b| a - b),
            "Mul" => self.combine(node, |a, b| a * b),
            "Div" => self.combine(node, |a, b| a / b),
            "Sqrt" => {
                node.allow(&[])?;
                self.constant(node, 0)?.rooted(node.input(0))
            }
            _ => Err(node.not_a_chain("does not read the running value")),
        }
    }

    /// An operation on two constants, such as the `std + eps` of a normalisation.
    fn combine(&self, node: &Node<'a>, operation: impl Fn(f32, f32) -> f32) -> Result<Constant, Fault> {
        node.allow(&[])?;
        if node.inputs().len() != 2 {
            return Err(node.arity("inputs", node.inputs().len()));
        }
        let (left, right) = (self.constant(node, 0)?, self.constant(node, 1)?);
        let combined = left.combined([node.input(0), node.input(1)], right, operation)?;
        combined.ok_or_else(|| {
            self.sizes(node, right, "two constants are combined where both have one shape or one of them is one number")
        })
    }

    fn transpose(&self, node: &Node<'a>) -> Result<Constant, Fault> {
        node.allow(&["perm"])?;
        let constant = self.constant(node, 0)?;
        let reverses = node.ints("perm")?.is_none_or(|perm| perm == [1, 0]);
        match constant.transposed() {
            Some(transposed) if reverses => Ok(transposed),
            _ => Err(self.sizes(node, constant, "only a float32 matrix can be transposed")),
        }
    }

    /// A node that reads the running value at input `place`.
    fn layer(&mut self, node: &Node<'a>, place: usize) -> Result<(), Fault> {
        let open_matmul = std::mem::take(&mut self.open_matmul);
        match node.op() {
            "Gemm" => self.gemm(node, place),
            "MatMul" => self.matmul(node, place),
            "Add" if open_matmul => self.bias(node, place),
            "Add" => self.arithmetic(node, place, Arithmetic::Add, Arithmetic::Add),
            "Sub" => self.arithmetic(node, place, Arithmetic::Subtract, Arithmetic::SubtractFrom),
            "Mul" => self.arithmetic(node, place, Arithmetic::Multiply, Arithmetic::Multiply),
            "Div" => self.arithmetic(node, place, Arithmetic::Divide, Arithmetic::DivideInto),
            "Relu" => self.activation(node, &[], Activation::Relu),
            "Tanh" => self.activation(node, &[], Activation::Tanh),
            "Sigmoid" => self.activation(node, &[], Activation::Sigmoid),
            "Softplus" => self.activation(node, &[], Activation::Softplus),
            "LeakyRelu" => {
                let slope = node.float("alpha", 0.01)?;
                self.activation(node, &["alpha"], Activation::LeakyRelu { slope })
            }
            "Elu" => {
                let alpha = node.float("alpha", 1.0)?;
                self.activation(node, &["alpha"], Activation::Elu { alpha })
            }
            "Clip" => self.clip(node, place),
            "Identity" => unchanged(node, 1).and_then(|()| node.allow(&[])),
            "Cast" => unchanged(node, 1).and_then(|()| check_cast(node)),
            "Flatten" => unchanged(node, 1).and_then(|()| check_flatten(node)),
            "Reshape" => self.reshape(node, place),
            "Transpose" => Err(node.not_a_chain("turns the running value into a column")),
            "Sqrt" => Err(node.not_a_chain("takes the root of the running value")),
            // `check_op` lets nothing else through; a `Constant` reads no running value.
            _ => Err(node.arity("inputs", node.inputs().len())),
        }
    }

    fn constant(&self, node: &Node<'a>, place: usize) -> Result<&Constant, Fault> {
        match node.inputs().get(place) {
            Some(name) => self.constants.get(name.as_str()).ok_or_else(|| node.unknown(name)),
            None => Err(node.arity("inputs", node.inputs().len())),
        }
    }

    fn gemm(&mut self, node: &Node<'a>, place: usize) -> Result<(), Fault> {
        node.allow(&["alpha", "beta", "transA", "transB"])?;
        let count = node.inputs().len();
        if place != 0 || !(2..=3).contains(&count) {
            return Err(node.misplaced(place, count));
        }
        if node.flag("transA")? && self.width != 1 {
            return Err(
                node.attribute_fault("transA", "of 1 turns the observation into a column; export with transA=0")
            );
        }
        let (alpha, beta) = (node.float("alpha", 1.0)?, node.float("beta", 1.0)?);
        let (mut weights, outputs) = self.matrix(node, node.flag("transB")?)?;
        if alpha != 1.0 {
            weights.iter_mut().for_each(|w| *w *= alpha);
        }
        let mut bias = match node.inputs().get(2) {
            Some(name) if !name.is_empty() => self.spread(node, 2, outputs)?,
            _ => vec![0.0; outputs],
        };
        if beta != 1.0 {
            bias.iter_mut().for_each(|b| *b *= beta);
        }
        self.dense(Dense::new(self.width, outputs, &weights, &bias), outputs);
        Ok(())
    }

    fn matmul(&mut self, node: &Node<'a>, place: usize) -> Result<(), Fault> {
        node.allow(&[])?;
        let count = node.inputs().len();
        if place != 0 || count != 2 {
            return Err(node.misplaced(place, count));
        }
        let (weights, outputs) = self.matrix(node, false)?;
        self.dense(Dense::new(self.width, outputs, &weights, &vec![0.0; outputs]), outputs);
        self.open_matmul = true;
        Ok(())
    }

    /// The weights at input 1 as `[input * outputs + output]`, and the number of outputs.
    fn matrix(&self, node: &Node<'a>, transpose: bool) -> Result<(Vec<f32>, usize), Fault> {
        let constant = self.constant(node, 1)?;
        let values = constant.f32s(node.input(1))?;
        match (constant.dims.as_slice(), transpose) {
            (&[inputs, outputs], false) if inputs == self.width && outputs > 0 => Ok((values.to_vec(), outputs)),
            (&[outputs, inputs], true) if inputs == self.width && outputs > 0 => {
                Ok((transposed(values, outputs, inputs), outputs))
            }
            (_, false) => Err(self.sizes(node, constant, "its rows must be as many as the values")),
            (_, true) => Err(self.sizes(node, constant, "its columns must be as many as the values")),
        }
    }

    fn dense(&mut self, dense: Dense, outputs: usize) {
        self.operations += self.width as u64 * outputs as u64;
        self.width = outputs;
        self.layers.push(Layer::Dense(dense));
    }

    /// The `Add` after a `MatMul`.
    fn bias(&mut self, node: &Node<'a>, place: usize) -> Result<(), Fault> {
        let bias = self.operand(node, place)?;
        if let Some(Layer::Dense(dense)) = self.layers.last_mut() {
            dense.add_bias(&bias);
        }
        Ok(())
    }

    fn arithmetic(&mut self, node: &Node<'a>, place: usize, right: Arithmetic, left: Arithmetic) -> Result<(), Fault> {
        let constant = self.operand(node, place)?;
        let arithmetic = if place == 0 { right } else { left };
        let zero = constant.iter().position(|&c| c == 0.0);
        if let (Arithmetic::Divide, Some(index)) = (arithmetic, zero) {
            return Err(Fault::DivisionByZero { node: node.name(), index });
        }
        self.operations += 4 * self.width as u64;
        self.layers.push(Layer::Constant(arithmetic, constant.into()));
        Ok(())
    }

    /// The constant of a two-sided operator whose running value is at `place`.
    fn operand(&self, node: &Node<'a>, place: usize) -> Result<Vec<f32>, Fault> {
        node.allow(&[])?;
        if node.inputs().len() != 2 {
            return Err(node.arity("inputs", node.inputs().len()));
        }
        self.spread(node, 1 - place, self.width)
    }

    /// A constant broadcast to `[1, width]`.
    fn spread(&self, node: &Node<'a>, place: usize, width: usize) -> Result<Vec<f32>, Fault> {
        let constant = self.constant(node, place)?;
        let values = constant.f32s(node.input(place))?;
        match (constant.dims.as_slice(), values) {
            ([] | [1] | [1, 1], &[value]) => Ok(vec![value; width]),
            (&[n] | &[1, n], _) if n == width => Ok(values.to_vec()),
            _ => Err(Fault::Sizes {
                node: node.name(),
                op: node.op().to_owned(),
                width,
                dims: constant.dims.iter().copied().take(8).collect(),
                mend: "it must hold one number or one per value",
            }),
        }
    }

    fn activation(&mut self, node: &Node<'a>, attributes: &[&str], activation: Activation) -> Result<(), Fault> {
        node.allow(attributes)?;
        unchanged(node, 1)?;
        self.operations += ACTIVATION_OPERATIONS * self.width as u64;
        self.layers.push(Layer::Activation(activation));
        Ok(())
    }

    fn clip(&mut self, node: &Node<'a>, place: usize) -> Result<(), Fault> {
        node.allow(&[])?;
        let count = node.inputs().len();
        if place != 0 || count > 3 {
            return Err(node.misplaced(place, count));
        }
        let bound = |place: usize, open: f32| -> Result<f32, Fault> {
            match node.inputs().get(place) {
                Some(name) if !name.is_empty() => Ok(self.spread(node, place, 1)?[0]),
                _ => Ok(open),
            }
        };
        let (low, high) = (bound(1, f32::NEG_INFINITY)?, bound(2, f32::INFINITY)?);
        if low > high {
            return Err(Fault::ClipBounds { node: node.name(), low, high });
        }
        self.operations += self.width as u64;
        self.layers.push(Layer::Activation(Activation::Clip { low, high }));
        Ok(())
    }

    /// A reshape of `[1, width]` to itself.
    fn reshape(&self, node: &Node<'a>, place: usize) -> Result<(), Fault> {
        node.allow(&["allowzero"])?;
        if place != 0 || node.inputs().len() != 2 {
            return Err(node.misplaced(place, node.inputs().len()));
        }
        let constant = self.constant(node, 1)?;
        let width = self.width as i64;
        let copies = !node.flag("allowzero")?;
        let same = match &constant.data {
            Data::I64(shape) => match *shape.as_slice() {
                [0, n] => copies && (n == width || n == -1 || n == 0),
                [1, 0] | [-1, 0] => copies,
                [1, n] => n == width || n == -1,
                [-1, n] => n == width,
                _ => false,
            },
            _ => false,
        };
        if same {
            Ok(())
        } else {
            Err(self.sizes(node, constant, "only a reshape to the shape it already has is taken"))
        }
    }

    fn sizes(&self, node: &Node<'a>, constant: &Constant, mend: &'static str) -> Fault {
        Fault::Sizes {
            node: node.name(),
            op: node.op().to_owned(),
            width: self.width,
            dims: constant.dims.iter().copied().take(8).collect(),
            mend,
        }
    }

    fn finish(self, signature: &GraphSignature) -> Result<Vec<Layer>, Fault> {
        let name = || shown(signature.output);
        if self.current != signature.output {
            return Err(Fault::OutputNotLast { name: name(), last: shown(self.current) });
        }
        if self.width != signature.outputs {
            let (declared, computed) = (signature.outputs, self.width);
            return Err(Fault::OutputDeclaration { name: name(), declared, computed });
        }
        if self.operations > MOST_OPERATIONS {
            let (operations, limit) = (self.operations, MOST_OPERATIONS);
            return Err(Fault::TooSlow { operations, limit });
        }
        Ok(self.layers)
    }
}

fn unchanged(node: &Node, inputs: usize) -> Result<(), Fault> {
    let found = node.inputs().len();
    if found == inputs { Ok(()) } else { Err(node.arity("inputs", found)) }
}

fn check_cast(node: &Node) -> Result<(), Fault> {
    node.allow(&["to", "saturate"])?;
    if node.int("to", 0)? == DataType::Float as i64 {
        Ok(())
    } else {
        Err(node.attribute_fault("to", "that is not float32; export the whole network in float32"))
    }
}

fn check_flatten(node: &Node) -> Result<(), Fault> {
    node.allow(&["axis"])?;
    // Axis 1 of [1, n] keeps it; so does -1 (counted from the end) and 0 at a batch of one.
    if matches!(node.int("axis", 1)?, 1 | -1) {
        Ok(())
    } else {
        Err(node.attribute_fault("axis", "other than 1; flatten after the batch axis"))
    }
}

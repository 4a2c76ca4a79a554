//! One node of the graph: its attributes, strictly read, and the faults that name it.

use tract_onnx::pb::{AttributeProto, NodeProto, attribute_proto::AttributeType};

use crate::constant::{Constant, Data};
use crate::error::Fault;
use crate::wording::shown;

/// A node with strict access to what it says.
pub(crate) struct Node<'a> {
    proto: &'a NodeProto,
    /// Inputs without the empty names at the end, which mean "left out".
    inputs: &'a [String],
}

impl<'a> Node<'a> {
    pub(crate) fn new(proto: &'a NodeProto) -> Self {
        let given = proto.input.iter().rposition(|name| !name.is_empty()).map_or(0, |last| last + 1);
        Self { proto, inputs: &proto.input[..given] }
    }

    pub(crate) fn op(&self) -> &'a str {
        &self.proto.op_type
    }

    pub(crate) fn inputs(&self) -> &'a [String] {
        self.inputs
    }

    /// The name at input `place`, empty if left out.
    pub(crate) fn input(&self, place: usize) -> &'a str {
        self.inputs.get(place).map_or("", String::as_str)
    }

    /// The node's name, or its output's where it has none.
    pub(crate) fn name(&self) -> String {
        let named = !self.proto.name.is_empty();
        shown(if named { &self.proto.name } else { self.proto.output.first().map_or("", |o| o) })
    }

    pub(crate) fn check_op(&self, supported: &[&str]) -> Result<(), Fault> {
        let domain = self.proto.domain.as_str();
        let standard = domain.is_empty() || domain == "ai.onnx";
        if standard && supported.contains(&self.op()) {
            return Ok(());
        }
        let op = if standard { self.op().to_owned() } else { format!("{domain}.{}", self.op()) };
        Err(Fault::UnsupportedOp { node: self.name(), op: shown(&op).escape_debug().to_string() })
    }

    pub(crate) fn single_output(&self) -> Result<&'a str, Fault> {
        let mut names = self.proto.output.iter().filter(|name| !name.is_empty());
        match (names.next(), names.count()) {
            (Some(name), 0) => Ok(name),
            _ => Err(self.arity("outputs", self.proto.output.len())),
        }
    }

    /// Refuses every attribute but those named.
    pub(crate) fn allow(&self, names: &[&str]) -> Result<(), Fault> {
        for attribute in &self.proto.attribute {
            if !names.contains(&attribute.name.as_str()) {
                return Err(self.attribute_fault(
                    &attribute.name,
                    "which this operator does not have in opsets 13 to 20; export it again with opset 17",
                ));
            }
            if !attribute.ref_attr_name.is_empty() {
                return Err(
                    self.attribute_fault(&attribute.name, "that refers to a function; export without functions")
                );
            }
        }
        Ok(())
    }

    /// A finite float attribute.
    pub(crate) fn float(&self, name: &str, default: f32) -> Result<f32, Fault> {
        match self.attribute(name, AttributeType::Float)? {
            None => Ok(default),
            Some(attribute) if attribute.f.is_finite() => Ok(attribute.f),
            Some(_) => Err(self.attribute_fault(name, "that is not finite; export it again")),
        }
    }

    /// An integer attribute.
    pub(crate) fn int(&self, name: &str, default: i64) -> Result<i64, Fault> {
        Ok(self.attribute(name, AttributeType::Int)?.map_or(default, |attribute| attribute.i))
    }

    /// A list of integers.
    pub(crate) fn ints(&self, name: &str) -> Result<Option<&'a [i64]>, Fault> {
        Ok(self.attribute(name, AttributeType::Ints)?.map(|attribute| attribute.ints.as_slice()))
    }

    /// An integer attribute that is 0 (also if left out) or 1.
    pub(crate) fn flag(&self, name: &str) -> Result<bool, Fault> {
        match self.int(name, 0)? {
            0 => Ok(false),
            1 => Ok(true),
            _ => Err(self.attribute_fault(name, "that is neither 0 nor 1; export it again")),
        }
    }

    /// Value that a `Constant` node holds.
    pub(crate) fn constant(&self) -> Result<Constant, Fault> {
        let [attribute] = self.proto.attribute.as_slice() else {
            return Err(self.attribute_fault("value", "not exactly once; export it again"));
        };
        let name = self.proto.output.first().map_or("", String::as_str);
        let scalar = |data| Constant::from_attribute(vec![], data, name);
        match (attribute.name.as_str(), &attribute.t) {
            ("value", Some(tensor)) => Constant::decode(tensor),
            ("value_float", _) => scalar(Data::F32(vec![attribute.f])),
            ("value_int", _) => scalar(Data::I64(vec![attribute.i])),
            ("value_floats", _) => {
                let values = attribute.floats.clone();
                Constant::from_attribute(vec![values.len()], Data::F32(values), name)
            }
            ("value_ints", _) => {
                let values = attribute.ints.clone();
                Constant::from_attribute(vec![values.len()], Data::I64(values), name)
            }
            _ => {
                Err(self
                    .attribute_fault(&attribute.name, "which makes no dense number; export weights as float32 tensors"))
            }
        }
    }

    fn attribute(&self, name: &str, kind: AttributeType) -> Result<Option<&'a AttributeProto>, Fault> {
        match self.proto.attribute.iter().find(|a| a.name == name) {
            None => Ok(None),
            Some(attribute) if attribute.r#type == kind as i32 => Ok(Some(attribute)),
            Some(_) => Err(self.attribute_fault(name, "of the wrong type; export it again")),
        }
    }

    pub(crate) fn attribute_fault(&self, attribute: &str, problem: &'static str) -> Fault {
        let (node, op) = self.named();
        Fault::Attribute { node, op, attribute: shown(attribute), problem }
    }

    pub(crate) fn not_a_chain(&self, how: &'static str) -> Fault {
        let (node, op) = self.named();
        Fault::NotAChain { node, op, how }
    }

    pub(crate) fn unknown(&self, value: &str) -> Fault {
        let (node, op) = self.named();
        Fault::UnknownValue { node, op, value: shown(value) }
    }

    pub(crate) fn arity(&self, side: &'static str, found: usize) -> Fault {
        let (node, op) = self.named();
        Fault::Arity { node, op, side, found }
    }

    /// The running value stands where a constant belongs, or the number of inputs is wrong.
    pub(crate) fn misplaced(&self, place: usize, count: usize) -> Fault {
        if place == 0 {
            self.arity("inputs", count)
        } else {
            self.not_a_chain("reads the running value where a constant belongs")
        }
    }

    fn named(&self) -> (String, String) {
        (self.name(), shown(self.op()).escape_debug().to_string())
    }
}

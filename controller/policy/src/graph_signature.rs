//! The outside of a graph: opset, the one input, the one output, their types and shapes.

use std::collections::HashSet;

use tract_onnx::pb::{
    GraphProto, ModelProto, ValueInfoProto, tensor_proto::DataType, tensor_shape_proto::dimension::Value as Size,
    type_proto::Value as Type,
};

use crate::constant::type_name;
use crate::error::Fault;
use crate::policy_signature::PolicySignature;
use crate::wording::shown;

/// Lowest opset whose operators mean what the kernel computes.
const OPSET_LOWEST: i64 = 13;
/// Highest opset that was checked for the same.
const OPSET_HIGHEST: i64 = 20;
/// Nodes or initialisers that a graph may have: a hundred layers need a tenth of it.
const MOST_PARTS: usize = 1024;

/// Names and widths of the input and the output.
#[derive(Debug)]
pub(crate) struct GraphSignature<'a> {
    pub(crate) graph: &'a GraphProto,
    pub(crate) input: &'a str,
    pub(crate) inputs: usize,
    pub(crate) output: &'a str,
    pub(crate) outputs: usize,
    pub(crate) opset: i64,
}

/// Reads the signature; `contract` gives the widths that messages ask for.
///
/// # Errors
/// The [`Fault`]s about graph, opset, inputs and outputs, without their widths.
pub(crate) fn read<'a>(model: &'a ModelProto, contract: &PolicySignature) -> Result<GraphSignature<'a>, Fault> {
    let graph = model.graph.as_ref().ok_or(Fault::NoGraph)?;
    let standard = |domain: &str| domain.is_empty() || domain == "ai.onnx";
    let opset = model.opset_import.iter().find(|o| standard(&o.domain)).map_or(0, |o| o.version);
    if !(OPSET_LOWEST..=OPSET_HIGHEST).contains(&opset) {
        return Err(Fault::Opset { found: opset });
    }
    let parts = [("nodes", graph.node.len()), ("weights", graph.initializer.len())];
    for (what, found) in parts {
        if found > MOST_PARTS {
            return Err(Fault::TooMany { what, found, limit: MOST_PARTS });
        }
    }
    if !graph.sparse_initializer.is_empty() {
        return Err(Fault::SparseWeights);
    }
    // Older exporters list the weights among the inputs; those are no inputs.
    let weights: HashSet<&str> = graph.initializer.iter().map(|t| t.name.as_str()).collect();
    let real: Vec<&ValueInfoProto> = graph.input.iter().filter(|i| !weights.contains(i.name.as_str())).collect();
    let names = |ports: &[&ValueInfoProto]| ports.iter().map(|p| shown(&p.name)).collect();
    let &[input] = real.as_slice() else {
        return Err(Fault::InputCount { found: names(&real) });
    };
    let outputs: Vec<&ValueInfoProto> = graph.output.iter().collect();
    let &[output] = outputs.as_slice() else {
        return Err(Fault::OutputCount { found: names(&outputs) });
    };
    Ok(GraphSignature {
        graph,
        input: &input.name,
        inputs: width("input", input, contract.inputs.len())?,
        output: &output.name,
        outputs: width("output", output, contract.outputs.len())?,
        opset,
    })
}

impl GraphSignature<'_> {
    /// Compares both widths with the contract's.
    ///
    /// # Errors
    /// [`Fault::InputWidth`], [`Fault::OutputWidth`].
    pub(crate) fn check_widths(&self, contract: &PolicySignature) -> Result<(), Fault> {
        let (found, expected) = (self.inputs, contract.inputs.len());
        let contract_version = contract.version;
        if found != expected {
            let name = shown(self.input);
            return Err(Fault::InputWidth { name, found, expected, contract: contract_version });
        }
        let (found, expected) = (self.outputs, contract.outputs.len());
        if found != expected {
            let name = shown(self.output);
            return Err(Fault::OutputWidth { name, found, expected, contract: contract_version });
        }
        Ok(())
    }
}

/// The fixed width of a float32 port `[1 or any, width]`.
fn width(port: &'static str, info: &ValueInfoProto, expected: usize) -> Result<usize, Fault> {
    let name = || shown(&info.name);
    let tensor = info.r#type.as_ref().and_then(|t| t.value.as_ref()).map(|Type::TensorType(t)| t);
    let Some(tensor) = tensor else {
        return Err(Fault::PortType { port, name: name(), found: "no tensor" });
    };
    if tensor.elem_type != DataType::Float as i32 {
        let found = type_name(tensor.elem_type);
        return Err(Fault::PortType { port, name: name(), found });
    }
    let sizes: Option<Vec<Option<&Size>>> =
        tensor.shape.as_ref().map(|s| s.dim.iter().map(|d| d.value.as_ref()).collect());
    // An exporter that does not know the batch writes a name, nothing, or -1.
    let any = |size: &Option<&Size>| match size {
        None | Some(Size::DimParam(_)) => true,
        Some(Size::DimValue(n)) => *n == 1 || *n == -1,
    };
    match sizes.as_deref() {
        Some([batch, Some(Size::DimValue(n))]) if any(batch) && *n > 0 => Ok(*n as usize),
        _ => {
            let found = sizes.as_deref().map_or_else(|| "that is not given".into(), spelled);
            Err(Fault::PortShape { port, name: name(), found, expected })
        }
    }
}

/// A shape as text, `[batch, 84]`.
fn spelled(sizes: &[Option<&Size>]) -> String {
    let mut words: Vec<String> = sizes
        .iter()
        .take(8)
        .map(|size| match size {
            None => "?".to_owned(),
            Some(Size::DimValue(n)) => n.to_string(),
            Some(Size::DimParam(name)) => shown(name).escape_debug().to_string(),
        })
        .collect();
    if sizes.len() > words.len() {
        words.push("...".to_owned());
    }
    format!("[{}]", words.join(", "))
}

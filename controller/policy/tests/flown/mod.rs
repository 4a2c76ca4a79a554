//! The contracts that the daemon flies, with the names, units and ranges that the trainer's export writes.
// Each test file compiles this module for itself and uses part of it.
#![allow(dead_code, unreachable_pub, missing_docs)]

use onnx_file::{Port, Ports};
use policy::{Channel, PolicySignature};

pub fn contract(ports: &Ports) -> PolicySignature {
    let channel =
        |port: &Port| Channel { name: port.name.clone(), unit: port.unit.to_owned(), low: port.low, high: port.high };
    PolicySignature {
        version: ports.contract,
        rate_hz: ports.rate_hz,
        inputs: ports.inputs.iter().map(channel).collect(),
        outputs: ports.outputs.iter().map(channel).collect(),
    }
}

/// Both, the paper's first.
pub fn contracts() -> Vec<PolicySignature> {
    use model::observation::ObservationLayout::{Correction, Paper};
    [Paper, Correction].map(|c| contract(&Ports::of(c))).into()
}

//! tract as an independent second opinion on what a policy computes.
//!
//! tract gets the protobuf as it stands in the file, less the shapes of inner values (which it could
//! only trip over); it decodes, folds and multiplies with its own code. Optimising costs it some
//! milliseconds and makes a probe a hundred times cheaper.
//!
//! tract works on a thread of its own that ends with the load. Its kernels return with the upper halves
//! of the vector registers in use, and until those are cleared every SSE instruction of that thread
//! waits for them: measured here, the policy ran 8 times slower (30 instead of 4 us) on a thread that
//! had called tract once, and so would the physics. A panic in tract ends there too.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::thread;

use tract_onnx::pb::ModelProto;
use tract_onnx::prelude::*;

use crate::error::Fault;
use crate::policy_signature::PolicySignature;
use crate::probe;
use crate::wording::one_line;

/// Decodes the protobuf.
///
/// # Errors
/// [`Fault::Damaged`].
pub(crate) fn decode(bytes: &[u8]) -> Result<ModelProto, Fault> {
    guarded(|| onnx().proto_model_for_read(&mut &bytes[..])).map_err(|reason| Fault::Damaged { reason })
}

/// Computes by tract the answers to every probe in range: rows of the contract's outputs.
///
/// # Errors
/// [`Fault::OracleRefused`].
pub(crate) fn answers(model: ModelProto, contract: &PolicySignature) -> Result<Vec<f32>, Fault> {
    let work = || guarded(|| compute(model, contract));
    let refused = |reason| Fault::OracleRefused { reason };
    thread::scope(|scope| {
        let started = thread::Builder::new().name("policy-oracle".into()).spawn_scoped(scope, work);
        let running = started.map_err(|error| refused(one_line(&error.to_string())))?;
        running.join().map_err(|_| refused("it panicked".to_owned()))?.map_err(refused)
    })
}

fn compute(mut model: ModelProto, contract: &PolicySignature) -> TractResult<Vec<f32>> {
    let (inputs, outputs) = (contract.inputs.len(), contract.outputs.len());
    if let Some(graph) = &mut model.graph {
        graph.value_info.clear();
    }
    let parsed = onnx().parse(&model, None)?.model;
    let shaped = parsed.with_input_fact(0, f32::fact([1, inputs]).into())?;
    let plan = shaped.into_optimized()?.into_runnable()?;
    let mut answers = Vec::with_capacity(probe::IN_RANGE * outputs);
    let mut input = vec![0.0; inputs];
    for number in 0..probe::IN_RANGE {
        probe::fill(contract, number, &mut input);
        let tensor = Tensor::from_shape(&[1, inputs], &input)?;
        let results = plan.run(tvec!(tensor.into_tvalue()))?;
        let action = results[0].to_plain_array_view::<f32>()?;
        if action.shape() != [1, outputs] {
            return Err(TractError::msg(format!("its result has shape {:?}", action.shape())));
        }
        answers.extend(action.iter());
    }
    Ok(answers)
}

/// Runs tract code; an error or a panic becomes one line.
fn guarded<T>(work: impl FnOnce() -> TractResult<T>) -> Result<T, String> {
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(error)) => Err(one_line(&format!("{error:#}"))),
        Err(_) => Err("it panicked".to_owned()),
    }
}

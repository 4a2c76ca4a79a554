//! Inputs and outputs that a policy must have: channels in order, their units and physical ranges, the rate.
//!
//! A contract has a version, so that a second layout of observations can stand beside the first and a
//! policy trained for one is never flown with the other. The numbers themselves are the model's; this
//! crate only compares a file with them.

/// One input or output of a policy.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// Name as it stands in a policy's `input_names` or `output_names`.
    pub name: String,
    /// Unit, for example `kPa gauge` or `duty`.
    pub unit: String,
    /// Lowest value that can occur, in `unit`; probes start here. May be negative.
    pub low: f32,
    /// Highest value that can occur, in `unit`; probes end here.
    pub high: f32,
}

/// A versioned layout of a policy's inputs and outputs.
///
/// Each value has its own unit and range. For an output, `low..=high` is what the control law takes (a duty in 0..=1,
/// or a correction of one on either side of 0): a policy that leaves it is refused.
#[derive(Debug, Clone, PartialEq)]
pub struct PolicySignature {
    /// The number that the metadata key `contract` carries.
    pub version: u32,
    /// Ticks per second the policy was trained for.
    pub rate_hz: f64,
    /// Inputs in the order of the ONNX tensor.
    pub inputs: Vec<Channel>,
    /// Outputs in the order of the ONNX tensor.
    pub outputs: Vec<Channel>,
}

impl PolicySignature {
    /// A contract of `inputs` pressures (kPa gauge) and `outputs` duties at 50 Hz, with plain numbered
    /// names: even inputs belong to the positive chamber (0 to 160 kPa), odd ones to the negative
    /// (-95 to 0 kPa), as the safety envelope has them.
    pub fn pressures_to_duties(version: u32, inputs: usize, outputs: usize) -> Self {
        let pressure = |i: usize| {
            let (low, high) = if i.is_multiple_of(2) { (0.0, 160.0) } else { (-95.0, 0.0) };
            Channel { name: format!("input_{i}"), unit: "kPa gauge".into(), low, high }
        };
        let duty = |i: usize| Channel { name: format!("output_{i}"), unit: "duty".into(), low: 0.0, high: 1.0 };
        Self {
            version,
            rate_hz: 50.0,
            inputs: (0..inputs).map(pressure).collect(),
            outputs: (0..outputs).map(duty).collect(),
        }
    }
}

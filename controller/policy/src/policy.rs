//! A policy from file to action.

use std::fmt::Write as _;
use std::path::Path;

use crate::content_hash;
use crate::error::{Fault, PolicyError};
use crate::file::{self, Links, PolicyHash};
use crate::kernel::{Kernel, Layer};
use crate::metadata::{GoldenPair, Metadata};
use crate::oracle;
use crate::policy_signature::{Channel, PolicySignature};
use crate::probe;
use crate::refused::Refused;
use crate::{chain, graph_signature, rounding};

/// Largest difference to tract on a probe. Two orders of summation of 256 products of order one differ
/// by about 1e-6; an error in an operator or in the packing shows as 1e-3 and more.
const ORACLE_TOLERANCE: f32 = 1e-5;
/// Difference that a policy which amplifies rounding may have beyond that, in standard deviations of its own
/// rounding. Measured over 80 networks whose features scale 10 kPa down to 0.1 kPa to one: at most 0.6.
const ROUNDING_DEVIATIONS: f64 = 4.0;
/// Difference that no policy may have, however it amplifies.
const MOST_DIFFERENCE: f64 = 1e-3;
/// Largest difference to a golden pair, which another program computed and printed.
const GOLDEN_TOLERANCE: f32 = 1e-4;
/// Distance by which an output may leave its range by rounding, `0.5 tanh + 0.5` for example.
const RANGE_TOLERANCE: f32 = 1e-5;
/// Runs that bring weights and code into the caches.
const WARM_UP_RUNS: usize = 32;

/// A policy that passed every check, ready for the tick.
pub struct Policy {
    name: String,
    hash: PolicyHash,
    bytes: usize,
    opset: i64,
    producer: String,
    metadata: Metadata,
    contract: PolicySignature,
    checks: Checks,
    kernel: Kernel,
}

/// Findings of the checks at load.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Checks {
    /// Probes on which the policy was run.
    pub probes: usize,
    /// Largest difference to tract over them.
    pub worst_to_tract: f32,
    /// Golden pairs in the metadata.
    pub golden_pairs: usize,
    /// Largest difference to them.
    pub worst_to_golden: f32,
    /// Lowest output over the physical range.
    pub lowest_output: f32,
    /// Highest output over the physical range.
    pub highest_output: f32,
}

impl Policy {
    /// Loads a policy file, checks it and compiles it.
    ///
    /// The file's metadata choose among `contracts`; without them the first that has its widths is
    /// taken. The file is read once, so what is hashed is what is checked and flown.
    ///
    /// # Errors
    /// [`PolicyError`] names the file, what is wrong and the mend, on one line.
    ///
    /// # Real-time
    /// Not for the tick: about 0.1 s, most of it tract's, and thousands of allocations. Neither is dropping a policy.
    pub fn load(path: &Path, contracts: &[PolicySignature]) -> Result<Self, PolicyError> {
        let name = path.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
        file::read(path, Links::Follow)
            .and_then(|bytes| Self::from_bytes(name, &bytes, contracts))
            .map_err(|fault| PolicyError { file: path.to_owned(), fault })
    }

    /// As [`Policy::load`], from bytes that the caller already has.
    ///
    /// # Errors
    /// The [`Fault`].
    pub fn from_bytes(name: String, bytes: &[u8], contracts: &[PolicySignature]) -> Result<Self, Fault> {
        file::scan(bytes)?;
        let model = oracle::decode(bytes)?;
        let metadata = Metadata::read(&model)?;
        content_hash::check(bytes, &metadata)?;
        let named = metadata.contract(contracts)?;
        let Some(assumed) = named.or(contracts.first()) else {
            return Err(Fault::ContractUnknown { found: String::new(), known: Vec::new() });
        };
        let signature = graph_signature::read(&model, assumed)?;
        let fits = |c: &&PolicySignature| (c.inputs.len(), c.outputs.len()) == (signature.inputs, signature.outputs);
        let contract = match named {
            Some(named) => named,
            None => contracts.iter().find(fits).unwrap_or(assumed),
        };
        signature.check_widths(contract)?;
        metadata.check(contract)?;
        let golden = metadata.golden(contract)?;
        let layers = chain::compile(&signature)?;
        let opset = signature.opset;
        let mut kernel = Kernel::new(contract.inputs.len(), layers);
        let producer = format!("{} {}", model.producer_name, model.producer_version);
        let tract = oracle::answers(model, contract)?;
        let mut checks = try_probes(&mut kernel, &tract, contract)?;
        checks.golden_pairs = golden.len();
        checks.worst_to_golden = try_golden(&mut kernel, &golden)?;
        let mut policy = Self {
            name,
            hash: file::hash(bytes),
            bytes: bytes.len(),
            opset,
            producer: producer.trim().to_owned(),
            metadata,
            contract: contract.clone(),
            checks,
            kernel,
        };
        policy.warm_up();
        Ok(policy)
    }

    /// Computes the action for one observation, in the contract's order and units.
    ///
    /// Inputs are checked before and outputs after: a NaN or an infinity anywhere gives [`Refused`]
    /// and leaves `out` untouched. Finite outputs may leave their range by rounding (1e-5); the caller
    /// limits them. The same file and input give the same bits on every machine.
    ///
    /// # Errors
    /// [`Refused`]; the caller flies its fallback for this tick.
    ///
    /// # Real-time
    /// For the tick: allocates nothing, takes no lock, makes no system call, and takes bounded time.
    pub fn run(&mut self, input: &[f32], out: &mut [f32]) -> Result<(), Refused> {
        self.kernel.run(input, out)
    }

    /// Runs a few times on the middle of the range, so that the first tick finds warm caches.
    ///
    /// # Real-time
    /// Allocates; call it on the thread that will run the policy, before its loop.
    pub fn warm_up(&mut self) {
        let middle: Vec<f32> = self.contract.inputs.iter().map(|c| c.low + 0.5 * (c.high - c.low)).collect();
        let mut out = vec![0.0; self.kernel.outputs()];
        for _ in 0..WARM_UP_RUNS {
            // A refusal was ruled out by the probes, and would show in the first tick again.
            let _ = std::hint::black_box(self.kernel.run(&middle, &mut out));
        }
    }

    /// The file's name without its ending, by which the daemon's operators call it.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// SHA-256 of the file.
    pub fn hash(&self) -> PolicyHash {
        self.hash
    }

    /// The contract it was checked against.
    pub fn contract(&self) -> &PolicySignature {
        &self.contract
    }

    /// Metadata of the file.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// Findings of the checks.
    pub fn checks(&self) -> &Checks {
        &self.checks
    }

    /// Values in an observation.
    pub fn inputs(&self) -> usize {
        self.kernel.inputs()
    }

    /// Values in an action.
    pub fn outputs(&self) -> usize {
        self.kernel.outputs()
    }

    /// Weights and biases of the dense layers.
    pub fn parameters(&self) -> usize {
        let count = |layer: &Layer| match layer {
            Layer::Dense(dense) => {
                let (inputs, outputs) = dense.width();
                (inputs + 1) * outputs
            }
            Layer::Constant(..) | Layer::Activation(_) => 0,
        };
        self.kernel.layers().iter().map(count).sum()
    }

    /// The layers in one line: `84 -> 256 relu -> 256 relu -> 12 sigmoid`.
    pub fn layers(&self) -> String {
        let mut line = self.kernel.inputs().to_string();
        let mut scaled = false;
        for layer in self.kernel.layers() {
            // Writing to a String cannot fail.
            let _ = match layer {
                Layer::Dense(dense) => write!(line, " -> {}", dense.width().1),
                Layer::Activation(activation) => write!(line, " {}", activation.name()),
                Layer::Constant(..) if scaled => Ok(()),
                Layer::Constant(..) => write!(line, " scaled"),
            };
            scaled = matches!(layer, Layer::Constant(..));
        }
        line
    }

    /// One paragraph for a person: what it is, where from, what was checked.
    pub fn describe(&self) -> String {
        let Checks { probes, worst_to_tract, lowest_output, highest_output, .. } = self.checks;
        let mut text = format!(
            "Policy {:?}: {}, {} parameters, {} bytes of ONNX (opset {}), sha256 {:.16}. Observation layout v{} at {} Hz: \
             {}, {}. Sound: kernel and tract agree within {:.1e} on {} probes, outputs lie in {:.3} to {:.3} over the physical range",
            self.name,
            self.layers(),
            self.parameters(),
            self.bytes,
            self.opset,
            self.hash,
            self.contract.version,
            self.contract.rate_hz,
            ends("takes", &self.contract.inputs),
            ends("gives", &self.contract.outputs),
            worst_to_tract,
            probes,
            lowest_output,
            highest_output,
        );
        let _ = match self.checks.golden_pairs {
            0 => write!(text, "; it carries no golden pairs."),
            n => write!(text, ", {n} golden pairs within {:.1e}.", self.checks.worst_to_golden),
        };
        if !self.producer.is_empty() {
            let _ = write!(text, " Made by {}.", self.producer.escape_debug());
        }
        // Lists and golden pairs are long and were judged above.
        const LONGEST: usize = 80;
        let told = self.metadata.iter().filter(|(_, value)| value.len() <= LONGEST);
        let told: Vec<String> = told.map(|(k, v)| format!("{} {}", k.escape_debug(), v.escape_debug())).collect();
        if !told.is_empty() {
            let _ = write!(text, " It says: {}.", told.join(", "));
        }
        text
    }
}

/// Number of values that a contract has on one side, with the first and the last name: `takes 84 (p_pos[-10] to ref_neg[15])`.
fn ends(verb: &str, channels: &[Channel]) -> String {
    match channels {
        [] => format!("{verb} nothing"),
        [only] => format!("{verb} {}", only.name),
        [first, .., last] => format!("{verb} {} ({} to {})", channels.len(), first.name, last.name),
    }
}

/// Runs the kernel on the probes and compares it with what tract gave.
fn try_probes(kernel: &mut Kernel, tract: &[f32], contract: &PolicySignature) -> Result<Checks, Fault> {
    let mut checks = Checks {
        probes: probe::IN_RANGE + probe::WILD,
        worst_to_tract: 0.0,
        golden_pairs: 0,
        worst_to_golden: 0.0,
        lowest_output: f32::INFINITY,
        highest_output: f32::NEG_INFINITY,
    };
    let mut input = vec![0.0; contract.inputs.len()];
    let mut ours = vec![0.0; contract.outputs.len()];
    // Wild probes have no row in `tract`.
    let mut rows = tract.chunks_exact(contract.outputs.len().max(1));
    for probe in 0..checks.probes {
        probe::fill(contract, probe, &mut input);
        kernel.run(&input, &mut ours).map_err(|refused| Fault::ProbeRefused { probe, refused })?;
        let tract = rows.next().unwrap_or_default();
        if let Some(output) = differs(kernel.layers(), &input, &ours, tract) {
            let (ours, tract) = (ours[output], tract[output]);
            return Err(Fault::OracleDiffers { probe, output, ours, tract });
        }
        for (&ours, &tract) in ours.iter().zip(tract) {
            let off = (ours - tract).abs();
            checks.worst_to_tract = checks.worst_to_tract.max(off);
            checks.lowest_output = checks.lowest_output.min(ours);
            checks.highest_output = checks.highest_output.max(ours);
        }
        for (output, (&value, channel)) in ours.iter().zip(&contract.outputs).enumerate() {
            let (low, high) = (channel.low, channel.high);
            if value < low - RANGE_TOLERANCE || value > high + RANGE_TOLERANCE {
                let unit = channel.unit.clone();
                return Err(Fault::OutputRange { output, value, unit, low, high });
            }
        }
    }
    Ok(checks)
}

/// The first output on which kernel and tract differ by more than rounding explains.
fn differs(layers: &[Layer], input: &[f32], ours: &[f32], tract: &[f32]) -> Option<usize> {
    let off = || ours.iter().zip(tract).map(|(ours, tract)| (ours - tract).abs());
    if off().all(|off| off <= ORACLE_TOLERANCE) {
        return None;
    }
    let allowed = |scatter: f64| (f64::from(ORACLE_TOLERANCE) + ROUNDING_DEVIATIONS * scatter).min(MOST_DIFFERENCE);
    let allowed = rounding::scatter(layers, input).into_iter().map(allowed);
    off().zip(allowed).position(|(off, allowed)| off.is_nan() || f64::from(off) > allowed)
}

/// Runs the golden pairs; gives the largest difference.
fn try_golden(kernel: &mut Kernel, golden: &[GoldenPair]) -> Result<f32, Fault> {
    let mut ours = vec![0.0; kernel.outputs()];
    let mut worst = 0.0f32;
    for (i, pair) in golden.iter().enumerate() {
        kernel.run(&pair.input, &mut ours).map_err(|refused| Fault::GoldenRefused { pair: i + 1, refused })?;
        for (output, (&ours, &expected)) in ours.iter().zip(&pair.output).enumerate() {
            let off = (ours - expected).abs();
            if off > GOLDEN_TOLERANCE {
                return Err(Fault::GoldenDiffers { pair: i + 1, output, ours, expected });
            }
            worst = worst.max(off);
        }
    }
    Ok(worst)
}

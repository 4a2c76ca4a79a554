//! Names of the files inside a recording of the daemon.

/// The model behind predictions and feed-forward at the start, and after it each that took over while the run went on.
pub const MODEL: &str = "model_rig.toml";
/// The configuration as it was written.
pub const CONFIG: &str = "controller.toml";
/// The configuration as it counted, with every key.
pub const EFFECTIVE: &str = "controller-effective.toml";
/// The reference at the start, and after it each that was put in while the run went on.
pub const REFERENCE: &str = "reference.csv";
/// The commands of an experiment: all of one where the recording is an experiment's, else each in its turn.
pub const EXPERIMENT: &str = "experiment.csv";
/// The policy at the start, and each that was tried while the run went on, once.
pub const POLICY: &str = "policy.onnx";
/// Inputs that the tick was given by other threads while the run went on, each in its turn ([`crate::recording::TickOrder`]).
pub const ORDER: &str = "order.json";
/// The rig behind the emulated cRIO.
pub const PLANT: &str = "emulated_rig.toml";
/// All of them.
pub const ALL: [&str; 8] = [MODEL, CONFIG, EFFECTIVE, REFERENCE, EXPERIMENT, POLICY, ORDER, PLANT];

//! The corpus of bad policies: each is refused for its own reason, in one line that names the file.
#![allow(clippy::unwrap_used, clippy::panic)]

mod onnx;

use std::path::PathBuf;

use onnx::{tensor_proto::DataType, *};
use policy::{Fault, MAX_FILE_BYTES, Policy, SUPPORTED_OPS};
use proptest::prelude::*;

/// Loads a file that must be refused; checks the form of the line and gives the fault and the line.
fn refusal(path: &PathBuf) -> (Fault, String) {
    let error = Policy::load(path, &paper()).err().unwrap_or_else(|| panic!("{path:?} was taken"));
    let line = error.to_string();
    assert!(line.starts_with(&format!("{}: ", path.display())), "names no file: {line}");
    assert_eq!(line.lines().count(), 1, "not one line: {line}");
    assert!(line.len() < 600, "too long: {line}");
    (error.fault, line)
}

/// One bad file: how it is made from a sound one, the fault, and words that its line must hold.
macro_rules! refuses {
    ($($name:ident: $change:expr, $fault:pat, $words:expr;)*) => {$(
        #[test]
        fn $name() {
            let mut onnx = sound();
            let change: fn(&mut Onnx) = $change;
            change(&mut onnx);
            let (fault, line) = refusal(&onnx.save(concat!(stringify!($name), ".onnx")));
            assert!(matches!(fault, $fault), "wrong reason: {line}");
            for word in $words {
                assert!(line.contains(word), "{word:?} is not in: {line}");
            }
        }
    )*};
}

fn set_op(onnx: &mut Onnx, output: &str, op: &str) {
    node_of(onnx, output).op_type = op.into();
}

fn set_float(onnx: &mut Onnx, name: &str, place: usize, value: f32) {
    weight_of(onnx, name).raw_data[4 * place..4 * place + 4].copy_from_slice(&value.to_le_bytes());
}

/// Replaces the whole network.
fn become_mlp(onnx: &mut Onnx, sizes: &[usize], last: &str) {
    *onnx = Mlp::new(sizes, 3).torch("Relu", last);
}

refuses! {
    eighty_inputs: |o| become_mlp(o, &[80, 16, 12], "Sigmoid"),
        Fault::InputWidth { found: 80, expected: 84, contract: 1, .. }, ["80", "84", "obs"];
    six_outputs: |o| become_mlp(o, &[84, 16, 6], "Sigmoid"),
        Fault::OutputWidth { found: 6, expected: 12, .. }, ["6", "12", "action"];
    two_inputs: |o| { let p = port("goal", DataType::Float, &[Dim::Fixed(1), Dim::Fixed(52)]); o.graph().input.push(p) },
        Fault::InputCount { .. }, ["2 inputs", "\"obs\", \"goal\"", "one tensor"];
    no_input: |o| o.graph().input.clear(),
        Fault::InputCount { .. }, ["0 inputs"];
    two_outputs: |o| { let p = port("log_std", DataType::Float, &[Dim::Fixed(1), Dim::Fixed(12)]); o.graph().output.push(p) },
        Fault::OutputCount { .. }, ["log_std", "mean action"];
    double_input: |o| o.graph().input[0] = port("obs", DataType::Double, &[Dim::Fixed(1), Dim::Fixed(84)]),
        Fault::PortType { port: "input", found: "float64", .. }, ["float32"];
    integer_output: |o| o.graph().output[0] = port("action", DataType::Int64, &[Dim::Fixed(1), Dim::Fixed(12)]),
        Fault::PortType { port: "output", found: "int64", .. }, ["float32"];
    untyped_input: |o| o.graph().input[0].r#type = None,
        Fault::PortType { found: "no tensor", .. }, ["obs"];
    flat_input: |o| o.graph().input[0] = port("obs", DataType::Float, &[Dim::Fixed(84)]),
        Fault::PortShape { .. }, ["[84]", "[1, 84]"];
    batch_of_four: |o| o.graph().input[0] = port("obs", DataType::Float, &[Dim::Fixed(4), Dim::Fixed(84)]),
        Fault::PortShape { .. }, ["[4, 84]"];
    open_width: |o| o.graph().input[0] = port("obs", DataType::Float, &[Dim::Fixed(1), Dim::Named("n\nm")]),
        Fault::PortShape { .. }, ["[1, n\\nm]", "fixed width"];
    split_state: |o| o.graph().input[0] = port("obs", DataType::Float, &[Dim::Fixed(1), Dim::Fixed(42), Dim::Fixed(2)]),
        Fault::PortShape { .. }, ["[1, 42, 2]"];
    wrong_declaration: |o| { set_float(o, "mean", 0, 0.0); weight_of(o, "l2.weight").dims = vec![12, 31]; weight_of(o, "l2.weight").raw_data.truncate(12 * 31 * 4) },
        Fault::Sizes { width: 32, .. }, ["[12, 31]", "columns"];
    declared_too_wide: |o| { let mut other = Mlp::new(&[84, 8, 13], 1).torch("Relu", "Sigmoid"); other.graph().output[0] = port("action", DataType::Float, &[Dim::Fixed(1), Dim::Fixed(12)]); *o = other },
        Fault::OutputDeclaration { declared: 12, computed: 13, .. }, ["12", "13"];
    recurrent: |o| set_op(o, "h0", "LSTM"),
        Fault::UnsupportedOp { .. }, ["LSTM", SUPPORTED_OPS[0], SUPPORTED_OPS[18]];
    softmax_head: |o| set_op(o, "action", "Softmax"),
        Fault::UnsupportedOp { .. }, ["Softmax", "Sigmoid"];
    foreign_domain: |o| node_of(o, "h0").domain = "com.microsoft".into(),
        Fault::UnsupportedOp { .. }, ["com.microsoft.Relu"];
    residual: |o| { o.node("Add", &["h0", "h1"], "r", vec![]); let last = o.graph().node.pop().unwrap(); let at = o.graph().node.len() - 2; o.graph().node.insert(at, last); node_of(o, "y2").input[0] = "r".into() },
        Fault::NotAChain { .. }, ["joins two", "plain chain"];
    swish: |o| { node_of(o, "h0").op_type = "Mul".into(); node_of(o, "h0").input.push("y0".into()) },
        Fault::NotAChain { .. }, ["joins two"];
    branch: |o| node_of(o, "y2").input[0] = "h0".into(),
        Fault::NotAChain { .. }, ["y2", "already taken"];
    head_after_the_output: |o| { o.node("Tanh", &["action"], "extra", vec![]); },
        Fault::OutputNotLast { .. }, ["\"action\"", "\"extra\""];
    dangling_name: |o| node_of(o, "y1").input[1] = "l9.weight".into(),
        Fault::UnknownValue { .. }, ["l9.weight", "y1"];
    value_made_twice: |o| node_of(o, "y1").output[0] = "h0".into(),
        Fault::DuplicateValue { .. }, ["\"h0\""];
    weights_from_the_observation: |o| { let n = node_of(o, "y0"); n.input.swap(0, 1) },
        Fault::NotAChain { .. }, ["where a constant belongs"];
    gemm_without_weights: |o| node_of(o, "y0").input.truncate(1),
        Fault::Arity { side: "inputs", found: 1, .. }, ["Gemm"];
    two_results: |o| node_of(o, "h0").output.push("mask".into()),
        Fault::Arity { side: "outputs", found: 2, .. }, ["Relu"];
    unknown_attribute: |o| node_of(o, "y0").attribute.push(int("broadcast", 1)),
        Fault::Attribute { .. }, ["broadcast", "opset 17"];
    attribute_of_wrong_type: |o| node_of(o, "y0").attribute[0] = int("alpha", 1),
        Fault::Attribute { .. }, ["alpha", "wrong type"];
    attribute_not_finite: |o| node_of(o, "y0").attribute[0] = float("alpha", f32::NAN),
        Fault::Attribute { .. }, ["alpha", "not finite"];
    observation_as_column: |o| node_of(o, "y0").attribute.push(int("transA", 1)),
        Fault::Attribute { .. }, ["transA"];
    cast_to_half: |o| { let n = node_of(o, "h0"); n.op_type = "Cast".into(); n.attribute.push(int("to", 10)) },
        Fault::Attribute { .. }, ["\"to\"", "float32"];
    flatten_the_batch: |o| { let n = node_of(o, "h0"); n.op_type = "Flatten".into(); n.attribute.push(int("axis", 0)) },
        Fault::Attribute { .. }, ["axis"];
    reshape_to_rows: |o| { o.shape("rows", &[2, 16]); let n = node_of(o, "h0"); n.op_type = "Reshape".into(); n.input.push("rows".into()) },
        Fault::Sizes { .. }, ["reshape", "32"];
    transposed_twice_over: |o| node_of(o, "y0").attribute[2] = int("transB", 0),
        Fault::Sizes { width: 84, .. }, ["[32, 84]", "rows"];
    mean_of_another_width: |o| { weight_of(o, "mean").dims = vec![42]; weight_of(o, "mean").raw_data.truncate(42 * 4) },
        Fault::Sizes { .. }, ["[42]", "84 values"];
    half_precision: |o| weight_of(o, "l0.weight").data_type = DataType::Float16 as i32,
        Fault::WeightType { found: "float16", .. }, ["l0.weight", "float32"];
    nan_weight: |o| set_float(o, "l1.weight", 5, f32::NAN),
        Fault::WeightNotFinite { index: 5, .. }, ["l1.weight", "NaN", "diverged"];
    infinite_bias: |o| set_float(o, "l2.bias", 11, f32::NEG_INFINITY),
        Fault::WeightNotFinite { index: 11, .. }, ["-inf"];
    ragged_weight: |o| { weight_of(o, "l0.bias").raw_data.pop(); },
        Fault::WeightSize { .. }, ["l0.bias", "[32]", "127 bytes"];
    weights_elsewhere: |o| { let w = weight_of(o, "l0.weight"); w.raw_data.clear(); w.data_location = Some(1) },
        Fault::ExternalWeights { .. }, ["l0.weight", "another file"];
    sparse_weights: |o| o.graph().sparse_initializer.push(Default::default()),
        Fault::SparseWeights, ["dense"];
    old_opset: |o| o.0.opset_import[0].version = 9,
        Fault::Opset { found: 9 }, ["opset 9", "between 13 and 20"];
    future_opset: |o| o.0.opset_import[0].version = 25,
        Fault::Opset { found: 25 }, ["opset 25"];
    no_opset: |o| o.0.opset_import.clear(),
        Fault::Opset { found: 0 }, ["opset 0"];
    no_graph: |o| o.0.graph = None,
        Fault::NoGraph, ["no graph"];
    ten_thousand_nodes: |o| for i in 0..10_000 { o.node("Relu", &["obs"], &format!("n{i}"), vec![]); },
        Fault::TooMany { what: "nodes", .. }, ["1024"];
    frozen_input: |o| set_float(o, "deviation", 17, 0.0),
        Fault::DivisionByZero { index: 17, .. }, ["value 17", "deviation of 1"];
    crossed_clip: |o| { *o = Mlp::new(&[84, 12], 1).torch("Relu", "Clip"); set_float(o, "low", 0, 2.0) },
        Fault::ClipBounds { .. }, ["[2, 1]"];
    too_large_for_the_tick: |o| become_mlp(o, &[84, 1400, 1400, 12], "Sigmoid"),
        Fault::TooSlow { .. }, ["smaller network"];
    no_squashing: |o| { become_mlp(o, &[84, 16, 12], "Identity") },
        Fault::OutputRange { .. }, ["[0, 1]", "with Clip", "Sigmoid or Tanh mapped", "duty"];
    tanh_without_mapping: |o| { become_mlp(o, &[84, 16, 12], "Tanh") },
        Fault::OutputRange { .. }, ["duty must lie in"];
    overflowing_weights: |o| { weight_of(o, "l0.weight").raw_data = (0..84 * 32).flat_map(|_| 1e38f32.to_le_bytes()).collect(); set_op(o, "h0", "Identity"); set_op(o, "h1", "Identity") },
        Fault::ProbeRefused { .. }, ["overflow"];
    contract_from_the_future: |o| { o.metadata("contract", "7"); },
        Fault::ContractUnknown { .. }, ["\"7\"", "knows 1"];
    contract_that_is_no_number: |o| { o.metadata("contract", "paper\n"); },
        Fault::ContractUnknown { .. }, ["paper\\n"];
    other_rate: |o| { o.metadata("rate_hz", "100"); },
        Fault::MetadataContradicts { key: "rate_hz", .. }, ["100", "50"];
    absolute_pressures: |o| { o.metadata("input_unit", "kPa absolute"); },
        Fault::MetadataContradicts { key: "input_unit", .. }, ["kPa absolute", "kPa gauge"];
    volts_out: |o| { o.metadata("output_unit", "V"); },
        Fault::MetadataContradicts { key: "output_unit", .. }, ["duty"];
    channels_swapped: |o| { let mut names: Vec<_> = (0..84).map(|i| format!("input_{i}")).collect(); names.swap(2, 3); o.metadata("input_names", &names.join(",")); },
        Fault::MetadataContradicts { key: "input_names", .. }, ["input_3 (value 2)", "input_2 (value 2)"];
    metadata_twice: |o| { o.metadata("seed", "1").metadata("seed", "2"); },
        Fault::MetadataTwice { .. }, ["seed"];
    golden_pair_of_other_weights: |o| { o.metadata("golden_input", &["0"; 84].join(",")).metadata("golden_output", &["0.999"; 12].join(",")); },
        Fault::GoldenDiffers { pair: 1, output: 0, .. }, ["0.999", "golden pair 1"];
    golden_pair_cut_short: |o| { o.metadata("golden_input", "0,0,0").metadata("golden_output", "1"); },
        Fault::GoldenUnreadable { .. }, ["3 numbers where 84 belong"];
    more_golden_pairs_than_are_taken: |o| {
        o.metadata("golden_input", &vec!["0"; 257].join(";")).metadata("golden_output", &vec!["0"; 257].join(";"));
    },
        Fault::GoldenUnreadable { pair: 257, .. }, ["257 pairs are more than 256"];
    a_hash_of_itself_that_is_none: |o| { o.metadata("content_sha256", "abc"); },
        Fault::ContentHashUnreadable { .. }, ["\"abc\"", "64 digits"];
    golden_input_alone: |o| { o.metadata("golden_input", &["0"; 84].join(",")); },
        Fault::GoldenUnreadable { .. }, ["1 pairs and golden_output 0"];
}

#[test]
fn files_that_are_no_onnx() {
    let cases: [(&str, &[u8]); 4] = [
        ("text.onnx", b"time_s,u_pos,u_neg\n0,0.5,0.5\n"),
        ("zip.onnx", b"PK\x03\x04\x14\0\0\0"),
        ("zeros.onnx", &[0; 4096]),
        ("html.onnx", b"<!DOCTYPE html><html>"),
    ];
    for (name, bytes) in cases {
        let (fault, line) = refusal(&save(name, bytes));
        assert!(matches!(fault, Fault::NotOnnx { at: 0 }), "{line}");
        assert!(line.contains("is not an ONNX file"));
    }
    assert!(matches!(refusal(&save("empty.onnx", b"")).0, Fault::Empty));
}

#[test]
fn files_that_cannot_be_read() {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR"));
    let (fault, line) = refusal(&folder.join("absent.onnx"));
    assert!(matches!(fault, Fault::Unreadable { .. }) && line.contains("check the name"), "{line}");
    assert!(matches!(refusal(&folder).0, Fault::NotRegular));
    let big = folder.join("big.onnx");
    std::fs::File::create(&big).unwrap().set_len(MAX_FILE_BYTES + 1).unwrap();
    let (fault, line) = refusal(&big);
    assert!(matches!(fault, Fault::TooLarge { .. }) && line.contains("16777216"), "{line}");
    std::fs::remove_file(big).unwrap();
}

/// In a watched directory: a pipe that nobody writes to, a symbolic link, a directory and a huge sparse file, none of
/// which holds the reader up.
#[test]
fn what_is_no_plain_file_is_refused_at_once() {
    use policy::{Links, read};
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("kinds");
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    let sound = sound().bytes();
    std::fs::write(folder.join("sound.onnx"), &sound).unwrap();
    std::os::unix::fs::symlink("sound.onnx", folder.join("link.onnx")).unwrap();
    std::os::unix::fs::symlink("/dev/zero", folder.join("zero.onnx")).unwrap();
    assert!(std::process::Command::new("mkfifo").arg(folder.join("pipe.onnx")).status().unwrap().success());
    let socket = std::os::unix::net::UnixListener::bind(folder.join("s.onnx")).unwrap();
    let started = std::time::Instant::now();
    let read = |name: &str, links| read(&folder.join(name), links);
    assert_eq!(read("sound.onnx", Links::Refuse).unwrap(), sound);
    assert_eq!(read("link.onnx", Links::Follow).unwrap(), sound);
    assert!(matches!(read("link.onnx", Links::Refuse), Err(Fault::Link)));
    assert!(matches!(read("zero.onnx", Links::Refuse), Err(Fault::Link)));
    for (name, links) in
        [("zero.onnx", Links::Follow), ("pipe.onnx", Links::Refuse), ("pipe.onnx", Links::Follow), (".", Links::Refuse)]
    {
        assert!(matches!(read(name, links), Err(Fault::NotRegular)), "{name}");
    }
    assert!(matches!(read("s.onnx", Links::Refuse), Err(Fault::NotRegular | Fault::Unreadable { .. })));
    assert!(started.elapsed().as_secs() < 5);
    drop(socket);
}

/// A copy that stopped anywhere is refused; nearly everywhere as cut short.
#[test]
fn every_truncation_is_refused() {
    let bytes = sound().bytes();
    let mut cut_short = 0;
    let step = 37;
    for length in (1..bytes.len()).step_by(step) {
        match Policy::from_bytes("cut".into(), &bytes[..length], &paper()) {
            Err(Fault::Truncated { .. }) => cut_short += 1,
            Err(Fault::NoGraph | Fault::Opset { .. }) => {}
            Err(other) => panic!("at {length}: {other}"),
            Ok(_) => panic!("{length} of {} bytes were taken", bytes.len()),
        }
    }
    assert!(cut_short * step > bytes.len() * 95 / 100);
}

/// A graph inside that is damaged while the outer frame is whole.
#[test]
fn damage_inside_is_refused() {
    let mut bytes = sound().bytes();
    let graph = bytes.windows(3).position(|w| w == b"obs").unwrap();
    // The name's length now runs into what follows.
    bytes[graph - 1] = 0x7f;
    let fault = Policy::from_bytes("damaged".into(), &bytes, &paper()).err().unwrap();
    assert!(matches!(fault, Fault::Damaged { .. }), "{fault}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]
    /// No bytes make the loader panic; what it takes, it flies within [0, 1].
    #[test]
    fn flipped_bytes_never_panic(at in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4)) {
        let mut bytes = Mlp::new(&[84, 4, 12], 1).torch("Relu", "Sigmoid").bytes();
        for (index, value) in at {
            let index = index.index(bytes.len());
            bytes[index] = value;
        }
        match Policy::from_bytes("flipped".into(), &bytes, &paper()) {
            Err(fault) => prop_assert_eq!(fault.to_string().lines().count(), 1),
            Ok(policy) => prop_assert!(policy.checks().highest_output <= 1.0 + 1e-5),
        }
    }

    #[test]
    fn random_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
        prop_assert!(Policy::from_bytes("noise".into(), &bytes, &paper()).is_err());
    }
}

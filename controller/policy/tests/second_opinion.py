"""Second opinion for tests/onnxruntime.rs.

run MODEL INPUTS OUTPUTS   checks MODEL with the ONNX checker, runs it on the f32 rows of INPUTS
make DIR                   writes models built with the onnx package, inputs.f32 and their outputs
"""

import sys
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper, numpy_helper

INPUTS, OUTPUTS = 84, 12


def run(model, rows):
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.log_severity_level = 3
    session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    name = session.get_inputs()[0].name
    return np.concatenate([session.run(None, {name: row[None, :]})[0] for row in rows])


def observations(count):
    rng = np.random.default_rng(5)
    rows = rng.uniform(0, 160, (count, INPUTS)).astype(np.float32)
    rows[:, 1::2] = rng.uniform(-95, 0, (count, INPUTS // 2))
    return rows


def save(folder, name, nodes, weights, batch, opset, list_weights=False):
    port = lambda n, width: helper.make_tensor_value_info(n, TensorProto.FLOAT, [batch, width])
    tensors = [numpy_helper.from_array(value, key) for key, value in weights.items()]
    inputs = [port("obs", INPUTS)]
    if list_weights:
        inputs += [helper.make_tensor_value_info(k, TensorProto.FLOAT, v.shape) for k, v in weights.items()]
    graph = helper.make_graph(nodes, name, inputs, [port("action", OUTPUTS)], tensors)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=8)
    onnx.checker.check_model(model, full_check=True)
    onnx.save_model(model, folder / f"{name}.onnx")


def layers(rng, sizes):
    for k, (n, m) in enumerate(zip(sizes, sizes[1:])):
        w = (rng.standard_normal((n, m)) / np.sqrt(n)).astype(np.float32)
        yield k, w, (0.1 * rng.standard_normal(m)).astype(np.float32)


def make(folder):
    rng = np.random.default_rng(4)
    scale = {
        "mean": np.where(np.arange(INPUTS) % 2 == 0, 60, -40).astype(np.float32)[None, :],
        "inv_std": np.full((INPUTS,), 1 / 35, np.float32),
    }
    normalise = [
        helper.make_node("Sub", ["obs", "mean"], ["centred"]),
        helper.make_node("Mul", ["inv_std", "centred"], ["x0"]),
    ]
    # torch: Gemm with transB, LeakyRelu and Elu with their own alpha, Sigmoid.
    nodes, weights = list(normalise), dict(scale)
    hidden = [("LeakyRelu", {"alpha": 0.2}), ("Elu", {"alpha": 1.3})]
    for k, w, b in layers(rng, [INPUTS, 256, 256, OUTPUTS]):
        weights[f"w{k}"], weights[f"b{k}"] = np.ascontiguousarray(w.T), b
        nodes.append(helper.make_node("Gemm", [f"x{k}", f"w{k}", f"b{k}"], [f"y{k}"], transB=1))
        op, attributes = hidden[k] if k < 2 else ("Sigmoid", {})
        nodes.append(helper.make_node(op, [f"y{k}"], [f"x{k + 1}" if k < 2 else "action"], **attributes))
    save(folder, "torch_style", nodes, weights, "batch", 17)
    # Stable-Baselines3 actor: MatMul and Add, tanh mapped to the duty, clipped; weights listed as inputs.
    nodes, weights = list(normalise), dict(scale)
    for k, w, b in layers(rng, [INPUTS, 64, 64, OUTPUTS]):
        weights[f"w{k}"], weights[f"b{k}"] = w, b
        nodes.append(helper.make_node("MatMul", [f"x{k}", f"w{k}"], [f"p{k}"]))
        nodes.append(helper.make_node("Add", [f"p{k}", f"b{k}"], [f"y{k}"]))
        nodes.append(helper.make_node("Relu" if k < 2 else "Tanh", [f"y{k}"], [f"x{k + 1}"]))
    weights |= {"half": np.array(0.5, np.float32), "low": np.array(0, np.float32), "high": np.array(1, np.float32)}
    nodes.append(helper.make_node("Mul", ["x3", "half"], ["m"]))
    nodes.append(helper.make_node("Add", ["m", "half"], ["a"]))
    nodes.append(helper.make_node("Clip", ["a", "low", "high"], ["action"]))
    save(folder, "sb3_style", nodes, weights, 1, 13, list_weights=True)
    # Gemm with alpha and beta, Softplus and Tanh, constants in nodes, shapes that change nothing.
    nodes, weights = list(normalise), dict(scale)
    nodes.append(helper.make_node("Flatten", ["x0"], ["f0"]))
    value = "f0"
    for k, w, b in layers(rng, [INPUTS, 48, 31, OUTPUTS]):
        nodes.append(helper.make_node("Constant", [], [f"w{k}"], value=numpy_helper.from_array(w, f"t{k}")))
        weights[f"b{k}"] = b[None, :]
        nodes.append(helper.make_node("Gemm", [value, f"w{k}", f"b{k}"], [f"y{k}"], alpha=0.7, beta=1.9))
        op = ["Softplus", "Tanh", "Sigmoid"][k]
        value = f"h{k}"
        nodes.append(helper.make_node(op, [f"y{k}"], [value]))
    nodes.append(helper.make_node("Constant", [], ["same"], value_ints=[-1, OUTPUTS]))
    nodes.append(helper.make_node("Reshape", [value, "same"], ["action"]))
    save(folder, "odd_style", nodes, weights, "N", 20)
    rows = observations(200)
    rows.tofile(folder / "inputs.f32")
    for model in sorted(folder.glob("*_style.onnx")):
        run(str(model), rows).astype("<f4").tofile(model.with_suffix(".f32"))


if __name__ == "__main__":
    if sys.argv[1] == "make":
        make(Path(sys.argv[2]))
    else:
        onnx.checker.check_model(sys.argv[2], full_check=True)
        rows = np.fromfile(sys.argv[3], "<f4").reshape(-1, INPUTS)
        run(sys.argv[2], rows).astype("<f4").tofile(sys.argv[4])

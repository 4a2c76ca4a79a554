"""Second opinion for tests/onnxruntime.rs.

run MODEL INPUTS OUTPUTS    checks MODEL, runs it on the f32 rows of INPUTS: row by row, then all in one batch
describe MODEL GOLDEN       prints signature and metadata of MODEL, writes its golden numbers as f32
"""

import sys

import numpy as np
import onnx
import onnxruntime


def run(model, inputs, outputs):
    onnx.checker.check_model(model, full_check=True)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.log_severity_level = 3
    session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    port = session.get_inputs()[0]
    rows = np.fromfile(inputs, "<f4").reshape(-1, port.shape[1])
    answer = lambda x: session.run(None, {port.name: x})[0]
    each = np.concatenate([answer(row[None, :]) for row in rows])
    np.concatenate([each, answer(rows)]).astype("<f4").tofile(outputs)


def describe(model, golden):
    model = onnx.load(model)
    onnx.checker.check_model(model, full_check=True)
    opset = model.opset_import[0].version
    print(f"ir {model.ir_version} opset {opset} producer {model.producer_name} {model.producer_version}")
    ports = [model.graph.input[0], model.graph.output[0]]
    sizes = [[d.dim_param or d.dim_value for d in p.type.tensor_type.shape.dim] for p in ports]
    print(*(word for port, size in zip(ports, sizes) for word in (port.name, size)))
    said = {entry.key: entry.value for entry in model.metadata_props}
    for key, value in said.items():
        print(f"{key}={value}")
    numbers = (said["golden_input"] + ";" + said["golden_output"]).replace(";", ",").split(",")
    np.array([np.float32(n) for n in numbers], "<f4").tofile(golden)


if __name__ == "__main__":
    {"run": run, "describe": describe}[sys.argv[1]](*sys.argv[2:])

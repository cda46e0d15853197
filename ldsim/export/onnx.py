"""The decoder and the encoder as ONNX graphs, for any runtime that plays neural networks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ldsim.arrays import Array
from ldsim.run import Run
from ldsim.space.activation import ACTIVATIONS

# All operators used are older than this version of the standard, which current runtimes read.
OPSET, IR_VERSION = 17, 8
OPERATORS = {"elu": "Elu", "relu": "Relu", "tanh": "Tanh", "sigmoid": "Sigmoid"}


def write_onnx(run: Run, folder: Path) -> None:
    """Write decoder.onnx, z (N, r) → q (N, k), and encoder.onnx, q (N, k) → z (N, r); float32, any batch size N."""
    decoder, encoder = run.model.decoder, run.model.encoder
    activation = next(name for name, number in ACTIVATIONS.items() if number == decoder.layers.activation)
    folder.mkdir(exist_ok=True)
    _write(
        *(folder / "decoder.onnx", ("z", "q"), decoder.weights, decoder.biases),
        *(activation, decoder.layers.rest, decoder.skip),
    )
    _write(
        *(folder / "encoder.onnx", ("q", "z"), encoder.weights, encoder.biases),
        *(encoder.activation, encoder.rest, None),
    )


def _write(
    path: Path,
    ends: tuple[str, str],
    weights: Sequence[Array],
    biases: Sequence[Array],
    activation: str,
    rest: Array,
    skip: Array | None,
) -> None:
    """Write x → N(x) − rest + x skip for a perceptron N of (in, out) weights; `ends` name input and output."""
    # An optional dependency: `formats.FORMATS` says so before this is called.
    from onnx import TensorProto, checker, helper, numpy_helper, save_model

    last = len(weights) - 1
    arrays: dict[str, Array] = {}
    nodes, x = [], ends[0]
    for i, (weight, bias) in enumerate(zip(weights, biases, strict=True)):
        arrays |= {f"weights_{i}": weight, f"biases_{i}": bias - rest if i == last else bias}
        nodes.append(helper.make_node("Gemm", [x, f"weights_{i}", f"biases_{i}"], [f"linear_{i}"]))
        x = f"linear_{i}"
        if i < last:
            nodes.append(helper.make_node(OPERATORS[activation], [x], [f"hidden_{i}"]))
            x = f"hidden_{i}"
    if skip is None:
        nodes.append(helper.make_node("Identity", [x], [ends[1]]))
    else:
        arrays["skip"] = skip
        nodes += [
            helper.make_node("MatMul", [ends[0], "skip"], ["skipped"]),
            helper.make_node("Add", [x, "skipped"], [ends[1]]),
        ]
    sizes = (weights[0].shape[0], weights[-1].shape[1])
    shapes = [
        helper.make_tensor_value_info(end, TensorProto.FLOAT, ["N", n]) for end, n in zip(ends, sizes, strict=True)
    ]
    tensors = [numpy_helper.from_array(array.astype(np.float32), name) for name, array in arrays.items()]
    graph = helper.make_graph(nodes, path.stem, shapes[:1], shapes[1:], tensors)
    opsets = [helper.make_opsetid("", OPSET)]
    model = helper.make_model(graph, producer_name="ldsim", ir_version=IR_VERSION, opset_imports=opsets)
    checker.check_model(model, full_check=True)
    save_model(model, path)

"""ONNX, played by the reference implementation of the standard."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ldsim.export.onnx import write_onnx
from ldsim.space.activation import ACTIVATIONS
from ldsim.space.decoder import Decoder
from ldsim.space.encoder import Encoder

K, R, HIDDEN = 7, 3, 5


class Trained:
    """All that the exporter reads of a run: a network of random weights, with biases that move its value at 0."""

    def __init__(self, activation: str, skip: bool) -> None:
        rng = np.random.default_rng(4)

        def network(*sizes: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
            pairs = list(zip(sizes[:-1], sizes[1:], strict=True))
            return [rng.normal(size=pair) for pair in pairs], [rng.normal(size=pair[1]) for pair in pairs]

        extra = rng.normal(size=(R, K)) if skip else None
        self.decoder = Decoder.network(*network(R, HIDDEN, HIDDEN, K), activation=activation, skip=extra)
        weights, biases = network(K, HIDDEN, R)
        self.encoder = Encoder(tuple(weights), tuple(biases), activation)

    @property
    def model(self) -> Trained:
        return self


@pytest.mark.parametrize("skip", [False, True])
@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_onnx_decodes_and_encodes_as_the_model_does(tmp_path: Path, activation: str, skip: bool) -> None:
    onnx = pytest.importorskip("onnx", reason="onnx is not installed: pip install 'ldsim[onnx]'")
    from onnx.reference import ReferenceEvaluator

    trained = Trained(activation, skip)
    write_onnx(trained, tmp_path)  # type: ignore[arg-type]
    rng = np.random.default_rng(5)
    for name, function, size in (("decoder", trained.decoder, R), ("encoder", trained.encoder, K)):
        model = onnx.load(tmp_path / f"{name}.onnx")
        (given,) = (entry.name for entry in model.graph.input)
        points = np.vstack([np.zeros(size), rng.normal(size=(20, size))])
        (found,) = ReferenceEvaluator(model).run(None, {given: points.astype(np.float32)})
        np.testing.assert_allclose(found, function(points), rtol=1e-5, atol=1e-5)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["decoder.onnx", "encoder.onnx"]

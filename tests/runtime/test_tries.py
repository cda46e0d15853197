"""Of the tries of a step the C library takes and tells the one that the simulator in Python does."""

from __future__ import annotations

import ctypes
import subprocess
from pathlib import Path

import numpy as np
import pytest

from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.runtime import source
from ldsim.runtime.library import Library, NativeModel, NativeSolid
from ldsim.runtime.model_file import model_bytes
from ldsim.simulator import Simulator
from tests.runtime.problems import latent
from tests.runtime.test_library import OUTCOMES
from tests.simulator.reluctant import ENDINGS, Reluctant

STEP = "ldsim_outcome ldsim_step(ldsim_solid *S"


@pytest.fixture(scope="module")
def reluctant(cc: str, sources: Path, tmp_path_factory: pytest.TempPathFactory) -> Library:
    """The library, with tries that can be told how to end."""
    folder = tmp_path_factory.mktemp("tries")
    before, after = source("ldsim.c").split(STEP)
    between = Path(__file__).with_name("reluctant_step.c").read_text(encoding="utf-8")
    (folder / "tries.c").write_text(before + between + STEP + after, encoding="utf-8")
    command = [cc, "-std=c99", "-O2", "-shared", "-fPIC", f"-I{sources}", "tries.c", "-o", "tries.so", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    return Library(folder / "tries.so")


@pytest.mark.parametrize("name", ENDINGS)
def test_the_try_that_the_simulator_takes_is_taken_and_told(reluctant: Library, name: str) -> None:
    space, options, ending = latent(), ReducedOptions(tolerance=1e-8), ENDINGS[name]
    stepper = Reluctant(ReducedStepper(space, options))
    simulator, solid = Simulator(space, stepper), NativeSolid(NativeModel(reluctant, model_bytes(space, options)))
    x, size = space.scene.mesh.vertices, space.scene.mesh.diagonal
    tip = x[x[:, 0].argmax()]
    simulator.grab(tip, tip + 0.2 * size, 50.0)
    solid.grab(tip, tip + 0.2 * size, 50.0)
    for _ in range(3):
        simulator.step()
        solid.step()
    stepper.told(ending.tries)
    reasons, away = ((ctypes.c_int * len(ending.tries))(*each) for each in zip(*ending.tries, strict=True))
    reluctant.functions.ldsim_tell(len(ending.tries), reasons, away)
    record, told = simulator.step(), solid.step()
    assert (record.outcome, record.reason) == (OUTCOMES[told[3]], told[2]) == (ending.outcome, ending.reason)
    assert (record.iterations, record.evaluations) == told[:2]
    for _ in range(2):
        np.testing.assert_allclose(solid.displacements(), simulator.displacement(), atol=1e-9 * size)
        assert (simulator.step().outcome, solid.step()[3]) == (OUTCOMES[0], 0)

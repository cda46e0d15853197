"""The library as WebAssembly: made of the sources as they are, and its steps are those of Python."""

from __future__ import annotations

import base64
import importlib.util
import re
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ldsim.arrays import Array
from ldsim.cubature.rule import CubatureRule
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.export.formats import Choice, export
from ldsim.mechanics.grabs import held_vertices
from ldsim.mechanics.motion import Drag
from ldsim.mesh.shapes import beam
from ldsim.run import Run
from ldsim.runtime import webassembly
from ldsim.runtime.model_file import checksum, model_bytes, pieces
from ldsim.space.space import Space
from tests.helpers import reduced_space, scene, smooth_basis
from tests.report.small_run import write_run
from tests.runtime.javascript import NODE, needs_chromium, needs_node, run_in_chromium, run_javascript
from tests.runtime.problems import SPACES, latent, loads
from tools import wasm

FRAMES = 1000
TIGHT = ReducedOptions(tolerance=1e-8)
# Pins do not move in a page, so its JavaScript does not know them.
NAMES = [name for name in SPACES if "pins" not in name]
PLAY = """
result = given.map(({ model, frames }) => {
  const solid = new Solid(unpacked(model)), grabs = new Map();
  return frames.map(({ pulls, gravity }) => {
    for (const [key, grab] of grabs) if (!(key in pulls)) (solid.release(grab), grabs.delete(key));
    for (const [key, { vertices, target, stiffness }] of Object.entries(pulls)) {
      if (grabs.has(key)) solid.move(grabs.get(key), target);
      else grabs.set(key, solid.grab(vertices, target, stiffness));
    }
    solid.setGravity(gravity);
    const { iterations, outcome } = solid.step();
    return { iterations, outcome, features: Array.from(solid.features) };
  });
});
"""


def test_the_committed_module_is_made_of_the_sources_as_they_are() -> None:
    assert webassembly().endswith(wasm.stamp()), "run `python -m tools.wasm` (pip install -e '.[wasm]') and commit it"


@pytest.mark.skipif(
    importlib.util.find_spec("ziglang") is None, reason="ziglang is not installed: pip install 'ldsim[wasm]'"
)
def test_compiled_again_the_module_is_the_same() -> None:
    assert wasm.compiled() + wasm.stamp() == webassembly()


def enormous() -> bytes:
    """A small file of a model whose solids need a little more than 2³² bytes, of layers 1, 8070 and 2 wide."""
    r, widths = 8191, (1, 8070, 2)
    counts = np.zeros(29, "<u4")
    counts[[0, 2, 3, 4]] = 1, r, r, len(widths)
    counts[5:8], counts[[16, 17, 26, 27]] = widths, (1, 1, 8, 100)
    numbers = np.array([0.01, 0, -9.81, 0, 1e-6, 1, 1, 1, 0.1, 0, 0, 0])
    layers = sum((rows + 1) * columns for rows, columns in zip((r, *widths), widths, strict=False))
    arrays = [np.zeros(3 + layers + widths[-1] + 9), np.ones(3 + r), np.zeros((1 + 3 + 3) * r)]
    body = b"".join(array.tobytes() for array in arrays) + np.array([1, 0], "<u8").tobytes()  # movable, of material 0
    rest = counts.tobytes() + bytes(4) + numbers.tobytes() + body
    head = b"LDSIM\r\n\x1a" + np.array([3, 256], "<u4").tobytes() + np.array([40 + len(rest)], "<u8").tobytes()
    return head + checksum(rest) + rest


@needs_node
def test_a_solid_that_is_larger_than_the_memory_of_a_page_is_refused() -> None:
    """Counted in 32 bits it would be a small one, and all that is done with it outside of its memory."""
    program = """
    const model = unpacked(given);
    try { new Solid(model, 0); result = "created"; } catch (error) { result = error.message; }
    """
    assert run_javascript(program, base64.b64encode(enormous()).decode()) == "there is not enough memory"


def played(space: Space) -> dict[str, Any]:
    """A model and what acts on it in each frame, for `PLAY`."""
    frames = [
        {
            "pulls": {
                str(grab.vertices[0]): {
                    "vertices": grab.vertices.tolist(),
                    "target": grab.target.tolist(),
                    "stiffness": grab.stiffness,
                }
                for grab in acting.grabs
            },
            "gravity": (space.scene.gravity if acting.gravity is None else acting.gravity).tolist(),
        }
        for acting in loads(space, FRAMES)
    ]
    return {"model": base64.b64encode(model_bytes(space, TIGHT)).decode(), "frames": frames}


@pytest.fixture(scope="module")
def stepped() -> dict[str, Array]:
    """What the steps in Python come to, the coordinates of each frame, (N, k), by name."""
    found = {}
    for name in NAMES:
        space = SPACES[name]()
        stepper = ReducedStepper(space, TIGHT)
        state = stepper.rest()
        coordinates = []
        for acting in loads(space, FRAMES):
            state, _ = stepper.step(state, acting)
            coordinates.append(state.q)
        found[name] = np.array(coordinates)
    return found


@pytest.mark.parametrize(
    "host",
    [pytest.param(run_javascript, marks=needs_node), pytest.param(run_in_chromium, marks=needs_chromium)],
    ids=["node", "chromium"],
)
def test_a_thousand_frames_with_grabs_agree_in_every_space_and_material(
    host: Callable[[str, object], Any], stepped: dict[str, Array]
) -> None:
    spaces = [SPACES[name]() for name in NAMES]
    found = host(PLAY, [played(space) for space in spaces])
    for name, space, frames in zip(NAMES, spaces, found, strict=True):
        # a model's features are not the space's where its last layer is in what it draws by
        basis = pieces(space.by_material(), TIGHT, single=False).arrays["basis"]
        expected = stepped[name] @ space.reduced_basis.matrix.T
        u = np.array([frame["features"] for frame in frames]) @ basis.T
        assert {frame["outcome"] for frame in frames} == {0}, name
        assert np.abs(u - expected).max() <= 1e-9 * np.abs(expected).max(), name


@needs_node
def test_a_pull_in_a_page_takes_hold_of_the_same_vertices() -> None:
    body = scene(beam(resolution=2))
    space = reduced_space(body, smooth_basis(body, 6), rule=CubatureRule(np.arange(3), np.ones(3), 0.0))
    x = body.mesh.vertices
    point, radius = x[x[:, 0].argmax()] + 1e-3, 0.7 * np.ptp(x[:, 1])
    expected = held_vertices(Drag(0, point, point[None], radius, 1.0), x, body.movable, body.mesh.diagonal)
    given = {"model": base64.b64encode(model_bytes(space)).decode(), "point": point.tolist(), "radius": radius}
    assert 1 < len(expected) < body.mesh.n_vertices / 2
    assert run_javascript("result = unpacked(given.model).held(given.point, given.radius);", given) == expected.tolist()


@needs_node
def test_what_a_page_draws_by_and_what_it_is_refused() -> None:
    space = latent()
    program = """
    const model = unpacked(given), some = [5, 0], fields = Array.from(model.fields(some));
    const words = [];
    const attempts = [() => unpacked(btoa("nothing")), () => new Solid(model).release(3), () => model.fields([1e6])];
    for (const attempt of attempts) try { attempt(); } catch (error) { words.push(error.message); }
    result = { fields, words, rest: Array.from(model.rest), gravity: model.gravity, h: model.timeStep };
    """
    found = run_javascript(program, base64.b64encode(model_bytes(space, single=True)).decode())
    basis = space.reduced_basis.fields.astype(np.float32)
    np.testing.assert_array_equal(found["fields"], basis[[5, 0]].ravel())
    np.testing.assert_array_equal(found["rest"], space.scene.mesh.vertices.ravel())
    assert found["gravity"] == space.scene.gravity.tolist() and found["h"] == space.scene.time_step
    told = ("this is no model of ldsim", "there is no such grab", "an argument is out of range")
    assert all(words.startswith(start) for words, start in zip(found["words"], told, strict=True))


@needs_node
def test_the_exported_example_runs_in_node(tmp_path: Path) -> None:
    write_run(tmp_path)
    with Run.open(tmp_path) as run:
        n, (folder, _) = run.scene.mesh.n_vertices, export(run, Choice("wasm"), tmp_path / "made")
    done = subprocess.run([str(NODE), "example.mjs"], cwd=folder, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) == 5 and "held at" in done.stdout
    # the same solid elsewhere is pulled as far
    data = bytearray((folder / "model.ldsim").read_bytes())
    rest = np.frombuffer(data, "<f8", 3 * n, 256).reshape(-1, 3) + [9.0, 0.0, 0.0]
    data[256 : 256 + 24 * n] = rest.tobytes()
    data[24:40] = checksum(bytes(data[40:]))
    (folder / "model.ldsim").write_bytes(data)
    moved = subprocess.run([str(NODE), "example.mjs"], cwd=folder, capture_output=True, text=True, timeout=60)
    first, second = (
        [re.findall(r"-?\d+\.\d+", line)[1] for line in each.stdout.splitlines()] for each in (done, moved)
    )
    np.testing.assert_allclose(np.array(second, float), np.array(first, float) + 9.0, atol=2e-4)


@needs_node
def test_what_is_destroyed_gives_its_memory_back_and_throws() -> None:
    """Address 0 is memory like any other in WebAssembly: a call on a solid that is gone would write there."""
    program = """
    const bytes = () => runtime.library.memory.buffer.byteLength;
    const once = () => {
      const model = unpacked(given), solid = new Solid(model);
      solid.step();
      return [model, solid];
    };
    const [model, solid] = once();
    const many = () => {
      for (let i = 0; i < 200; i++) for (const each of once().reverse()) each.destroy();
      return bytes();
    };
    const before = many(), after = many();
    solid.destroy(), solid.destroy(), model.destroy(), model.destroy();
    let thrown = 0;
    for (const call of [() => solid.step(), () => solid.reset(), () => solid.setGravity([0, 0, 0])])
      try { call(); } catch { thrown++; }
    result = [before, after, thrown];
    """
    model = base64.b64encode(model_bytes(latent())).decode()
    before, after, thrown = run_javascript(program, model)
    assert before == after and thrown == 3

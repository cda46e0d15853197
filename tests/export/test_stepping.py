"""The step in JavaScript against the step in Python: materials, tangents, decoder, held vertices, whole motions."""

from __future__ import annotations

import base64
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.cubature.rule import CubatureRule
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.simulate import simulate
from ldsim.export.arrays import safetensors, space_arrays
from ldsim.mechanics.grabs import held_vertices
from ldsim.mechanics.materials import MATERIALS
from ldsim.mechanics.motion import Drag, Motion
from ldsim.mechanics.scene import Scene
from ldsim.mesh.shapes import beam
from ldsim.space.activation import ACTIVATIONS
from ldsim.space.basis import inner_product
from ldsim.space.decoder import Decoder
from ldsim.space.pca import orthonormalised
from ldsim.space.space import Space
from ldsim.web import PAGE_MATERIALS
from tests.export.javascript import needs_node, run_javascript
from tests.helpers import bent, reduced_space, scene
from tests.mechanics.material_vectors import LAM, MU, read, stress_change

pytestmark = needs_node

Array = NDArray[np.float64]
K, R, FRAMES = 6, 4, 100

TRY_MATERIALS = """
result = given.map(([kind, F, mu, lam]) => {
  const [density, P] = material(kind).energyStress(F, mu, lam);
  const parts = material(kind).tangent(F, mu, lam, true);
  return { density: density === Infinity ? "infinite" : density, P, tangent: parts };
});
"""
PLAY = """
function unpack(text) {
  const bytes = Buffer.from(text, "base64");
  return readSafetensors(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length));
}
result = given.map(({ model, grabs, taken }) => {
  const arrays = unpack(model), space = spaceOf(arrays, "some");
  const stepper = new Stepper(space, arrays.time_step.data[0]);
  stepper.potential.setGravity(arrays.gravity.data);
  let before = "", springs = [];
  return grabs.map((now) => {
    const key = JSON.stringify(now.map((grab) => grab.drag));
    if (key !== before) {
      springs = now.map((grab) => springOn(arrays.vertices, arrays.basis, taken[grab.drag], grab.stiffness, space.k));
      stepper.potential.springs = springs;
      stepper.renew();
      before = key;
    }
    now.forEach((grab, i) => springs[i].target.set(grab.target));
    const { converged, iterations } = stepper.step();
    return { q: Array.from(stepper.q), converged, iterations };
  });
});
"""


@pytest.fixture(scope="module")
def answers() -> dict[str, list[Any]]:
    """Every material at the committed deformations, from one run of node."""
    vectors = {name: read()[name] for name in PAGE_MATERIALS}
    cases = [[MATERIALS[name], case["F"], MU, LAM] for name in vectors for case in vectors[name]]
    results = iter(run_javascript(TRY_MATERIALS, cases))
    return {name: [next(results) for _ in vectors[name]] for name in vectors}


@pytest.mark.parametrize("name", PAGE_MATERIALS)
def test_a_material_has_the_same_energy_stress_and_tangent(answers: dict[str, list[Any]], name: str) -> None:
    for case, answer in zip(read()[name], answers[name], strict=True):
        if case["density"] is None:
            assert answer["density"] == "infinite"
            continue
        assert answer["density"] == pytest.approx(case["density"], rel=1e-12, abs=1e-9)
        np.testing.assert_allclose(answer["P"], case["stress"], rtol=1e-10, atol=1e-9 * MU)
        change = stress_change(*answer["tangent"], np.reshape(case["dF"], (3, 3)))
        np.testing.assert_allclose(change.ravel(), case["clamped_change"], rtol=1e-8, atol=1e-8 * MU)


def test_a_material_that_the_page_does_not_have_is_no_other_one() -> None:
    program = """
    try { result = material(given); }
    catch (error) { result = error.message; }
    """
    assert run_javascript(program, 99) == "no material has the number 99"


def some_basis(body: Scene) -> Array:
    """Smooth displacements that vanish at the pins, mass-orthonormal, (3n, K)."""
    x = body.mesh.vertices
    rng = np.random.default_rng(0)
    s = (x[:, 0] - x[:, 0].min()) / np.ptp(x[:, 0])
    fields = [s[:, None] ** (1 + i % 3) * (rng.normal(size=3) + x @ rng.normal(size=(3, 3)) * 5) for i in range(K)]
    return orthonormalised(np.stack([f.ravel() for f in fields], axis=1), inner_product(body.mass, "mass")).matrix


def loaded(body: Scene) -> Scene:
    """The same solid with a dead load that differs from vertex to vertex."""
    load = np.random.default_rng(2).normal(size=body.mesh.vertices.shape) * 0.3 * np.abs(body.external_force).max()
    return replace(body, load=load)


def curved(activation: str) -> Decoder:
    rng = np.random.default_rng(1)
    weights = [rng.normal(size=(R, 8)), rng.normal(size=(8, 8)), rng.normal(size=(8, K)) * 0.02]
    return Decoder.network(weights, [rng.normal(size=8), rng.normal(size=8), np.zeros(K)], activation, np.eye(R, K))


def swing(body: Scene) -> Motion:
    """Two drags and free motion after each, so that springs come and go."""
    tip = body.mesh.vertices[body.mesh.vertices[:, 0].argmax()]
    reach = 0.1 * body.mesh.diagonal
    ramp = np.minimum(np.arange(1, 31) / 20, 1.0)[:, None]
    ways = (np.array([0, 1.0, 0.4]), np.array([0.2, -0.7, -0.8]))
    drags = [Drag(10 + 45 * i, tip, tip + reach * ramp * way, 0.3 * reach, 25.0, True) for i, way in enumerate(ways)]
    return Motion("swing", FRAMES, tuple(drags))


def packed(space: Space) -> str:
    body = space.scene
    arrays = {
        "vertices": body.mesh.vertices,
        "basis": space.reduced_basis.matrix,
        "surface_triangles": np.array([[0, 1, 2]], dtype=np.int32),
        "movable": body.movable.astype(np.uint8),
        "time_step": np.array([body.time_step]),
        "gravity": body.gravity,
    }
    some = {f"some/{name}": values for name, values in space_arrays(space).items()}
    return base64.b64encode(safetensors(arrays | some, {})).decode()


CASES = [(name, "elu") for name in PAGE_MATERIALS]
CASES += [("neo_hookean", other) for other in (*ACTIVATIONS, "identity")][1:]


def test_a_motion_of_a_hundred_frames_is_the_same_in_every_material_and_decoder() -> None:
    given, expected = [], []
    for material, activation in CASES:
        body = loaded(scene(beam(resolution=1), material, youngs_modulus=5e4))
        decoder = Decoder.identity(K) if activation == "identity" else curved(activation)
        points = np.arange(0, body.points.n_points, 3)
        cubature = CubatureRule(points, 3 * body.points.weights[points], 0.0)
        U, motion = some_basis(body), swing(body)
        space = reduced_space(body, U, decoder, cubature)
        frames = list(simulate(ReducedStepper(space, ReducedOptions(tolerance=1e-9, max_iterations=500)), motion))
        q, iterations = np.array([f.state.q for f in frames]), [f.solution.iterations for f in frames]
        expected.append((q, iterations, U))
        grabs = [
            [
                {"drag": i, "stiffness": motion.drags[i].stiffness, "target": target.tolist()}
                for i in motion.active(frame)
                for target in [motion.drags[i].targets[frame - motion.drags[i].start]]
            ]
            for frame in range(FRAMES)
        ]
        held = {drag: vertices.tolist() for drag, vertices in frames[-1].held.items()}
        given.append({"model": packed(space), "grabs": grabs, "taken": held})
    for case, played, (q, iterations, U) in zip(CASES, run_javascript(PLAY, given), expected, strict=True):
        assert all(frame["converged"] for frame in played), case
        u, u_expected = (np.array(x) @ U.T for x in ([frame["q"] for frame in played], q))
        assert np.abs(u_expected).max() > 0.01
        assert np.abs(u - u_expected).max() <= 1e-6 * np.abs(u_expected).max(), case
        assert sum(frame["iterations"] for frame in played) <= 2 * max(sum(iterations), FRAMES), case


def test_a_drag_takes_hold_of_the_same_vertices() -> None:
    body = scene(beam(resolution=2))
    U = orthonormalised(bent(body.mesh).reshape(-1, 1) * np.repeat(body.movable, 3)[:, None], body.mass).matrix
    q = U.T @ (body.mass @ (bent(body.mesh) * body.movable[:, None])).ravel()
    space = reduced_space(body, U, rule=CubatureRule(np.arange(3), np.ones(3), 0.0))
    positions = body.mesh.vertices + (U @ q).reshape(-1, 3)
    point, radius = positions[body.mesh.vertices[:, 0].argmax()] + 1e-3, 0.4 * np.ptp(body.mesh.vertices[:, 1])
    drag = Drag(0, point, point[None], radius, 1.0)
    expected = held_vertices(drag, positions, body.movable, body.mesh.diagonal)
    program = """
    const bytes = Buffer.from(given.model, "base64");
    const arrays = readSafetensors(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length));
    const rest = arrays.vertices.data, positions = new Float64Array(rest.length);
    displaced(rest, arrays.basis.data, 1, Float64Array.from(given.q), positions);
    result = held(positions, arrays.movable.data, given.point, given.radius);
    """
    given = {"model": packed(space), "point": point.tolist(), "radius": radius, "q": q.tolist()}
    assert 1 < len(expected) < body.mesh.n_vertices / 2
    assert run_javascript(program, given) == expected.tolist()

"""The stage mesh: when the tets of a surface are made anew, and what is said of a mesh in parts."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest

from ldsim.mesh.options import SurfaceOptions
from ldsim.mesh.shapes import beam
from ldsim.pipeline.mesh import described_scene, surface_identity
from ldsim.pipeline.options import MeshOptions
from tests.pipeline.test_snapshot import Told

GIVEN = SurfaceOptions(file="a.stl", cells=100)


def test_the_identity_of_a_surface_is_of_what_shapes_its_tets_alone(tmp_path: Path) -> None:
    places = [tmp_path / name for name in ("a.stl", "b.stl", "c.stl")]
    for place, content in zip(places, ("same", "same", "other"), strict=True):
        place.write_text(content)
    a, b, c = places
    one = surface_identity(a, GIVEN, 1.0, 0)
    assert surface_identity(b, GIVEN.replace(file="b.stl", timeout=60.0), 1.0, 0) == one
    more, envelope = GIVEN.replace(cells=200), GIVEN.replace(envelope=0.1)
    others = [(c, GIVEN, 1.0, 0), (a, more, 1.0, 0), (a, envelope, 1.0, 0), (a, GIVEN, 0.1, 0), (a, GIVEN, 1.0, 1)]
    assert len({one, *(surface_identity(*other) for other in others)}) == 6


@pytest.mark.parametrize("gap, told", [(0.0, 1), (0.01, 0)])
def test_parts_that_touch_without_being_joined_are_warned_of(tmp_path: Path, gap: float, told: int) -> None:
    part = beam(0.4, 0.1, 0.1, 1)
    vertices = np.vstack([part.vertices, part.vertices + [0, 0.1 + gap, 0]])
    cells = np.vstack([part.cells, part.cells + part.n_vertices])
    meshio.Mesh(vertices, [("tetra", cells)]).write(tmp_path / "parts.vtu")
    pins = [{"slab": {"axis": "x", "at": "min", "thickness": 0.001}}]
    options = {"file": "parts.vtu", "material": {"youngs_modulus": 1e5}, "pins": pins}
    progress = Told()
    described_scene(MeshOptions.model_validate(options), progress, tmp_path)
    assert len(progress.lines) == told
    for line in progress.lines:
        assert line.startswith("warning: 20 vertices lie where vertices of another part do; the parts are not joined")

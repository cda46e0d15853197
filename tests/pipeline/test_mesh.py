"""The stage mesh: when the tets of a surface are made anew."""

from __future__ import annotations

from pathlib import Path

from ldsim.mesh.options import SurfaceOptions
from ldsim.pipeline.mesh import surface_identity

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

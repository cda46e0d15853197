"""Meshes, materials, pins and loads that `ldsim mesh` refuses in one line."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.cli.experiments import TINY, Experiment, change, refusal

TETS = """MeshVersionFormatted 1
Dimension 3
Vertices
5
0 0 0 0
1 0 0 0
0 1 0 0
0 0 1 0
{apex} 0
Tetrahedra
2
1 2 3 4 0
{cell} 0
End
"""


def mesh_file(name: str, content: str | None) -> Callable[[Experiment], None]:
    def spoil(experiment: Experiment) -> None:
        if content is not None:
            (experiment.folder / name).write_text(content, encoding="utf-8")
        experiment.change("mesh.shape", ...)
        text = experiment.config.read_text(encoding="utf-8")
        experiment.config.write_text(text.replace("mesh:\n", f"mesh:\n  file: {name}\n", 1), encoding="utf-8")

    return spoil


def add(experiment: Experiment, section: str, line: str) -> None:
    """Add a line to a section of the configuration as it is."""
    text = experiment.config.read_text(encoding="utf-8")
    experiment.config.write_text(text.replace(f"{section}:\n", f"{section}:\n  {line}\n", 1), encoding="utf-8")


def surface_file(content: str, **settings: object) -> Callable[[Experiment], None]:
    def spoil(experiment: Experiment) -> None:
        (experiment.folder / "a.off").write_text(content, encoding="utf-8")
        mesh = {key: value for key, value in TINY["mesh"].items() if key != "shape"}
        surface = {"file": "a.off", "edge_length": 0.1} | settings
        experiment.configure(TINY | {"mesh": mesh | {"surface": surface}})

    return spoil


CORNERS = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
TETRAHEDRON = f"OFF\n4 4 0\n{CORNERS}3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"
FIN = f"OFF\n5 5 0\n{CORNERS}1 1 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n3 0 1 4\n"
HEXES = {"refine": 1, "shape": {"name": "beam", "cell_type": "hex8"}}
GOOD = TETS.format(apex="0 0 -1", cell="1 3 2 5")
MESHES: dict[str, tuple[Callable[[Experiment], object], str]] = {
    "missing": (mesh_file("no.mesh", None), "no.mesh does not exist"),
    "missing from the data": (mesh_file("$LDSIM_DATA/no.mesh", None), "lawsonfulton/AutoDef"),
    "empty": (mesh_file("a.mesh", ""), "a.mesh is empty"),
    "truncated": (mesh_file("a.mesh", GOOD[: GOOD.index("0 0 1 0")]), "a.mesh is not a readable .mesh file"),
    "foreign": (mesh_file("a.vtk", "%PDF-1.4\n"), "a.vtk is not a readable .vtk file"),
    "of an unknown format": (mesh_file("a.doc", GOOD), "unknown extension '.doc'"),
    "a surface": (mesh_file("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"), "holds no tetrahedra"),
    "a surface that is not manifold": (surface_file(FIN), "a.off: the surface is not manifold: 1 of its edges"),
    "an open surface": (surface_file(TETRAHEDRON.replace("4 4 0", "4 3 0")), "a.off: the surface is open: 1 holes"),
    "edges as long as the surface": (surface_file(TETRAHEDRON, edge_length=1.0), "a.off: the edge length is 1 m"),
    "two targets": (surface_file(TETRAHEDRON, cells=100), "mesh.surface: give exactly one of edge_length, cells"),
    "hexes to refine": (change("mesh", TINY["mesh"] | HEXES), "only tet4 meshes can be refined"),
    "inverted cells": (mesh_file("a.mesh", TETS.format(apex="0 0 -1", cell="1 2 3 5")), "mesh.reorient"),
    "flat cells": (mesh_file("a.mesh", TETS.format(apex="1 1 0", cell="1 2 3 5")), "volume"),
    "flat cells under a load": (
        lambda experiment: (
            mesh_file("a.mesh", TETS.format(apex="1 1 0", cell="1 2 3 5"))(experiment),
            add(experiment, "mesh", "loads: [{acceleration: [0, 0, 1], where: {slab: {axis: x, thickness: 9}}}]"),
        ),
        "volume",
    ),
    "NaN coordinates": (mesh_file("a.mesh", TETS.format(apex="0 0 nan", cell="1 3 2 5")), "must be finite"),
    "vertices out of range": (mesh_file("a.mesh", TETS.format(apex="0 0 -1", cell="1 3 2 9")), "a.mesh"),
    "an unknown shape": (change("mesh.shape.name", "sphere"), "known are beam, mounted_bar"),
    "pins that hold nothing": (change("mesh.pins", [{"ball": {"centre": [9, 9, 9], "radius": 0.1}}]), "pins no vertex"),
    "pins of an unknown group": (
        change("mesh.pins", [{"group": "feet"}]),
        "no group 'feet'; known are none: its file defines no groups",
    ),
    "pins of an unknown vertex": (change("mesh.pins", [{"vertices": [1, 99999]}]), "vertex 99999 of a list does not"),
    "an empty set of pins": (change("mesh.pins", []), "mesh.pins: give at least 1"),
    "a negative modulus": (change("mesh.material.youngs_modulus", -1.0), "should be greater than 0, got -1.0"),
    "an incompressible solid": (change("mesh.material.poisson_ratio", 0.5), "should be less than 0.5, got 0.5"),
    "a region without cells": (
        change("mesh.regions", [{"where": {"ball": {"centre": [9, 9, 9], "radius": 0.1}}, "density": 1}]),
        "changes no cell; the solid spans",
    ),
    "cell data that is not there": (
        lambda experiment: (
            mesh_file("a.mesh", GOOD)(experiment),
            add(experiment, "mesh", "cell_data: {density: rho}"),
        ),
        "gives no number 'rho' to its cells; known are medit:ref",
    ),
    "a load on no surface": (
        change("mesh.loads", [{"where": {"ball": {"centre": [9, 9, 9], "radius": 0.1}}, "pressure": 1}]),
        "holds no face of the surface",
    ),
    "pins that hold all": (change("mesh.pins", [{"slab": {"axis": "x", "thickness": 9}}]), "at least one must be free"),
}


@pytest.mark.parametrize("case", MESHES)
def test_a_bad_mesh(experiment: Experiment, case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("LDSIM_DATA", raising=False)
    spoil, words = MESHES[case]
    spoil(experiment)
    assert words in refusal(experiment, "mesh")


def test_the_mesh_file_that_the_bad_ones_are_made_from_is_good(experiment: Experiment) -> None:
    mesh_file("a.mesh", GOOD)(experiment)
    assert experiment.invoke("mesh").exit_code == 0

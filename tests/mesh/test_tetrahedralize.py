"""Surfaces filled by fTetWild: what any such mesh satisfies, since no two are the same."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ldsim.errors import MeshError
from ldsim.mesh import tetrahedralize
from ldsim.mesh.mesh import Mesh, check_cells, components, corner_volumes
from ldsim.mesh.tetrahedralize import (
    ENVELOPE,
    TRIES,
    Tetrahedralization,
    radius_ratios,
    tetrahedralized,
    tetrahedralized_to_count,
)
from ldsim.mesh.triangles import Triangles
from tests.mesh.surfaces import boundary, box, is_closed_and_oriented, together

needs_ftetwild = pytest.mark.skipif(
    importlib.util.find_spec("pytetwild") is None, reason="needs the extra ldsim[surface]"
)
SIDES = np.array([0.2, 0.1, 0.1])


@pytest.fixture(scope="module")
def made() -> Tetrahedralization:
    return tetrahedralized(box(SIDES), 0.05)


@needs_ftetwild
def test_the_tets_fill_the_surface_within_the_envelope(made: Tetrahedralization) -> None:
    mesh = made.mesh
    check_cells(mesh)
    assert set(components(mesh)) == {0}
    assert set(mesh.cells.ravel()) == set(range(mesh.n_vertices))
    assert is_closed_and_oriented(boundary(mesh))
    near = ENVELOPE * 0.05
    assert (mesh.vertices >= -near).all() and (mesh.vertices <= SIDES + near).all()
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), SIDES, atol=2 * near)


@needs_ftetwild
def test_the_quality_is_that_of_the_mesh(made: Tetrahedralization) -> None:
    quality, ratios = made.quality(), radius_ratios(made.mesh)
    assert made.surface_volume == pytest.approx(0.002, rel=1e-9)
    assert quality["edge_length"] == 0.05
    assert quality["volume"] == pytest.approx(corner_volumes(made.mesh).sum())
    assert quality["volume_change"] == pytest.approx(quality["volume"] / 0.002 - 1)
    assert abs(quality["volume_change"]) < 0.05
    assert quality["radius_ratio_min"] == ratios.min() > 0.1
    assert quality["radius_ratio_mean"] == ratios.mean() > 0.5


@needs_ftetwild
def test_parts_that_cross_each_other_become_one_solid() -> None:
    crossing = together(box([0.2, 0.1, 0.1]), box([0.1, 0.2, 0.0999], [0.05, -0.05, 0.00005]))
    mesh = tetrahedralized(crossing, 0.06).mesh
    assert set(components(mesh)) == {0}
    assert corner_volumes(mesh).sum() == pytest.approx(0.003, rel=0.05)


def filler(order: float, scatter: float) -> Callable[..., Tetrahedralization]:
    """A stand-in that makes 250 tets of edge length 0.02 m, and as many more of smaller ones as the order says."""
    generator = np.random.default_rng(0)

    def fill(surface: Triangles, edge_length: float, *rest: object) -> Tetrahedralization:
        count = int(250 * (0.02 / edge_length) ** order * np.exp(scatter * generator.standard_normal()))
        tet = np.tile(np.arange(4, dtype=np.int32), (count, 1))
        return Tetrahedralization(Mesh(np.eye(4)[:, :3], tet, "tet4"), edge_length, surface.volume)

    return fill


@pytest.mark.parametrize("order", [3.0, 2.0, 1.5])
def test_the_edge_length_for_a_number_of_tets_is_found_in_few_tries(
    order: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: list[str] = []
    monkeypatch.setattr(tetrahedralize, "tetrahedralized", filler(order, scatter=0.02))
    for cells in (100, 5000):
        made = tetrahedralized_to_count(box(SIDES), cells, tell=tried.append)
        assert made.mesh.n_cells == pytest.approx(cells, rel=0.1 if order > 2 else 0.3)
    assert 2 <= len(tried) <= 2 * TRIES and "edge length" in tried[0]


def test_the_nearest_try_is_kept_when_none_is_near(monkeypatch: pytest.MonkeyPatch) -> None:
    counts = [5000, 1900, 2600, 300, 400]

    def fill(surface: Triangles, edge_length: float, *rest: object) -> Tetrahedralization:
        tet = np.tile(np.arange(4, dtype=np.int32), (counts.pop(0), 1))
        return Tetrahedralization(Mesh(np.eye(4)[:, :3], tet, "tet4"), edge_length, surface.volume)

    monkeypatch.setattr(tetrahedralize, "tetrahedralized", fill)
    assert tetrahedralized_to_count(box(SIDES), 1000).mesh.n_cells == 1900
    assert not counts


def test_no_filling_is_tried_again_with_the_longest_edge_that_is_allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[float] = []

    def fill(surface: Triangles, edge_length: float, *rest: object) -> Tetrahedralization:
        tried.append(edge_length)
        tet = np.tile(np.arange(4, dtype=np.int32), (250, 1))
        return Tetrahedralization(Mesh(np.eye(4)[:, :3], tet, "tet4"), edge_length, surface.volume)

    monkeypatch.setattr(tetrahedralize, "tetrahedralized", fill)
    assert tetrahedralized_to_count(box(SIDES), 10).mesh.n_cells == 250
    assert tried[-1] == max(tried) == box(SIDES).diagonal * tetrahedralize.LONGEST_EDGE
    assert len(set(tried)) == len(tried) < TRIES


def fails_at(number: int) -> Callable[..., Tetrahedralization]:
    """A stand-in that makes 250 tets and fails in one of its tries, counted from 1."""
    tries: list[float] = []

    def fill(surface: Triangles, edge_length: float, *rest: object) -> Tetrahedralization:
        tries.append(edge_length)
        if len(tries) == number:
            raise MeshError("fTetWild did not fill the surface within 600 s")
        tet = np.tile(np.arange(4, dtype=np.int32), (250, 1))
        return Tetrahedralization(Mesh(np.eye(4)[:, :3], tet, "tet4"), edge_length, surface.volume)

    return fill


def test_a_try_that_fails_leaves_the_nearest_of_those_before_it(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    monkeypatch.setattr(tetrahedralize, "tetrahedralized", fails_at(2))
    assert tetrahedralized_to_count(box(SIDES), 1000, tell=told.append).mesh.n_cells == 250
    assert "within 600 s" in told[-1] and "the nearest of the tries before is taken" in told[-1]


def test_a_first_try_that_fails_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tetrahedralize, "tetrahedralized", fails_at(1))
    with pytest.raises(MeshError, match="within 600 s"):
        tetrahedralized_to_count(box(SIDES), 1000)


@needs_ftetwild
def test_fTetWild_is_stopped_when_it_takes_too_long() -> None:  # noqa: N802
    with pytest.raises(MeshError, match="within 1 s; give a larger mesh.surface.edge_length"):
        tetrahedralized(box(SIDES), 0.003, seconds=1)


@pytest.mark.parametrize("length", [0.0, -1.0, 1.0, float("nan")])
def test_an_edge_length_that_cannot_be_is_refused(length: float) -> None:
    with pytest.raises(MeshError, match="the edge length is .* at most"):
        tetrahedralized(box(SIDES), length)


def test_a_missing_pytetwild_is_told_with_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MeshError, match=r"pip install '\.\[surface\]'") as refusal:
        tetrahedralized(box(SIDES), 0.05)
    assert "\n" not in str(refusal.value)


def test_a_crash_of_ftetwild_is_told_in_one_line(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    script = tmp_path / "python"
    script.write_text("#!/bin/sh\necho oh >&2\necho no >&2\nkill -SEGV $$\n")
    script.chmod(0o755)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: "found")
    monkeypatch.setattr(sys, "executable", str(script))
    with pytest.raises(MeshError, match=r"failed on the surface with status -11 \(no\)") as refusal:
        tetrahedralized(box(SIDES), 0.05)
    assert "\n" not in str(refusal.value)

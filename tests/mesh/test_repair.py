"""Dirty surfaces: what comes out is closed and encloses what the clean one does, or one line says why not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from ldsim.errors import MeshError
from ldsim.mesh.repair import repaired
from ldsim.mesh.triangles import Triangles
from tests.mesh.surfaces import box, is_closed_and_oriented, soup, surface_of, together, turned_over

CLEAN = surface_of("catapult", resolution=2)
BOX = box([1, 1, 1])


def with_faces(faces: np.ndarray) -> Triangles:
    return Triangles(CLEAN.vertices, faces)


def jittered() -> Triangles:
    """A soup whose corners differ in single precision."""
    torn = soup(CLEAN)
    noise = np.random.default_rng(0).uniform(-1e-8, 1e-8, torn.vertices.shape)
    return Triangles(torn.vertices + noise, torn.faces)


def some_turned() -> Triangles:
    faces = CLEAN.faces.copy()
    chosen = np.random.default_rng(1).random(len(faces)) < 0.3
    faces[chosen] = faces[chosen][:, ::-1]
    return with_faces(faces)


def round_a_vertex() -> Triangles:
    """Without the triangles around one vertex, which is left over."""
    return with_faces(CLEAN.faces[(CLEAN.faces != CLEAN.faces[200, 0]).all(axis=1)])


DIRTY: dict[str, tuple[Callable[[], Triangles], str]] = {
    "clean": (lambda: CLEAN, ""),
    "a soup": (lambda: soup(CLEAN), "duplicate vertices merged"),
    "a soup in single precision": (jittered, "duplicate vertices merged"),
    "unused vertices": (lambda: Triangles(np.pad(CLEAN.vertices, [(0, 5), (0, 0)]), CLEAN.faces), "5 vertices that no"),
    "a point as a triangle": (lambda: with_faces(np.pad(CLEAN.faces, [(0, 2), (0, 0)])), "2 triangles without area"),
    "a triangle twice": (lambda: with_faces(np.concatenate([CLEAN.faces, CLEAN.faces[:3, ::-1]])), "3 triangles that"),
    "triangles turned": (some_turned, "triangles turned to agree"),
    "inside out": (lambda: turned_over(CLEAN), "1 inside-out components turned"),
    "a triangle missing": (lambda: with_faces(CLEAN.faces[1:]), "1 holes filled"),
    "a vertex missing": (round_a_vertex, "1 holes filled"),
}


@pytest.mark.parametrize("case", DIRTY)
def test_a_dirty_surface_becomes_closed_and_outward_and_what_was_done_is_said(case: str) -> None:
    make, words = DIRTY[case]
    result = repaired(make())
    assert is_closed_and_oriented(result.surface)
    tolerance = 0.01 if case == "a vertex missing" else 1e-5
    assert result.surface.volume == pytest.approx(CLEAN.volume, rel=tolerance)
    assert any(words in repair for repair in result.repairs) if words else result.repairs == ()


def test_what_is_repaired_needs_no_repair() -> None:
    once = repaired(turned_over(jittered()))
    assert repaired(once.surface).repairs == ()


def volume(*parts: Triangles) -> float:
    return repaired(together(*parts)).surface.volume


def test_a_cavity_stays_a_cavity_and_a_body_of_its_own_a_body() -> None:
    outer, inner, aside = box([1, 1, 1]), box([0.5] * 3, 0.25), box([0.5] * 3, 2.0)
    assert volume(outer, turned_over(inner)) == pytest.approx(1 - 0.125)
    assert volume(turned_over(outer), inner) == pytest.approx(1 - 0.125)
    assert volume(outer, turned_over(aside)) == pytest.approx(1 + 0.125)
    assert volume(outer, inner) == pytest.approx(1 + 0.125)


def moebius_strip() -> Triangles:
    """Twenty quadrilaterals around a ring, half a turn."""
    t = np.arange(20) * 2 * np.pi / 20
    across = np.stack([np.cos(t / 2) * np.cos(t), np.cos(t / 2) * np.sin(t), np.sin(t / 2)], axis=1) * 0.3
    ring = np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)
    i = np.arange(20)
    left, right = np.append(i, 20)[1:].copy(), np.append(i + 20, 0)[1:].copy()
    left[-1], right[-1] = 20, 0
    faces = np.concatenate([np.stack([i, left, i + 20], axis=1), np.stack([left, right, i + 20], axis=1)])
    return Triangles(np.concatenate([ring + across, ring - across]), faces)


def with_a_fin() -> Triangles:
    vertices = np.concatenate([CLEAN.vertices, [[9.0, 9.0, 9.0]]])
    return Triangles(vertices, np.append(CLEAN.faces, [[*CLEAN.faces[0, :2], len(CLEAN.vertices)]], axis=0))


REFUSED: dict[str, tuple[Callable[[], Triangles], str]] = {
    "three triangles on an edge": (with_a_fin, "not manifold: 1 of its edges belong to more than two"),
    "two boxes that share an edge": (lambda: together(BOX, box([1, 1, 1], [1, 1, 0])), "not manifold: 1 of"),
    "one side only": (moebius_strip, "one side only"),
    "an open box": (
        lambda: Triangles(box([1, 1, 1]).vertices, box([1, 1, 1]).faces[2:]),
        "1 holes, one of them 1.41 m",
    ),
    "a single triangle": (lambda: Triangles(np.eye(3), np.array([[0, 1, 2]])), "the surface is open"),
    "nothing but points": (lambda: Triangles(np.eye(3), np.array([[0, 0, 1]])), "no triangle of three different"),
    "no volume": (lambda: box([1, 1e-5, 1e-5]), "encloses 1e-10 m³ .* no solid"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_mended_is_refused_in_one_line(case: str) -> None:
    make, words = REFUSED[case]
    with pytest.raises(MeshError, match=words) as refusal:
        repaired(make())
    assert "\n" not in str(refusal.value)

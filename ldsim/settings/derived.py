"""Settings that follow from a solid: its unit, its pins, and from what it does, material, pulls, time step and sizes.

Every function is pure, and what it gives is an ordinary setting that can be said instead. Lengths in metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ldsim.arrays import Array, Indices
from ldsim.errors import SettingsError
from ldsim.learn.options import MANY
from ldsim.mechanics.scene import Scene
from ldsim.pipeline.pca import SYNTHETIC
from ldsim.pipeline.solid import Solid, length, solid_lines
from ldsim.settings.experiment import Settings

METRES = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}
WORDS = {"mm": "millimetres", "cm": "centimetres", "m": "metres", "in": "inches"}
# Solids of this size are simulated in metres; a surface file with numbers like these comes from CAD, in millimetres.
IN_METRES, IN_MILLIMETRES = (0.01, 4.0), (20.0, 2000.0)

# An end is flat when this share of its cross-section lies in one plane; a slab of this share of the length is pinned.
FLAT, IN_PLANE, PINNED = 0.3, 1e-3, 0.05
# Silicone rubber. A solid that its weight would move by more than a tenth of its size is made so stiff that this is a
# twentieth, and one that buckles under it so stiff that it bears it twice.
SOFT, SINKS, SAGS, BEARS = 1e5, 0.1, 0.05, 2.0
# The longest pull, in sizes of the solid, and the strain that it may make where the solid is of middling softness.
REACH, STRAIN = 0.25, 0.5
# Frames of the slowest oscillation, and the longest of them that still looks smooth, s.
FRAMES, SMOOTH = 40, 1 / 60


@dataclass(frozen=True)
class Pins:
    """Where a solid is held: the end `at` ("min" or "max") of an axis 0 … 2, a slab so thick, and why."""

    axis: int
    at: str
    thickness: float
    why: str

    @property
    def gravity(self) -> tuple[float, float, float]:
        """Down: along z for a solid that stands or hangs on an end of z, else along y."""
        return (0.0, 0.0, -9.8) if self.axis == 2 else (0.0, -9.8, 0.0)


def unit_of(diagonal: float, surface: bool) -> str:
    """The unit of a file by the diagonal of what is in it, in that unit.

    Args:
        surface: whether it is a triangle surface, which comes from CAD; meshes for simulation are mostly in metres.

    Raises:
        SettingsError: it could be several.
    """
    if IN_METRES[0] <= diagonal <= IN_METRES[1]:
        return "m"
    if surface and IN_MILLIMETRES[0] <= diagonal <= IN_MILLIMETRES[1]:
        return "mm"
    sizes = ", ".join(f"{unit} ({length(diagonal * metres)} across)" for unit, metres in METRES.items())
    raise SettingsError(f"the file is {diagonal:.4g} across, but in what unit? say so with --unit {sizes}")


def pins_of(vertices: Array, triangles: Indices, said: str | None = None) -> Pins:
    """The end that a solid is held at: the flat one across its longest extent, or where none is flat, the low one.

    Args:
        triangles: of its surface, (t, 3).
        said: an end such as "x-min", which is then the one.
    """
    extents = np.ptp(vertices, axis=0)
    ends = [f"{axis}-{at}" for at in ("min", "max") for axis in "yzx"]
    if said is not None:
        end, why = said, "as you say"
    else:
        flat = [end for end in ends if _flatness(vertices, triangles, end) >= FLAT]
        # the longest within a hundredth; of equal ones the first, which is below
        end = max(flat, key=lambda name: round(math.log(extents["xyz".index(name[0])]), 2), default="y-min")
        why = "a flat end of its longest extent" if flat else "its low end, for none is flat"
    axis = "xyz".index(end[0])
    return Pins(axis, end[2:], rounded(PINNED * float(extents[axis])), why)


def _flatness(vertices: Array, triangles: Indices, end: str) -> float:
    """The share of a cross-section of the bounding box that the surface covers in the plane of an end."""
    axis, extents = "xyz".index(end[0]), np.ptp(vertices, axis=0)
    height = vertices[:, axis] - vertices[:, axis].min()
    off = height if end[2:] == "min" else height.max() - height
    corners = vertices[triangles[(off[triangles] <= IN_PLANE * extents[axis]).all(axis=1)]]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    return float(area / np.prod(np.delete(extents, axis)))


def stiffening(solid: Solid) -> float:
    """How many times stiffer a solid has to be to stand its own weight; 1 for one that does."""
    sinks = solid.sag > SINKS * solid.size
    sagging = solid.sag / (SAGS * solid.size) if sinks else 1.0
    buckling = BEARS / solid.load_factor if solid.load_factor < 1 else 1.0
    return max(rounded(max(sagging, buckling), up=True), 1.0)


def stiffness_of_pulls(solid: Solid) -> float:
    """That of the solid itself where it is of middling softness, N/m: half of a pull there goes into the solid."""
    return rounded(1 / float(np.median(solid.softness)))


def reach_of_pulls(solid: Solid) -> float:
    """A quarter of its size, less where such a pull would strain it by more than a half, metres."""
    return rounded(min(REACH * solid.size, 2 * STRAIN / float(np.median(solid.strain))))


def time_step(solid: Solid) -> float:
    """A fortieth of its slowest oscillation, s."""
    return rounded(min(solid.period / FRAMES, SMOOTH))


def left_out(settings: Settings, scene: Scene) -> str:
    """What a configuration leaves out of how its space is made, as it follows from the solid; empty if nothing."""
    vertices, unknowns, pca, train = scene.mesh.n_vertices, 3 * len(scene.free), settings.pca, settings.train
    filled, words = train.of_solid(vertices, unknowns), []
    if pca.k is None and pca.columns is not None:
        words.append(f"pca.k {min(pca.columns, unknowns)}")
    if pca.is_open and vertices > MANY and not settings.snapshot.quasistatic:
        words.append(f"pca.synthetic {SYNTHETIC} pulls like those of the motions")
    for section, given, found in (("train", train, filled), ("train.condensed", train.condensed, filled.condensed)):
        for name, value in found:
            if getattr(given, name) is None and value is not None:
                words.append(f"{section}.{name} {list(value) if isinstance(value, tuple) else value}")
    if not words:
        return ""
    return f"what is left out follows from its {vertices} vertices and {unknowns} unknowns: {', '.join(words)}"


def looked_at(settings: Settings, scene: Scene) -> list[str]:
    """What a solid does by itself and when it is pulled, and what settings follow from it, in plain lines."""
    return [*solid_lines(scene, settings.snapshot), *filter(None, [left_out(settings, scene)])]


def rounded(value: float, up: bool = False) -> float:
    """In two digits."""
    found = float(f"{value:.1e}")
    return found if not up or found >= value else float(f"{value * 1.05:.1e}")

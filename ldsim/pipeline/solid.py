"""What a solid does: under its own weight, when it is pulled, and by itself; and whether that makes sense."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ldsim.arrays import Array
from ldsim.dynamics.full.linear_choice import choose
from ldsim.errors import LdsimError
from ldsim.mechanics.linear_response import LinearResponse
from ldsim.mechanics.options import PullOptions
from ldsim.mechanics.random_pulls import spread_points
from ldsim.mechanics.scene import Scene
from ldsim.mesh.surface import surface_triangles
from ldsim.pipeline.mesh import described_scene
from ldsim.pipeline.options import MeshOptions, SnapshotOptions
from ldsim.pipeline.progress import SILENT
from ldsim.run import Run

# A pull takes hold of this share of the surface, and of at least so many edges around a vertex.
GRIP_SHARE, GRIP_EDGES = 0.01, 1.2
# of a dozen grips the median would depend on where the first one is, up to threefold
GRIPS, FREQUENCIES = 48, 4
# Beyond these shares of its size, and this strain, what linear elasticity says is absurd, and what it is said of too.
SAG, TORN, STILL = 0.2, 1.0, 0.005
# A grip that holds more of the vertices pushes the solid and does not bend it.
MOST_HELD = 0.5


@dataclass(frozen=True, eq=False)
class Solid:
    """How big, heavy, soft and slow a solid is, by linear elasticity at rest.

    Attributes:
        size: diagonal of its bounding box, metres.
        weight: of what can move, N.
        radius: of the grips, metres.
        sag: how far weight and loads move it at most, metres.
        load_factor: how many times its weight and loads it bears until it buckles; infinite where it never does.
        frequencies: the slowest, ascending, (f,) Hz.
        softness: at points spread over its surface, the compliance of a grip in its softest direction, (p,) m/N.
        strain: the largest in the solid when a grip there is moved, per metre, (p,) 1/m.
        held: the share of what can move that a grip there holds, (p,).
    """

    size: float
    weight: float
    radius: float
    sag: float
    load_factor: float
    frequencies: Array
    softness: Array
    strain: Array
    held: Array

    def stiffened(self, factor: float) -> Solid:
        """The same solid of a Young's modulus so many times as large."""
        return replace(
            self,
            sag=self.sag / factor,
            load_factor=self.load_factor * factor,
            frequencies=self.frequencies * math.sqrt(factor),
            softness=self.softness / factor,
        )

    @property
    def period(self) -> float:
        """Of its slowest oscillation, s."""
        return 1 / float(self.frequencies[0])


def usual_radius(scene: Scene) -> float:
    """The radius of a grip that holds a hundredth of the surface, and several vertices, metres."""
    corners = scene.mesh.vertices[surface_triangles(scene.mesh)]
    sides = corners - np.roll(corners, 1, axis=1)
    area = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum()
    edge = float(np.median(np.linalg.norm(sides, axis=2)))
    return max(math.sqrt(GRIP_SHARE * float(area) / math.pi), GRIP_EDGES * edge)


def look_at(scene: Scene, radius: float | None = None) -> Solid | None:
    """Measure a solid; None where it is so large that its factor would not fit in memory.

    Args:
        radius: of the grips, metres; a usual one where it is left out.

    Raises:
        SolverError: the pins let it turn or float.
    """
    choice = choose(scene, "auto")
    if choice.elimination is None:
        return None
    response = LinearResponse(scene, choice.order, choice.elimination)
    radius = usual_radius(scene) if radius is None else radius
    force = scene.external_force
    points = spread_points(scene, GRIPS).tolist()
    softness, strain, held = np.array([_grip(scene, response, point, radius) for point in points]).T
    return Solid(
        size=scene.mesh.diagonal,
        weight=float(np.linalg.norm(force.sum(axis=0))),
        radius=radius,
        sag=float(np.linalg.norm(response.displacement(force), axis=1).max()),
        load_factor=response.load_factor(force),
        frequencies=response.frequencies(FREQUENCIES),
        softness=softness,
        strain=strain,
        held=held,
    )


def _grip(scene: Scene, response: LinearResponse, point: int, radius: float) -> tuple[float, float, float]:
    """Compliance in the softest direction, m/N, the largest strain for a metre that way, and the share that is held."""
    x = scene.mesh.vertices
    held = np.flatnonzero((np.linalg.norm(x - x[point], axis=1) <= radius) & scene.movable)
    fields = response.of_grip(held)
    values, vectors = np.linalg.eigh(fields[held].mean(axis=0))
    softest = float(values[-1])
    strain = float(response.strain(fields @ vectors[:, -1]).max()) / softest
    return softest, strain, len(held) / float(scene.movable.sum())


def moved_by(solid: Solid, pulls: PullOptions) -> Array:
    """How far the longest of some pulls takes the solid where it holds it, in the softest direction, (p,) metres."""
    series = pulls.stiffness * solid.softness
    return pulls.reach * series / (1 + series)


def solid_lines(scene: Scene, options: SnapshotOptions) -> list[str]:
    """What a solid does by itself and under the random pulls of its motions, in plain lines; warnings say so."""
    pulls = {(each.reach, each.stiffness, each.radius): each for m in options.motions if (each := m.pulls) is not None}
    try:
        solid = look_at(scene, next(iter(pulls.values())).radius if pulls else None)
    except LdsimError as error:
        return [f"warning: what the solid does at rest is not known: {error}"]
    if solid is None:
        return ["the solid is too large for a factor in memory; what it does at rest was not looked at"]
    return described(solid, list(pulls.values()))


def solid_of(run: Run, mesh: MeshOptions, tell: Callable[[Scene], list[str]], base: Path) -> list[str]:
    """What there is to tell of a solid that no stage may have made yet; a surface would have to be filled first."""
    try:
        if run.path("scene").is_file() and run.header("scene").settings == mesh.dump():
            return tell(run.scene)
        if mesh.surface is not None:
            return [f"what the solid does will be told by `ldsim mesh`, which fills {mesh.surface.file}"]
        return tell(described_scene(mesh, SILENT, base)[0])
    except LdsimError as error:
        return [f"warning: the solid could not be looked at: {' '.join(str(error).split())}"]


def described(solid: Solid, pulls: Sequence[PullOptions] = ()) -> list[str]:
    """What a solid does, in plain lines, with a warning after each that is absurd."""
    slow = ", ".join(map(number, solid.frequencies[:4]))
    lines = [
        f"its weight and loads, {number(solid.weight)} N, move it by up to {length(solid.sag)} "
        f"({number(100 * solid.sag / solid.size)} % of its size)",
        *_absurd_weight(solid),
        f"its slowest frequencies are {slow} Hz",
    ]
    for one in pulls:
        lines += _of_pulls(solid, one)
    return lines


def _absurd_weight(solid: Solid) -> list[str]:
    share = solid.sag / solid.size
    if solid.load_factor < 1:
        what, factor = f"it buckles under {number(solid.load_factor)} of them", 2 / solid.load_factor
    elif share > SAG:
        what, factor = "it sinks into a heap under them", 4 * share / SAG
    else:
        return []
    return [
        f"warning: {what}; make it {number(math.ceil(factor))} times stiffer (mesh.material.youngs_modulus), pin more "
        "of it (mesh.pins), or look at its unit (mesh.scale)"
    ]


def _of_pulls(solid: Solid, pulls: PullOptions) -> list[str]:
    moved, force = moved_by(solid, pulls), pulls.reach * pulls.stiffness
    low, high, torn = float(moved.min()), float(moved.max()), float(np.median(moved * solid.strain))
    lines = [
        f"pulls of {length(pulls.reach)} by a spring of {number(pulls.stiffness)} N/m, up to {number(force)} N, move "
        f"it by {length(low)} to {length(high)} where they hold it ({number(100 * low / solid.size)} to "
        f"{number(100 * high / solid.size)} % of its size)"
    ]
    share = float(np.median(solid.held))
    if share > MOST_HELD:
        lines.append(
            f"warning: a grip of {length(solid.radius)} holds {number(100 * share)} % of it, which it pushes more than "
            "it bends it; lower radius"
        )
    if high < STILL * solid.size:
        wanted = float(f"{1 / np.median(solid.softness):.1e}")
        lines.append(f"warning: these pulls hardly move it; a spring as stiff as the solid has {number(wanted)} N/m")
    elif torn > TORN:
        lines.append(
            f"warning: these pulls strain it by {number(100 * torn)} %, and cells will invert; lower reach to "
            f"{float(f'{0.5 * pulls.reach * TORN / torn:.1e}'):g} m"
        )
    return lines


def number(value: float) -> str:
    """Two digits, and whole above a hundred."""
    return f"{value:.2g}" if abs(value) < 100 or abs(value) >= 1e6 else f"{value:.0f}"


def length(metres: float) -> str:
    """In the unit in which it is read."""
    return f"{number(metres)} m" if metres >= 1 else f"{number(1e3 * metres)} mm"

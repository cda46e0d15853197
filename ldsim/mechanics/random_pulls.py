"""Seeded random pulls that spread over the surface and the directions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ldsim.arrays import Array, Indices
from ldsim.errors import SceneError
from ldsim.mechanics.motion import Drag, Motion
from ldsim.mechanics.options import PullOptions
from ldsim.mechanics.scene import Scene
from ldsim.mesh.surface import surface_vertices

# Frames of a run and as many again, where nothing tells how long a pull lasts.
STILL = 30
# Covering pulls go so much farther than any of those they are like: people pull on where a motion stopped, and what
# has learned from no pose as far off is lost there.
FARTHER = 1.5


def surface_pulls(name: str, scene: Scene, options: PullOptions) -> Motion:
    """Random pulls at the movable surface of a scene.

    Raises:
        SceneError: the pins hold all of its surface.
    """
    return random_pulls(name, scene.mesh.vertices[_movable_surface(scene)], options)


def covering_pulls(name: str, scene: Scene, like: Sequence[Motion], count: int, seed: int) -> Motion:
    """Pulls as stiff and as long as those of other motions, and farther, anywhere, every other under turned gravity.

    Where those have no pulls, gravity alone turns.

    Args:
        like: what they are like; but the pointer goes up to `FARTHER` times as far.
        count: of pulls, each followed by as many frames of free motion.
    """
    pulls = pulls_like(like, count, seed)
    frames = STILL if pulls is None else pulls.frames
    motion = Motion(name, count * 2 * frames)
    if pulls is not None:
        motion = surface_pulls(name, scene, pulls.model_copy(update={"reach": FARTHER * pulls.reach}))
    turned = [float(np.linalg.norm(motion.gravity, axis=1).max()) for motion in like if motion.gravity is not None]
    strongest = max(float(np.linalg.norm(scene.gravity)), *turned, 0.0)
    directions = spread_directions(count, np.random.default_rng((seed, 1))) * strongest
    directions[::2] = scene.gravity
    return replace(motion, gravity=np.repeat(directions, 2 * frames, axis=0))


def pulls_like(motions: Sequence[Motion], count: int, seed: int) -> PullOptions | None:
    """Pulls as stiff, as wide and as long as the median of those of some motions; they go as far as any of these.

    Args:
        count: how many, each followed by as many frames of free motion.

    Returns:
        None where those motions have no pulls.
    """
    drags = [drag for motion in motions for drag in motion.drags]
    if not drags:
        return None
    frames = max(int(np.median([len(drag.targets) for drag in drags])), 2)
    reach = float(np.max([np.linalg.norm(drag.targets - drag.targets[0], axis=1).max() for drag in drags]))
    radius, stiffness = (float(np.median([getattr(d, what) for d in drags])) for what in ("radius", "stiffness"))
    pulls = PullOptions(count=count, seed=seed, reach=1.0, frames=frames, rest=frames)
    return pulls.model_copy(update={"reach": max(reach, radius), "stiffness": stiffness, "radius": radius})


def spread_points(scene: Scene, count: int) -> Indices:
    """Vertices of the movable surface, each the farthest from those before, (count,)."""
    movable = _movable_surface(scene)
    return movable[farthest_first(scene.mesh.vertices[movable], count, np.random.default_rng(0))]


def _movable_surface(scene: Scene) -> Indices:
    movable: Indices = np.intersect1d(surface_vertices(scene.mesh), scene.free)
    if not len(movable):
        raise SceneError(
            f"no vertex of the surface can move; the pins hold all of it, and the {len(scene.free)} free vertices lie "
            "inside, where nothing pulls: pin less (mesh.pins)"
        )
    return movable


def random_pulls(name: str, points: Array, options: PullOptions) -> Motion:
    """Pull one point after another: out along a smooth ramp, held, let go, left to swing.

    Points are chosen farthest from those chosen before, the first at random, so that few pulls cover the surface,
    however unevenly its vertices lie. Directions are those of a Fibonacci lattice on the sphere, turned and shuffled at
    random.

    Args:
        points: where a pull may take hold, at rest, (v, 3) float64, metres.
    """
    count, frames, stride = options.count, options.frames, options.frames_of_one
    generator = np.random.default_rng(options.seed)
    chosen = points[farthest_first(points, count, generator)]
    directions = spread_directions(count, generator)
    lengths = options.reach * generator.uniform(0.4, 1.0, size=count)
    # There after seven tenths of the pull, with no jump in speed at either end.
    ramp = np.minimum(np.arange(1, frames + 1) / (0.7 * frames), 1.0)
    ramp = ramp * ramp * (3 - 2 * ramp)

    def drag(i: int) -> Drag:
        targets = chosen[i] + ramp[:, None] * (lengths[i] * directions[i])
        return Drag(i * stride, chosen[i], targets, options.radius, options.stiffness, at_rest=True)

    return Motion(name, count * stride, tuple(map(drag, range(count))))


def spread_directions(count: int, generator: np.random.Generator) -> Array:
    """Unit vectors, (count, 3), spread evenly over the sphere: a Fibonacci lattice, turned and shuffled at random.

    Heights are the midpoints of equal bands, longitudes advance by the golden angle (Saff and Kuijlaars 1997,
    "Distributing many points on a sphere").
    """
    i = np.arange(count)
    height, around = 1 - (2 * i + 1) / count, np.pi * (3 - np.sqrt(5)) * i
    width = np.sqrt(1 - height**2)
    lattice = np.stack([width * np.cos(around), width * np.sin(around), height], axis=1)
    turn, triangle = np.linalg.qr(generator.normal(size=(3, 3)))
    turned: Array = lattice @ (turn * np.sign(np.diag(triangle))).T
    return generator.permutation(turned)


def farthest_first(points: Array, count: int, generator: np.random.Generator) -> Indices:
    """Indices of `count` points, each the farthest from those before; starts anew when all are used."""
    chosen = [int(generator.integers(len(points)))]
    distance = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < count:
        farthest = int(distance.argmax())
        if distance[farthest] == 0:
            distance[:] = np.inf
            farthest = int(generator.integers(len(points)))
        chosen.append(farthest)
        distance = np.minimum(distance, np.linalg.norm(points - points[farthest], axis=1))
    return np.array(chosen, dtype=np.int64)

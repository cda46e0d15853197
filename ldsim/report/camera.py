"""A camera that looks at a solid: turn the world into screen coordinates, project, frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ldsim.arrays import Array
from ldsim.mechanics.scene import Scene

# Of the eye, in diagonals of what it sees.
DISTANCE = 4.0
# Of the automatic view, degrees: off the broadside, to the side where the lamp lights it, and above the horizon.
TURN = 25.0
RAISED, RAISED_OVER_FLAT = 14.0, 40.0
# Ratios: of horizontal variances above which no direction is the thin one; of height to breadth below which it is flat.
ROUND, FLAT = 0.7, 0.4
# Around what is seen, as a share of its larger side.
RIM = 0.03


@dataclass(frozen=True)
class View:
    """A camera on a sphere around a point. The world's y axis points up on the screen.

    Attributes:
        azimuth: degrees about y; 0 looks along −z from the front, 90 along −x from the right.
        elevation: degrees above the horizontal plane.
        centre: the point looked at, metres.
        distance: of the eye from the centre, metres; by default so far that the projection is all but parallel.
    """

    azimuth: float = 30.0
    elevation: float = 18.0
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    distance: float = 1e4

    def __post_init__(self) -> None:
        if self.distance <= 0:
            raise ValueError(f"the eye's distance is {self.distance} m; it must be positive")


def look_at(positions: Array, azimuth: float = 30.0, elevation: float = 18.0) -> View:
    """A view of all positions (..., 3), metres, from some diagonals of their bounding box."""
    points = positions.reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    x, y, z = (float(c) for c in (low + high) / 2)
    diagonal = float(np.linalg.norm(high - low))
    return View(azimuth, elevation, (x, y, z), max(DISTANCE * diagonal, 1e-9))


def upright(gravity: Array) -> Array:
    """The rotation (3, 3) that turns `gravity` (3,) to −y, the screen's down; the identity without gravity."""
    strength = float(np.linalg.norm(gravity))
    up = -gravity / strength if strength > 0 else np.array([0.0, 1.0, 0.0])
    if up[1] < -1 + 1e-9:
        return np.diag([1.0, -1.0, -1.0])
    # Rodrigues' formula for the rotation of `up` to y about their common normal.
    x, z = float(up[0]), float(up[2])
    K = np.array([[0.0, -x, 0.0], [x, 0.0, z], [0.0, -z, 0.0]])
    R: Array = np.eye(3) + K + K @ K / (1 + up[1])
    return R


def look_at_broadside(rest: Array, positions: Array) -> View:
    """A view of all positions (..., 3), metres, from where the solid at rest, (n, 3), is broad and not deep.

    It looks along the horizontal direction of least extent, turned and raised a little so that depth shows; a solid
    about as broad as deep is seen from the front, a flat one from higher up.
    """
    ground = rest[:, [0, 2]] - rest[:, [0, 2]].mean(axis=0)
    variances, directions = np.linalg.eigh(ground.T @ ground)
    x, z = directions[:, 0] * (1 if directions[1, 0] >= 0 else -1)
    azimuth = float(np.degrees(np.arctan2(x, z))) if variances[0] < ROUND * variances[1] else 0.0
    extents = np.ptp(rest, axis=0)
    flat = extents[1] < FLAT * min(extents[0], extents[2])
    return look_at(positions, azimuth + TURN, RAISED_OVER_FLAT if flat else RAISED)


def first_look(scene: Scene) -> dict[str, object]:
    """How a page shows a solid at first: the rotation (9) that sets it upright, and the angles of its broad side."""
    turn = upright(scene.gravity)
    rest = scene.mesh.vertices @ turn.T
    view = look_at_broadside(rest, rest)
    return {"up": turn.ravel().tolist(), "azimuth": view.azimuth, "elevation": view.elevation}


def screen_positions(view: View, positions: Array) -> Array:
    """Positions (..., 3) in the camera's axes: right, up, and out of the screen towards the eye; metres."""
    a, e = np.radians(view.azimuth), np.radians(view.elevation)
    right = np.array([np.cos(a), 0.0, -np.sin(a)])
    out = np.array([np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)])
    axes = np.stack([right, np.cross(out, right), out])
    turned: Array = (np.asarray(positions, dtype=np.float64) - np.asarray(view.centre)) @ axes.T
    return turned


def depths(view: View, screen: Array) -> Array:
    """Distance (...) of screen positions (..., 3) from the eye."""
    eye = np.array([0.0, 0.0, view.distance])
    distance: Array = np.linalg.norm(screen - eye, axis=-1)
    return distance


def project(view: View, screen: Array) -> Array:
    """Screen positions (..., 3) on the plane through the centre, (..., 2), metres.

    What is behind the eye is put just in front of it: a run that blew up gives an ugly picture, not a crash.
    """
    towards = np.minimum(screen[..., 2:] / view.distance, 0.99)
    flat: Array = screen[..., :2] / (1 - towards)
    return flat


def limits_of(view: View, positions: Array) -> Array:
    """(left, right, bottom, top) of what `view` sees of all positions (..., 3), metres, and a margin around it."""
    flat = project(view, screen_positions(view, positions)).reshape(-1, 2)
    low, high = flat.min(axis=0), flat.max(axis=0)
    rim = RIM * max(float((high - low).max()), 1e-9)
    return np.array([low[0] - rim, high[0] + rim, low[1] - rim, high[1] + rim])

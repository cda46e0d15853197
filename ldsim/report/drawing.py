"""Pictures of triangle meshes without a graphics card: project, cull, sort by depth, fill.

A picture has a transparent background and text in a middle grey, so that it reads on light and on dark pages alike.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from io import BytesIO
from typing import NamedTuple, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from ldsim.arrays import Array, Indices
from ldsim.report.camera import View, depths, limits_of, project, screen_positions
from ldsim.report.svg import PALETTE

Triangles = NDArray[np.integer]
Picture: TypeAlias = Image.Image
# Of a drag in one picture: where it holds and where it pulls to, (3,) metres each.
Pull: TypeAlias = tuple[Array, Array]


class DrawnPose(NamedTuple):
    """One run in one frame: its title, the positions of the vertices, (n, 3) metres, and what pulls."""

    title: str
    positions: Array
    pulls: Sequence[Pull] = ()


class Movement(NamedTuple):
    """One run: its title, the positions of the vertices in each frame, (N, n, 3) metres, and what pulls in each."""

    title: str
    positions: Array
    pulls: Sequence[Sequence[Pull]] = ()

    @classmethod
    def pulled(
        cls, title: str, positions: Array, held: Iterable[Sequence[tuple[Indices, Array]]], turn: Array
    ) -> Movement:
        """One with what pulls in each frame: which vertices are held, and where to before the solid was turned."""
        each = zip(positions, held, strict=True)
        return cls(title, positions, [[(at[some].mean(axis=0), turn @ to) for some, to in pulls] for at, pulls in each])

    def pose(self, frame: int) -> DrawnPose:
        return DrawnPose(self.title, self.positions[frame], self.pulls[frame] if self.pulls else ())


CLAY = (0.72, 0.76, 0.80)
TEXT_GREY = "#828a93"
PULL = "#20262d"
# From clay to deep vermilion through amber: lightness falls all the way, so it also reads without colour.
DISTANCE_COLOURS = LinearSegmentedColormap.from_list("distance", [PALETTE[f"scale-{i}"] for i in range(4)])
KEY_LIGHT = np.array([-0.45, 0.65, 0.61])
OVERSAMPLING = 2
DOTS_PER_INCH = 100


def draw_mesh(
    ax: Axes,
    vertices: Array,
    triangles: Triangles,
    view: View,
    limits: Array,
    shades: Array | None = None,
) -> PolyCollection:
    """Draw a closed surface by the painter's algorithm: far triangles first, those that face away not at all.

    Args:
        ax: an axes of any size; its frame and ticks are taken away.
        vertices: positions, (n, 3), metres.
        triangles: vertex indices, (t, 3), anticlockwise seen from outside.
        view: the camera.
        limits: what the picture shows, (left, right, bottom, top) as `limits_of` gives it; keep it fixed over a
            motion, or the solid seems to breathe.
        shades: 0 … 1 per vertex, (n,), from little to much distance; colours the surface, which is of clay otherwise.

    Returns:
        The collection of visible triangles, in the order in which they are painted.
    """
    screen = screen_positions(view, vertices)
    order = _visible_back_to_front(view, screen, triangles)
    corners = screen[triangles[order]]
    base = np.array([CLAY]) if shades is None else DISTANCE_COLOURS(shades[triangles[order]].mean(axis=1))[:, :3]
    rgb = np.clip(base * _light(corners)[:, None], 0, 1)
    polygons = PolyCollection(
        list(project(view, corners)), facecolors=rgb, edgecolors=rgb, linewidths=0.35, antialiaseds=False
    )
    ax.add_collection(polygons)
    ax.set(xlim=limits[:2], ylim=limits[2:], aspect="equal")
    ax.set_axis_off()
    return polygons


def side_by_side(
    poses: Sequence[DrawnPose],
    triangles: Triangles,
    view: View,
    limits: Array,
    width: int = 1200,
    most: float = 0.0,
) -> Picture:
    """The same frame of several runs in a row, by one camera in one framing.

    Args:
        poses: what to draw, left to right.
        triangles: the surface, (t, 3), anticlockwise seen from outside.
        width: of the picture, pixels.
        most: given, vertices are coloured by their distance to where the first pose has them, up to so many metres, and
            a bar says so.
    """
    figure, panels = _row_of_panels(len(poses), limits, width, bar=most > 0)
    for ax, pose in zip(panels, poses, strict=True):
        shades = np.linalg.norm(pose.positions - poses[0].positions, axis=1) / most if most > 0 else None
        draw_mesh(ax, pose.positions, triangles, view, limits, shades)
        _draw_pulls(ax, pose.pulls, view, width / len(poses))
        # its size follows the picture's width, so that pictures of one width match; small ones are read too
        ax.set_title(pose.title, color=TEXT_GREY, fontsize=max(13 * width / 1200, 11), pad=5 * width / 1200)
    if most > 0:
        _colour_bar(figure, 1000 * most)
    return _rasterised(figure)


def moving_pictures(motions: Sequence[Movement], triangles: Triangles, view: View, width: int) -> Iterator[Image.Image]:
    """One picture a frame of several runs of one motion side by side, by one camera in one framing.

    Of several, the colour is the distance to the first, on the scale of the replay: 98 % of the frames stay within it.

    Args:
        motions: of each run; all of the same number of frames.
        triangles: the surface, (t, 3), anticlockwise seen from outside.
        width: of the picture, pixels.
    """
    everything = np.stack([motion.positions for motion in motions])
    far = np.linalg.norm(everything[1:] - everything[0], axis=-1).max(axis=-1)
    most = float(np.percentile(far, 98)) if far.size else 0.0
    flat = everything.reshape(-1, *everything.shape[2:])
    targets = [point for motion in motions for pulls in motion.pulls for pull in pulls for point in pull]
    limits = limits_of(view, np.concatenate([flat.reshape(-1, 3), *(point[None] for point in targets)]))
    for frame in range(everything.shape[1]):
        yield side_by_side([motion.pose(frame) for motion in motions], triangles, view, limits, width, most)


def webp(pictures: list[Image.Image], seconds: float) -> bytes:
    """An endless animation of pictures of one size, each shown for so many seconds.

    The file has whole milliseconds: their rounding is carried on, so that the whole lasts as long as it should.
    """
    ends = np.round(1000 * seconds * np.arange(len(pictures) + 1)).astype(int)
    options = {"save_all": True, "append_images": pictures[1:], "loop": 0, "quality": 60, "method": 3}
    buffer = BytesIO()
    pictures[0].save(buffer, "WEBP", duration=np.diff(ends).tolist(), **options)
    return buffer.getvalue()


def fitted(picture: Picture, size: tuple[int, int]) -> Picture:
    """The picture as large as it fits, in the middle of one of this size, pixels."""
    share = min(size[0] / picture.width, size[1] / picture.height)
    inner = (max(round(share * picture.width), 1), max(round(share * picture.height), 1))
    whole = Image.new("RGBA", size)
    whole.paste(picture.resize(inner, Image.Resampling.LANCZOS), ((size[0] - inner[0]) // 2, (size[1] - inner[1]) // 2))
    return whole


def on_white(picture: Picture) -> NDArray[np.uint8]:
    """The picture's pixels on a white ground, cut to even sides as video codecs want them, (height, width, 3)."""
    ground = Image.new("RGBA", picture.size, "white")
    ground.alpha_composite(picture)
    pixels = np.asarray(ground.convert("RGB"))
    return np.ascontiguousarray(pixels[: pixels.shape[0] // 2 * 2, : pixels.shape[1] // 2 * 2])


def _draw_pulls(ax: Axes, pulls: Sequence[Pull], view: View, width: float) -> None:
    """A line from where each pull holds to a ball where it pulls to, rimmed so that it reads on any ground."""
    size = width / 400
    for ends in pulls:
        x, y = project(view, screen_positions(view, np.stack(ends))).T
        for colour, more in (("white", 2.4), (PULL, 0.0)):
            ax.plot(x, y, color=colour, linewidth=(1.6 + more) * size, solid_capstyle="round", zorder=3 + (more == 0))
            ax.plot(x[1:], y[1:], "o", color=colour, markersize=(5.5 + more) * size, zorder=3 + (more == 0), mew=0)


def _visible_back_to_front(view: View, screen: Array, triangles: Triangles) -> NDArray[np.intp]:
    """Indices of the triangles that turn their front to the camera, the farthest first."""
    flat = project(view, screen)[triangles]
    first, second = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    front = np.flatnonzero(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0] > 0)
    distance = depths(view, screen)[triangles[front]].mean(axis=1)
    return front[np.argsort(-distance, kind="stable")]


def _light(corners: Array) -> Array:
    """Brightness of each triangle (t, 3, 3) in screen coordinates: sky light from above and one soft lamp, (t,)."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    sky = 0.5 + 0.5 * normals[:, 1]
    lamp = np.maximum(normals @ KEY_LIGHT / np.linalg.norm(KEY_LIGHT), 0)
    brightness: Array = 0.42 + 0.20 * sky + 0.50 * lamp
    return brightness


def _row_of_panels(count: int, limits: Array, width: int, bar: bool) -> tuple[Figure, list[Axes]]:
    """A transparent figure with `count` axes of the limits' aspect, a line for titles and room for a colour bar."""
    inches = width / DOTS_PER_INCH
    title, foot = 0.027 * inches, 0.55 if bar else 0.06
    aspect = (limits[3] - limits[2]) / (limits[1] - limits[0])
    panel = inches / count
    height = panel * float(np.clip(aspect, 0.3, 1.4)) + title + foot
    figure = Figure(figsize=(inches, height), dpi=DOTS_PER_INCH * OVERSAMPLING)
    figure.patch.set_alpha(0.0)
    rows = (height - title - foot) / height
    gap = 0.02 / count
    return figure, [figure.add_axes((i / count + gap / 2, foot / height, 1 / count - gap, rows)) for i in range(count)]


def _colour_bar(figure: Figure, most: float) -> None:
    """A thin bar under the row that says what the colours mean, up to so many millimetres."""
    height = figure.get_size_inches()[1]
    ax = figure.add_axes((0.3, 0.40 / height, 0.4, 0.07 / height))
    bar = figure.colorbar(ScalarMappable(Normalize(0, most), DISTANCE_COLOURS), cax=ax, orientation="horizontal")
    bar.outline.set_visible(False)
    bar.set_label("distance to full space, mm", color=TEXT_GREY, fontsize=9.5, labelpad=1)
    ax.tick_params(colors=TEXT_GREY, labelsize=9, length=2, pad=1)


def _rasterised(figure: Figure) -> Image.Image:
    """The figure's pixels, drawn large without antialiasing and then made small, so that no seams show."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    pixels = np.array(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
    large = Image.fromarray(pixels)
    size = (large.width // OVERSAMPLING, large.height // OVERSAMPLING)
    return large.resize(size, Image.Resampling.LANCZOS)

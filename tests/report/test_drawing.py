"""The painter: what is in front hides what is behind, what faces away is gone, and framing stays put."""

from __future__ import annotations

from io import BytesIO

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from ldsim.report.camera import View, depths, limits_of, look_at, project, screen_positions
from ldsim.report.drawing import DrawnPose, Movement, draw_mesh, moving_pictures, side_by_side, webp

FRONT = View(azimuth=0.0, elevation=0.0)
BOX = np.array([-1.0, 1.0, -1.0, 1.0])
PARALLEL_AND_PERSPECTIVE = [FRONT, View(0.0, 0.0, distance=5.0)]


def cube() -> tuple[np.ndarray, np.ndarray]:
    """A cube of side 1 around the origin, twelve triangles anticlockwise seen from outside."""
    vertices = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return vertices, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


def pixels_of(vertices, triangles, view=FRONT, **options) -> np.ndarray:
    """What `draw_mesh` paints in a square of 200 pixels, (200, 200, 4)."""
    figure = Figure(figsize=(2, 2), dpi=100)
    figure.patch.set_alpha(0.0)
    draw_mesh(figure.add_axes((0, 0, 1, 1)), vertices, triangles, view, BOX, **options)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())


@pytest.mark.parametrize("view", PARALLEL_AND_PERSPECTIVE, ids=["parallel", "perspective"])
@pytest.mark.parametrize("order", [[0, 1], [1, 0]], ids=["near first", "far first"])
def test_a_near_triangle_hides_a_far_one_whatever_their_order(view, order):
    near = np.array([[-0.4, -0.4, 0.3], [0.4, -0.4, 0.3], [0.0, 0.5, 0.3]])
    far = np.array([[-0.8, -0.8, -0.3], [0.8, -0.8, -0.3], [0.0, 0.9, -0.3]])
    triangles = np.array([[0, 1, 2], [3, 4, 5]])[order]
    shades = np.array([1.0, 1, 1, 0, 0, 0])
    image = pixels_of(np.concatenate([near, far]), triangles, view, shades=shades).astype(int)
    red, _, blue, alpha = image[100, 100]
    assert alpha == 255 and red > 2 * blue
    red, _, blue, alpha = image[165, 45]
    assert alpha == 255 and abs(red - blue) < 40


def test_a_triangle_that_faces_away_is_not_painted():
    vertices = np.array([[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.0, 0.5, 0.0]])
    assert pixels_of(vertices, np.array([[0, 1, 2]]))[100, 100, 3] == 255
    assert pixels_of(vertices, np.array([[0, 2, 1]]))[..., 3].max() == 0


def test_a_cube_seen_from_the_front_shows_one_face_and_askew_three():
    vertices, triangles = cube()
    for view, faces in ((FRONT, 1), (View(30, 20), 3)):
        ax = Figure().add_subplot()
        assert len(draw_mesh(ax, vertices, triangles, view, BOX).get_paths()) == 2 * faces


def test_light_falls_from_above_so_that_tops_are_brighter_than_right_sides():
    vertices, triangles = cube()
    image = pixels_of(vertices, triangles, View(40, 35)).astype(int)
    assert image[55, 100, :3].sum() > image[120, 60, :3].sum() > image[120, 140, :3].sum()


@pytest.mark.parametrize("distance", [1e4, 7.0])
def test_turning_the_camera_keeps_distances(distance):
    points = np.random.default_rng(1).normal(size=(9, 3))
    view = View(37.0, -21.0, (0.3, -0.2, 0.5), distance)
    screen = screen_positions(view, points)
    np.testing.assert_allclose(
        np.linalg.norm(screen[1:] - screen[:-1], axis=1), np.linalg.norm(np.diff(points, axis=0), axis=1)
    )
    np.testing.assert_allclose(screen_positions(view, np.array(view.centre)), 0, atol=1e-15)


def test_the_right_hand_side_and_up_stay_where_they_belong():
    assert np.allclose(screen_positions(FRONT, np.eye(3)), np.eye(3))
    from_the_right = screen_positions(View(90, 0), np.eye(3))
    assert np.allclose(from_the_right, [[0, 0, 1], [0, 1, 0], [-1, 0, 0]])


def test_perspective_shows_near_things_larger_by_the_ratio_of_distances():
    view = View(0, 0, distance=4.0)
    size = project(view, np.array([[1.0, 0, 2.0], [1.0, 0, 0.0], [1.0, 0, -4.0]]))[:, 0]
    np.testing.assert_allclose(size, [2.0, 1.0, 0.5])
    assert np.all(np.diff(depths(view, np.array([[0, 0, 2.0], [0, 0, 0], [0, 0, -4]]))) > 0)


def test_a_point_behind_the_eye_stays_finite():
    assert np.isfinite(project(View(0, 0, distance=1.0), np.array([1.0, 1.0, 1.0]))).all()


def test_limits_hold_every_pose_of_a_motion():
    poses = np.random.default_rng(2).normal(size=(4, 10, 3))
    view = look_at(poses)
    left, right, bottom, top = limits_of(view, poses)
    flat = project(view, screen_positions(view, poses))
    assert left < flat[..., 0].min() and flat[..., 0].max() < right
    assert bottom < flat[..., 1].min() and flat[..., 1].max() < top


def test_an_eye_at_no_distance_is_refused():
    with pytest.raises(ValueError, match="must be positive"):
        View(distance=0.0)


def test_poses_stand_side_by_side_in_one_framing():
    vertices, triangles = cube()
    view = look_at(vertices[None])
    poses = [DrawnPose("left", vertices), DrawnPose("right", vertices)]
    image = np.asarray(side_by_side(poses, triangles, view, limits_of(view, vertices[None]), width=400))
    assert image.shape[1] == 400
    body = image[20:]
    np.testing.assert_array_equal(body[:, :200], body[:, 200:])


def test_colours_show_the_distance_to_the_first():
    vertices, triangles = cube()
    poses = [DrawnPose("same", vertices), DrawnPose("moved", vertices + [0.0, 0.0, 0.2])]
    view = look_at(np.stack([positions for _, positions, _ in poses]))
    limits = limits_of(view, np.stack([positions for _, positions, _ in poses]))
    image = np.asarray(side_by_side(poses, triangles, view, limits, width=400, most=0.2)).astype(int)
    middle = image.shape[0] // 3
    warmth = image[..., 0] - image[..., 2]
    assert abs(warmth[middle, 100]) < 40 < warmth[middle, 300]


def test_an_animation_moves_in_real_time_and_holds_its_frames():
    vertices, triangles = cube()
    motion = np.stack([vertices + [0.1 * i, 0, 0] for i in (2, 5, 8)])
    data = webp(list(moving_pictures([Movement("run", motion)], triangles, look_at(motion), 120)), 0.3)
    image = Image.open(BytesIO(data))
    assert image.format == "WEBP" and image.n_frames == 3
    image.load()
    assert image.info["duration"] == 300
    first = np.asarray(image.convert("RGBA")).astype(int)
    image.seek(2)
    assert np.abs(np.asarray(image.convert("RGBA")).astype(int) - first).max() > 50


def test_an_animation_lasts_as_long_as_its_pictures_however_long_one_is():
    drawn = [Image.new("RGBA", (8, 8), (20 * i, 0, 0, 255)) for i in range(12)]
    with Image.open(BytesIO(webp(drawn, 0.0125))) as image:
        shown = [image.seek(frame) or image.load() and image.info["duration"] for frame in range(12)]
    assert sum(shown) == 150 and set(shown) == {12, 13}


def test_a_large_surface_is_painted_whole():
    count = 151
    u, v = (g.ravel() for g in np.meshgrid(np.linspace(-0.9, 0.9, count), np.linspace(-0.9, 0.9, count)))
    corner = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    triangles = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + count], 1),
            np.stack([corner + 1, corner + count + 1, corner + count], 1),
        ]
    )
    assert len(triangles) == 45000
    image = pixels_of(np.stack([u, v, 0.1 * np.sin(5 * u)], axis=1), triangles)
    assert (image[15:185, 15:185, 3] == 255).all()

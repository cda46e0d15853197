"""Recorded interactions and random pulls as motions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ldsim.errors import MotionError
from ldsim.mechanics.motion import Drag, Motion
from ldsim.mechanics.options import PullOptions
from ldsim.mechanics.random_pulls import random_pulls, spread_directions
from ldsim.mechanics.recording import read_recording, write_recording

HEADER = "# spring_stiffness_n_per_m: 30\n# grab_radius_m: 0.03\n"
COLUMNS = "frame,is_dragging,target_x,target_y,target_z,grabbed_x,grabbed_y,grabbed_z\n"
ROWS = ["0,0,0,0,0,0,0,0", "1,1,1,2,3,4,5,6", "2,1,1,2,4,9,9,9", "3,0,0,0,0,0,0,0", "4,1,7,7,7,8,8,8"]


def written(folder: Path, text: str) -> Path:
    path = folder / "recording.csv"
    path.write_text(text)
    return path


def test_runs_of_dragging_rows_become_drags(tmp_path: Path) -> None:
    motion = read_recording(written(tmp_path, HEADER + COLUMNS + "\n".join(ROWS)), "m")
    assert motion.frames == 5
    assert [(drag.start, drag.stop) for drag in motion.drags] == [(1, 3), (4, 5)]
    first = motion.drags[0]
    assert first.point.tolist() == [4, 5, 6]
    assert first.targets.tolist() == [[1, 2, 3], [1, 2, 4]]
    assert (first.stiffness, first.radius) == (30, 0.03)


def test_a_radius_of_nothing_holds_the_nearest_vertex_alone(tmp_path: Path) -> None:
    motion = read_recording(written(tmp_path, HEADER.replace("0.03", "0") + COLUMNS + "\n".join(ROWS)), "m")
    assert {drag.radius for drag in motion.drags} == {0}


@pytest.mark.parametrize(("encoding", "comma"), [("utf-8-sig", ","), ("utf-8", ", ")], ids=["mark", "spaces"])
def test_a_recording_that_a_spreadsheet_wrote_is_read(tmp_path: Path, encoding: str, comma: str) -> None:
    """With the mark of its encoding in front, or spaces after the commas."""
    path = tmp_path / "recording.csv"
    path.write_text(HEADER + (COLUMNS + "\n".join(ROWS)).replace(",", comma), encoding=encoding)
    motion = read_recording(path, "m")
    assert motion.drags[0].targets.tolist() == [[1, 2, 3], [1, 2, 4]] and motion.drags[0].stiffness == 30


def test_a_recording_that_a_spreadsheet_saved_again_is_read(tmp_path: Path) -> None:
    """It pads each line to the columns of the widest and quotes what holds a comma."""
    empty = ",,,,,,,"
    notes = ['"# recorded_on: beam, of rubber",,,,,,,', '"# spring_stiffness_n_per_m: 30",,,,,,,']
    lines = [*notes, "# grab_radius_m: 0.03,,,,,,,", empty, COLUMNS.strip(), *ROWS[:2], empty, *ROWS[2:], empty, empty]
    motion, plain = (
        read_recording(written(tmp_path, text), "m") for text in ("\n".join(lines), HEADER + COLUMNS + "\n".join(ROWS))
    )
    assert motion.frames == plain.frames == 5
    for found, expected in zip(motion.drags, plain.drags, strict=True):
        assert (found.start, found.stiffness, found.radius) == (expected.start, 30, 0.03)
        np.testing.assert_array_equal(found.targets, expected.targets)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no frames"),
        (HEADER + COLUMNS, "holds no frames"),
        (COLUMNS + ROWS[1], "needs a line '# spring_stiffness_n_per_m"),
        (HEADER.replace("30", "-1") + COLUMNS + ROWS[1], "must be positive"),
        (HEADER.replace("30", "inf") + COLUMNS + ROWS[1], "spring_stiffness_n_per_m is inf N/m; it must be positive"),
        (HEADER.replace("0.03", "inf") + COLUMNS + ROWS[1], "grab_radius_m is inf m; it must be 0 or more and finite"),
        (HEADER.replace("0.03", "-1") + COLUMNS + ROWS[1], "grab_radius_m is -1 m; it must be 0 or more and finite"),
        (HEADER.replace("30", "0") + COLUMNS + ROWS[1], "spring_stiffness_n_per_m is 0 N/m; it must be positive"),
        (HEADER + COLUMNS.replace("target_y", "y") + ROWS[1], "lacks the column 'target_y'"),
        (HEADER + COLUMNS + "1,1,1,2,three,4,5,6", "does not hold seven numbers"),
        (HEADER + COLUMNS + "1,1,1", "does not hold seven numbers"),
        (HEADER + COLUMNS + "1,1,nan,2,3,4,5,6", "not finite"),
    ],
)
def test_a_recording_that_cannot_be_used_is_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(MotionError, match=message) as error:
        read_recording(written(tmp_path, text), "m")
    assert "\n" not in str(error.value)


def test_a_missing_recording_is_named(tmp_path: Path) -> None:
    with pytest.raises(MotionError, match=r"none\.csv cannot be read"):
        read_recording(tmp_path / "none.csv", "m")


SURFACE = np.random.default_rng(0).uniform(-1, 1, (200, 3))
PULLS = {"count": 6, "reach": 0.2, "stiffness": 30.0, "radius": 0.05, "frames": 10, "rest": 5}


def test_pulls_repeat_with_their_seed_and_differ_without() -> None:
    first, again, other = (random_pulls("p", SURFACE, PullOptions(**PULLS | {"seed": seed})) for seed in (1, 1, 2))
    for a, b in zip(first.drags, again.drags, strict=True):
        np.testing.assert_array_equal(a.targets, b.targets)
    assert not np.array_equal(first.drags[0].targets, other.drags[0].targets)


def test_pulls_come_one_after_another_and_stay_within_reach() -> None:
    motion = random_pulls("p", SURFACE, PullOptions(**PULLS | {"seed": 1}))
    assert motion.frames == 6 * 15
    assert [(drag.start, drag.stop) for drag in motion.drags] == [(15 * i, 15 * i + 10) for i in range(6)]
    for drag in motion.drags:
        distance = np.linalg.norm(drag.targets - drag.point, axis=1)
        assert (np.diff(distance) >= -1e-15).all()
        assert 0.4 * 0.2 - 1e-12 <= distance[-1] <= 0.2 + 1e-12


def test_pulls_spread_over_the_surface() -> None:
    points = np.array([drag.point for drag in random_pulls("p", SURFACE, PullOptions(**PULLS | {"seed": 1})).drags])
    apart = np.linalg.norm(points[:, None] - points[None], axis=2)[~np.eye(6, dtype=bool)].min()
    chance = np.random.default_rng(3).choice(SURFACE, (2000, 6))
    by_chance = np.linalg.norm(chance[:, :, None] - chance[:, None], axis=3) + 10 * np.eye(6)
    assert apart > np.quantile(by_chance.min(axis=(1, 2)), 0.95)


def test_more_pulls_than_surface_vertices_use_some_twice() -> None:
    motion = random_pulls("p", SURFACE[:2], PullOptions(**PULLS | {"seed": 1}))
    assert len(motion.drags) == 6


@pytest.mark.parametrize("count", [1, 2, 7, 40])
def test_directions_of_pulls_are_spread_over_the_sphere(count: int) -> None:
    directions = spread_directions(count, np.random.default_rng(1))
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)
    if count < 7:
        return
    # no point of the sphere is farther from a direction than the caps of a perfect cover would allow twice over
    anywhere = np.random.default_rng(0).normal(size=(2000, 3))
    anywhere /= np.linalg.norm(anywhere, axis=1, keepdims=True)
    gap = np.arccos(np.clip(anywhere @ directions.T, -1, 1)).min(axis=1).max()
    assert gap < 2 * np.arccos(1 - 2 / count)
    assert np.linalg.norm(directions.sum(axis=0)) < 0.5, "pulls one way and the other balance"


def test_pulls_cover_a_surface_evenly_however_unevenly_its_vertices_lie() -> None:
    rng = np.random.default_rng(5)
    crowded = np.concatenate([rng.uniform(0, 0.1, (2000, 3)), rng.uniform(0, 1, (200, 3))]) * [1, 1, 0]
    points = np.array(
        [drag.point for drag in random_pulls("p", crowded, PullOptions(**PULLS | {"seed": 2, "count": 30})).drags]
    )
    in_the_crowd = (points[:, :2] < 0.1).all(axis=1).mean()
    assert in_the_crowd < 0.1, "a hundredth of the area holds nine tenths of the vertices"


def drag(start: int, frames: int, seed: int = 0, **changes: object) -> Drag:
    rng = np.random.default_rng(seed)
    given: dict[str, object] = {"radius": 0.03, "stiffness": 1 / 3} | changes
    return Drag(start, rng.normal(size=3), rng.normal(size=(frames, 3)), **given)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "second", [drag(3, 2), drag(4, 2), drag(6, 2, radius=0.1), drag(6, 2, stiffness=9.0), drag(6, 2, at_rest=True)]
)
def test_a_motion_that_a_row_a_frame_cannot_hold_is_refused(tmp_path: Path, second: Drag) -> None:
    with pytest.raises(MotionError, match=f"its drag at frame {second.start}"):
        write_recording(tmp_path / "m.csv", Motion("m", 12, (drag(1, 3), second)))
    assert not (tmp_path / "m.csv").exists()

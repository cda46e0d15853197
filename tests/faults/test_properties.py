"""What must hold of every configuration and every recording, tried on those that hypothesis thinks of."""

from __future__ import annotations

import copy
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as some

from ldsim.errors import MotionError, SettingsError
from ldsim.mechanics.motion import Drag, Motion
from ldsim.mechanics.recording import read_recording, write_recording
from ldsim.settings import load_settings
from tests.cli.experiments import TINY

# The same examples every time: what is found by chance belongs to the campaign, which has seeds.
few = settings(
    max_examples=30,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)

finite = some.floats(allow_nan=False, allow_infinity=False)
place = some.lists(finite, min_size=3, max_size=3)
anything = some.recursive(
    some.none() | some.booleans() | some.integers() | some.floats() | some.text(max_size=8),
    lambda inner: some.lists(inner, max_size=3) | some.dictionaries(some.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)


def places(content: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The paths of all values of a configuration."""
    inner = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    return [path, *(found for key, value in inner for found in places(value, (*path, key)))]


@few
@given(where=some.sampled_from(places(TINY)[1:]), value=anything)
def test_a_configuration_with_any_value_anywhere_is_read_or_refused_in_one_line_a_fault(
    tmp_path: Path, where: tuple[Any, ...], value: Any
) -> None:
    content = copy.deepcopy(TINY)
    holder: Any = content
    for key in where[:-1]:
        holder = holder[key]
    holder[where[-1]] = value
    path = tmp_path / "a.yaml"
    path.write_text(yaml.safe_dump(content, allow_unicode=True), encoding="utf-8")
    try:
        found = load_settings(path)
    except SettingsError as error:
        said, *faults = str(error).split("\n")
        assert len(str(error)) < 5000 and (not faults or said.endswith(" things are wrong"))
        return
    path.write_text(yaml.safe_dump(found.model_dump(mode="json")), encoding="utf-8")
    assert load_settings(path) == found


@few
@given(text=some.text(max_size=200))
def test_any_text_is_refused_as_a_configuration_in_one_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a.yaml"
    path.write_text(text, encoding="utf-8", newline="")
    with pytest.raises(SettingsError) as caught:
        load_settings(path)
    assert "\n" not in str(caught.value)


@few
@given(
    waits=some.lists(some.integers(1, 4), min_size=1, max_size=3),
    targets=some.lists(place, min_size=1, max_size=4),
    point=place,
    radius=some.floats(0, 1e6),
    stiffness=some.floats(0, 1e12, exclude_min=True),
)
def test_a_recording_is_read_back_to_the_last_bit(
    tmp_path: Path, waits: list[int], targets: list[list[float]], point: list[float], radius: float, stiffness: float
) -> None:
    drags, frame = [], 0
    for wait in waits:
        drags.append(Drag(frame + wait, np.array(point), np.array(targets), radius, stiffness))
        frame = drags[-1].stop
    motion = Motion("a", frame + 1, tuple(drags))
    write_recording(tmp_path / "a.csv", motion)
    found = read_recording(tmp_path / "a.csv", "a")
    assert (found.frames, len(found.drags)) == (motion.frames, len(motion.drags))
    for one, other in zip(found.drags, motion.drags, strict=True):
        assert (one.start, one.radius, one.stiffness) == (other.start, other.radius, other.stiffness)
        np.testing.assert_array_equal(one.targets, other.targets)
        np.testing.assert_array_equal(one.point, other.point)


@few
@given(text=some.text(max_size=200), stiffness=some.floats(), rows=some.lists(some.lists(some.floats(), max_size=8)))
def test_any_text_is_read_as_a_recording_or_refused(
    tmp_path: Path, text: str, stiffness: float, rows: list[list[float]]
) -> None:
    columns = "frame,is_dragging,target_x,target_y,target_z,grabbed_x,grabbed_y,grabbed_z"
    lines = "\n".join(",".join(map(repr, row)) for row in rows)
    whole = f"# spring_stiffness_n_per_m: {stiffness}\n# grab_radius_m: 0.1\n{columns}\n{lines}\n{text}"
    (tmp_path / "a.csv").write_text(whole, encoding="utf-8", newline="")
    try:
        motion = read_recording(tmp_path / "a.csv", "a")
    except MotionError as error:
        assert "\n" not in str(error)
        return
    assert all(math.isfinite(drag.stiffness) and np.isfinite(drag.targets).all() for drag in motion.drags)

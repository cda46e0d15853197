"""Recorded interactions: one CSV row a frame, as the paper's authors published them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ldsim.errors import MotionError
from ldsim.mechanics.motion import Drag, Motion

COLUMNS = ("is_dragging", "target_x", "target_y", "target_z", "grabbed_x", "grabbed_y", "grabbed_z")
NEEDED = {"spring_stiffness_n_per_m": "N/m", "grab_radius_m": "m"}


def read_recording(path: Path, name: str) -> Motion:
    """Read a recording as a motion.

    `#` lines carry `key: value`; spring_stiffness_n_per_m and grab_radius_m are used. A drag is a run of rows with
    is_dragging = 1; it takes hold at the grabbed point of its first row.

    Raises:
        MotionError: the file cannot be read, lacks a column or a needed key, or holds something that is not a number.
    """
    if not path.is_file():
        raise MotionError(f"recording {path} cannot be read: it is no file")
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise MotionError(f"recording {path} cannot be read: {error}") from error
    notes = [line for line in lines if line.lstrip('"').startswith("#")]
    header = dict(_key_value(line) for line in notes if ":" in line)
    rows = [[word.strip() for word in line.split(",")] for line in lines if line.strip(", ") and line not in notes]
    if len(rows) < 2:
        raise MotionError(f"recording {path} holds no frames; expected a header line and one row a frame")
    missing = [column for column in COLUMNS if column not in rows[0]]
    if missing:
        raise MotionError(f"recording {path} lacks the column {missing[0]!r}; expected {', '.join(COLUMNS)}")
    stiffness, radius = (_needed(header, key, unit, path) for key, unit in NEEDED.items())
    order = [rows[0].index(column) for column in COLUMNS]
    table = np.empty((len(rows) - 1, len(COLUMNS)))
    for i, row in enumerate(rows[1:]):
        try:
            table[i] = [float(row[j]) for j in order]
        except (ValueError, IndexError) as error:
            raise MotionError(
                f"recording {path}, frame row {i}: {','.join(row)!r} does not hold seven numbers"
            ) from error
    if not np.isfinite(table).all():
        first = int(np.argwhere(~np.isfinite(table))[0, 0])
        raise MotionError(f"recording {path}, frame row {first} holds a value that is not finite")
    return Motion(name, len(table), tuple(_drags(table, radius, stiffness)))


def write_recording(path: Path, motion: Motion, notes: Mapping[str, str | float] | None = None) -> None:
    """Write a motion as a recording that `read_recording` reads back to the last bit.

    Args:
        notes: further `key: value` lines, such as the mesh it was recorded on.

    Raises:
        MotionError: a row a frame cannot hold the motion: two drags overlap or touch, differ in radius or stiffness, or
            take hold at rest; or the file cannot be written.
    """
    table = np.zeros((motion.frames, len(COLUMNS)))
    previous = -1
    for drag in sorted(motion.drags, key=lambda drag: drag.start):
        if drag.start <= previous or drag.at_rest or _spring(drag) != _spring(motion.drags[0]):
            raise MotionError(
                f"motion {motion.name!r} cannot be written as a recording: its drag at frame {drag.start} follows "
                "another without a frame between, has another radius or stiffness, or takes hold at rest"
            )
        previous = drag.stop
        rows = table[drag.start : drag.stop]
        rows[:, 0], rows[:, 1:4], rows[:, 4:] = 1, drag.targets[: len(rows)], drag.point
    stiffness, radius = _spring(motion.drags[0]) if motion.drags else (1.0, 1.0)  # unused
    header = {**(notes or {}), **dict(zip(NEEDED, (stiffness, radius), strict=True)), "frames": motion.frames}
    lines = [f"# {key}: {value}" for key, value in header.items()] + [",".join(("frame", *COLUMNS))]
    lines += [
        ",".join((str(i), str(int(row[0])), *(repr(float(x)) if x else "0" for x in row[1:])))
        for i, row in enumerate(table)
    ]
    try:
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    except OSError as error:
        raise MotionError(f"recording {path} cannot be written: {error.strerror}; choose another file") from error


def _spring(drag: Drag) -> tuple[float, float]:
    return drag.stiffness, drag.radius


def _key_value(line: str) -> tuple[str, str]:
    key, value = line.strip('," ').lstrip("# ").split(":", 1)  # a spreadsheet quotes, and pads with commas
    return key.strip(), value.strip()


def _needed(header: dict[str, str], key: str, unit: str, path: Path) -> float:
    try:
        value = float(header[key])
    except (KeyError, ValueError) as error:
        raise MotionError(f"recording {path} needs a line '# {key}: <number in {unit}>'") from error
    positive = unit == "N/m"  # a radius of nothing holds the nearest vertex
    if not 0 <= value < np.inf or (positive and value == 0):
        allowed = "positive" if positive else "0 or more"
        raise MotionError(f"recording {path}: {key} is {value:g} {unit}; it must be {allowed} and finite")
    return value


def _drags(table: np.ndarray, radius: float, stiffness: float) -> list[Drag]:
    """The runs of rows with is_dragging = 1."""
    dragging = np.concatenate([[0], (table[:, 0] > 0.5).astype(int), [0]])
    starts, stops = np.flatnonzero(np.diff(dragging) == 1), np.flatnonzero(np.diff(dragging) == -1)
    return [
        Drag(int(start), table[start, 4:7], np.ascontiguousarray(table[start:stop, 1:4]), radius, stiffness)
        for start, stop in zip(starts, stops, strict=True)
    ]

"""Recorded interactions: one CSV row a frame, as the paper's authors published them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ldsim.errors import MotionError
from ldsim.mechanics.motion import Drag, Motion

COLUMNS = ("is_dragging", "target_x", "target_y", "target_z", "grabbed_x", "grabbed_y", "grabbed_z")
NEEDED = {"spring_stiffness_n_per_m": "N/m", "grab_radius_m": "m"}


def read_recording(path: Path, name: str, frames: int | None = None) -> Motion:
    """Read a recording as a motion.

    `#` lines carry `key: value`; spring_stiffness_n_per_m and grab_radius_m are used. A drag is a run of rows with
    is_dragging = 1; it takes hold at the grabbed point of its first row.

    Args:
        frames: use only the first frames.

    Raises:
        MotionError: the file cannot be read, lacks a column or a needed key, or holds something that is not a number.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise MotionError(f"recording {path} cannot be read: {error}") from error
    header = dict(_key_value(line) for line in lines if line.startswith("#") and ":" in line)
    rows = [line.split(",") for line in lines if line.strip() and not line.startswith("#")]
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
    table = table[:frames]
    return Motion(name, len(table), tuple(_drags(table, radius, stiffness)))


def _key_value(line: str) -> tuple[str, str]:
    key, value = line.lstrip("# ").split(":", 1)
    return key.strip(), value.strip()


def _needed(header: dict[str, str], key: str, unit: str, path: Path) -> float:
    try:
        value = float(header[key])
    except (KeyError, ValueError) as error:
        raise MotionError(f"recording {path} needs a line '# {key}: <number in {unit}>'") from error
    if not value > 0:
        raise MotionError(f"recording {path}: {key} is {value:g} {unit}; it must be positive")
    return value


def _drags(table: np.ndarray, radius: float, stiffness: float) -> list[Drag]:
    """The runs of rows with is_dragging = 1."""
    dragging = np.concatenate([[0], (table[:, 0] > 0.5).astype(int), [0]])
    starts, stops = np.flatnonzero(np.diff(dragging) == 1), np.flatnonzero(np.diff(dragging) == -1)
    return [
        Drag(int(start), table[start, 4:7], np.ascontiguousarray(table[start:stop, 1:4]), radius, stiffness)
        for start, stop in zip(starts, stops, strict=True)
    ]

"""The notebook's drawings, from the results that they show: reproduction/results/*.json."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from reproduction.bench import frontier, full_space
from reproduction.harness import RESULTS, Row

FRAME = re.compile(r"median dragging frame, (\d+) cells")


def drawings() -> Iterator[tuple[str, str, Path]]:
    """Of every drawing its file's name, itself as SVG, and the result that it shows."""
    for file in sorted(RESULTS.glob("*.json")):
        rows: list[Row] = json.loads(file.read_text(encoding="utf-8"))["rows"]
        name = file.stem.partition("_")[2]
        if file.stem == "full_space_scaling":
            yield "full_space_scaling.svg", _scaling(rows), file
        elif file.stem.startswith("frontier_"):
            yield f"{file.stem}.svg", frontier.picture(rows, name), file


def _scaling(rows: list[Row]) -> str:
    frames = [(int(told[1]), r["value"]) for r in rows if (told := FRAME.fullmatch(r["quantity"]))]
    cells, ms = np.array(frames).T
    exponent, constant = np.polyfit(np.log(cells), np.log(ms), 1)
    return full_space.picture(cells, ms, float(exponent), float(np.exp(constant)))

"""The notebook's drawings, from the results that they show: reproduction/results/*.json."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from reproduction.bench import cubature, frontier, full_space, space, step_frontier
from reproduction.harness import RESULTS, Row

STEPPED = re.compile(r"median step, (\w+) (\d+), k (\d+), (\d+) points, stop (\S+) N, (\w+)")
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
        elif file.stem.startswith("space_"):
            yield f"space_{name}.svg", space.picture(rows, name), file
        elif file.stem == "cubature":
            start = "error, held-out poses, "
            for model in sorted({r["model"] for r in rows if r["quantity"].startswith(start)}):
                yield f"cubature_{model}.svg", cubature.picture(rows, model), file
        elif file.stem.startswith("step_") and (table := points(rows)):
            for motion in dict.fromkeys(point.motion for point in table):
                yield f"step_{name}_{motion}.svg", step_frontier.picture(name, motion, table), file


def points(rows: list[Row]) -> list[step_frontier.Point]:
    """The table that `step_frontier.rows` was given, by the labels of its rows; minimisers are not among them."""
    value = {r["quantity"]: np.nan if r["value"] is None else r["value"] for r in rows}
    found = []
    for quantity in value:
        if told := STEPPED.fullmatch(quantity):
            label = quantity.removeprefix("median step, ")
            kinds = ("median step", "99th percentile", "evaluations a step", "online error", "windowed error")
            found.append(
                step_frontier.Point(
                    *(told[1], told[6], int(told[2]), int(told[3]), int(told[4]), float(told[5]), ""),
                    *(value[f"{kind}, {label}"] for kind in kinds),
                )
            )
    return found


def _scaling(rows: list[Row]) -> str:
    frames = [(int(told[1]), r["value"]) for r in rows if (told := FRAME.fullmatch(r["quantity"]))]
    cells, ms = np.array(frames).T
    exponent, constant = np.polyfit(np.log(cells), np.log(ms), 1)
    return full_space.picture(cells, ms, float(exponent), float(np.exp(constant)))

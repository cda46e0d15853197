"""What takes long is kept in files, so that a benchmark that was interrupted goes on where it was."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TypeVar

import numpy as np

from ldsim.artefacts.atomic import replacing
from ldsim.cubature.rule import CubatureRule
from reproduction.harness import write_json

Kept = TypeVar("Kept")


def kept(path: Path, measure: Callable[[], Kept]) -> Kept:
    """What a JSON file holds, measured where there is none; says what is going on."""
    if not path.exists():
        started = time.perf_counter()
        print(f"{path.stem} …", file=sys.stderr, flush=True)
        write_json(path, {"kept": measure()})
        print(f"{path.stem}: {time.perf_counter() - started:.0f} s", file=sys.stderr, flush=True)
    found: Kept = json.loads(path.read_text(encoding="utf-8"))["kept"]
    return found


def kept_rules(path: Path, make: Callable[[], Sequence[CubatureRule]]) -> list[CubatureRule]:
    """The cubature rules of an npz file, made where there is none."""
    if not path.exists():
        print(f"{path.stem}: fitting", file=sys.stderr, flush=True)
        arrays = {
            f"{i}/{entry.name}": value
            for i, rule in enumerate(make())
            for entry in fields(rule)
            if (value := getattr(rule, entry.name)) is not None
        }
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.savez(file, **arrays)
    with np.load(path) as stored:
        rules: dict[int, dict[str, np.ndarray]] = {}
        for name in stored.files:
            number, _, key = name.partition("/")
            rules.setdefault(int(number), {})[key] = stored[name]
    return [_rule(values) for _, values in sorted(rules.items())]


def _rule(values: dict[str, np.ndarray]) -> CubatureRule:
    scalars = {name: float(value) for name, value in values.items() if value.ndim == 0}
    return CubatureRule(**{**values, **scalars})  # type: ignore[arg-type]

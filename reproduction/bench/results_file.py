"""The file of a benchmark's results, results/<name>.json: committed, so that history shows."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ldsim.report.machine import describe_machine

RESULTS = Path(__file__).parent / "results"

Row = dict[str, object]


def row(model: str, quantity: str, value: object, unit: str = "", goal: str | None = None) -> Row:
    """One measured number; the goal is a comparison such as ">= 10"."""
    return {"model": model, "quantity": quantity, "value": value, "unit": unit, "goal": goal}


def write_results(
    name: str,
    command: str,
    rows: Sequence[Mapping[str, object]],
    machine: Mapping[str, Any] | None = None,
    created: str | None = None,
) -> Path:
    """Write what was measured, with where and when; returns the file.

    Args:
        name: of the file.
        command: what makes it again, such as "python benchmarks/step.py runs/x".
        rows: {model, quantity, value, unit, goal} each; a goal is a comparison such as ">= 10", or None.
        machine: where it was measured, as `describe_machine` says it; by default here.
        created: when, in ISO format; by default now.
    """
    described = describe_machine() if machine is None else machine
    content = {
        "machine": {key: value for key, value in described.items() if key != "versions"},
        "versions": described["versions"],
        "command": command,
        "created": created or datetime.now(UTC).isoformat(timespec="seconds"),
        "rows": rows,
    }
    path = RESULTS / f"{name}.json"
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return path

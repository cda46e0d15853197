"""The file that a benchmark writes: its rows with the machine, versions and command they came from."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path

from ldsim.evaluation.machine import describe_machine

Row = dict[str, object]

RESULTS = Path(__file__).parent / "results"


def row(model: str, quantity: str, value: object, unit: str = "", goal: str | None = None) -> Row:
    """One measured number; the goal is a comparison such as ">= 10"."""
    return {"model": model, "quantity": quantity, "value": value, "unit": unit, "goal": goal}


def show(rows: list[Row]) -> None:
    """Print rows, a line each."""
    for entry in rows:
        words = f"{entry['model']}: {entry['quantity']} = {float(str(entry['value'])):.4g} {entry['unit']}".rstrip()
        print(f"{words} (goal {entry['goal']})" if entry["goal"] else words, flush=True)


def write(name: str, command: str, rows: list[Row]) -> Path:
    """Write results/<name>.json and return its path."""
    described = describe_machine()
    content = {
        "machine": {key: value for key, value in described.items() if key != "versions"},
        "versions": described["versions"],
        "command": command,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "rows": rows,
    }
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / f"{name}.json"
    path.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return path

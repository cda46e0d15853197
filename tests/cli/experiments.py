"""A finished experiment of a few dozen cells, and how commands are run on it."""

from __future__ import annotations

import copy
import hashlib
import importlib.util
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from click.testing import CliRunner, Result

from ldsim.cli.app import main
from ldsim.settings import STAGES

WRITES = {
    "mesh": "scene.h5",
    "snapshot": "snapshots.h5",
    "pca": "basis.h5",
    "train": "model.h5",
    "cubature": "cubature.h5",
    "simulate": "simulation.h5",
}
READS = {
    "mesh": [],
    "snapshot": ["scene.h5"],
    "pca": ["scene.h5", "snapshots.h5"],
    "train": ["scene.h5", "snapshots.h5", "basis.h5"],
    "cubature": ["scene.h5", "snapshots.h5", "basis.h5", "model.h5"],
    "simulate": ["scene.h5", "snapshots.h5", "basis.h5", "model.h5", "cubature.h5"],
    "report": ["scene.h5", "snapshots.h5", "basis.h5", "model.h5", "cubature.h5", "simulation.h5"],
}
COMMANDS = [stage for stage in STAGES if importlib.util.find_spec(f"ldsim.cli.{stage}")]

TINY: dict[str, Any] = {
    "experiment": "tiny",
    "mesh": {
        "shape": {"name": "cross", "resolution": 1},
        "material": {"youngs_modulus": 4.0e4},
        "pins": [{"slab": {"axis": "y", "thickness": 0.001}}],
    },
    "snapshot": {
        "motions": [
            {"name": "a", "pulls": {"count": 2, "seed": 1, "reach": 0.08, "frames": 12, "rest": 8}},
            {
                "name": "b",
                "role": "validation",
                "pulls": {"count": 1, "seed": 2, "reach": 0.08, "frames": 12, "rest": 8},
            },
        ],
        "workers": 1,
    },
    "pca": {"k": 6},
    "train": {"kind": "autoencoder", "r": 3, "hidden": [8], "epochs": 200, "batch": 16},
    "cubature": {"poses": 20, "heldout_poses": 10, "virtual": {"steps": 40}, "linear_sizes": [2]},
    "simulate": {
        "full_frames": 5,
        "statement": {"motions": 5, "pulls": {"count": 1, "seed": 9, "reach": 0.08, "frames": 12, "rest": 4}},
    },
    "report": {"pictures": True},
}


@dataclass(frozen=True)
class Experiment:
    """A configuration and the folder of its files."""

    folder: Path

    @property
    def config(self) -> Path:
        return self.folder / "tiny.yaml"

    @property
    def run(self) -> Path:
        return self.folder / "runs" / "tiny"

    def configure(self, content: dict[str, Any]) -> None:
        self.config.write_text(yaml.safe_dump(content), encoding="utf-8")

    def change(self, path: str, value: object) -> None:
        """Set one dotted key of the configuration, or remove it where the value is `...`."""
        content = copy.deepcopy(TINY)
        *sections, last = path.split(".")
        place: Any = content
        for part in sections:
            place = place[int(part)] if part.isdigit() else place[part]
        if value is ...:
            del place[last]
        else:
            place[last] = value
        self.configure(content)

    def invoke(self, command: str, *flags: str) -> Result:
        return invoked(command, str(self.config), "--runs", str(self.folder / "runs"), *flags)

    def finished(self) -> dict[str, str]:
        """Every finished file of the run with the hash of what it holds."""
        return {str(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in self._files()}

    def _files(self) -> Iterator[Path]:
        for path in sorted(self.run.rglob("*")):
            if path.is_file() and not any(part.endswith(".partial") for part in path.parts):
                yield path


def invoked(*words: str) -> Result:
    """What the command `ldsim` with these words does."""
    return CliRunner().invoke(main, words)


def refused(result: Result) -> str:
    """The one line of a refusal: exit status 1, last on stderr but for one line a fault, without a traceback."""
    assert result.exit_code == 1, result.output
    assert isinstance(result.exception, SystemExit), result.exception
    lines = [line for line in result.stderr.splitlines() if line.strip()]
    assert [line.startswith("error: ") for line in lines].count(True) == 1, result.stderr
    more = [line for line in lines if line.startswith("  ") and line[2:3].strip()]
    said, *faults = lines[-1 - len(more) :]
    assert said.startswith("error: ") and faults == more
    assert "Traceback" not in result.output
    return "\n".join((said.removeprefix("error: "), *(fault.strip() for fault in faults)))


def refusal(experiment: Experiment, command: str) -> str:
    """The refusal of a command, after which all finished files are what they were."""
    before = experiment.finished()
    message = refused(experiment.invoke(command))
    assert experiment.finished() == before
    return message


def change(path: str, value: object) -> Callable[[Experiment], None]:
    """What changes one key of the configuration of an experiment."""
    return lambda experiment: experiment.change(path, value)

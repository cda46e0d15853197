"""The configuration that a run was made by, put together from what its artefacts say."""

from __future__ import annotations

from typing import Any

from ldsim.cubature.options import CubatureOptions
from ldsim.learn.options import TrainOptions
from ldsim.options import Options, as_yaml, of_yaml
from ldsim.pipeline.options import MeshOptions, MotionOptions, SimulateOptions, SnapshotOptions
from ldsim.run import Run
from ldsim.space.options import PcaOptions

MADE_BY: dict[str, tuple[str, type[Options]]] = {
    "mesh": ("scene", MeshOptions),
    "snapshot": ("snapshots", SnapshotOptions),
    "pca": ("basis", PcaOptions),
    "train": ("model", TrainOptions),
    "cubature": ("cubature", CubatureOptions),
    "simulate": ("simulation", SimulateOptions),
}


def configuration(run: Run) -> str:
    """As YAML, without what is default: `ldsim make` of it makes the run again, where its input files still are."""
    sections = {stage: _given(run, kind, options) for stage, (kind, options) in MADE_BY.items()}
    if run.path("tests").is_file():
        motions = of_yaml(run.header("tests").settings).get("motions", ())
        given = [MotionOptions(**motion).model_dump(mode="json", exclude_defaults=True) for motion in motions]
        sections["snapshot"].setdefault("motions", []).extend(given)
    return as_yaml({"experiment": run.experiment} | {name: section for name, section in sections.items() if section})


def _given(run: Run, kind: str, options: type[Options]) -> dict[str, Any]:
    text = run.header(kind).settings
    return options.of_dump(text).model_dump(mode="json", exclude_defaults=True) if text else {}

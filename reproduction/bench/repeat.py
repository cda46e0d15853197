"""Which stages repeat to the last bit on another kind of processor, and how far a whole model then is from the first.

    python -m reproduction.bench.repeat configs/ci.yaml --folder runs/repeat

Another processor is imitated on this one: numpy, OpenBLAS, torch and numba are each told to do without AVX-512, as on a
processor that has AVX2 only, and then all of them together. Each stage reads what the first run wrote, so that what
differs is its own doing; then the whole pipeline runs once more with each. Beside them stand the same again, two
threads in place of one, and other seeds on the same processor. Results go to reproduction/results/repeat.json; only a
processor with AVX-512 can tell.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import h5py
import numpy as np

from ldsim.artefacts.sealed_file import datasets
from ldsim.report.frontier import on_role
from ldsim.report.schema import ROLES
from ldsim.run import Run
from ldsim.settings import Settings, load_settings
from ldsim.settings.make import KINDS_OF
from reproduction.bench.frontier import seeded
from reproduction.harness import (
    FUNCTIONS,
    PIPELINE,
    ROOT,
    Row,
    called,
    linked,
    parser,
    row,
    show,
    write_results,
)

NAME = "repeat"
SEEDS = (101, 102)
# What MKL_NUM_THREADS says torch obeys whatever ldsim allows it, so that is not set.
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
AVX2 = {
    "numpy": {"NPY_DISABLE_CPU_FEATURES": "X86_V4"},
    "OpenBLAS": {"OPENBLAS_CORETYPE": "Haswell"},
    "torch": {"ATEN_CPU_CAPABILITY": "avx2", "MKL_ENABLE_INSTRUCTIONS": "AVX2", "ONEDNN_MAX_CPU_ISA": "AVX2"},
    "numba": {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": "+sse4.2,+popcnt,+avx,+avx2,+bmi,+bmi2,+fma,+f16c"},
}
VARIANTS: dict[str, dict[str, str]] = {
    "the same again": {},
    "two threads": dict.fromkeys(THREADS, "2"),
    **{f"{library} without AVX-512": variables for library, variables in AVX2.items()},
    "all without AVX-512": {name: value for variables in AVX2.values() for name, value in variables.items()},
}


def called_stage(stage: str, config: Path, runs: Path, variables: Mapping[str, str]) -> None:
    """One stage in a process of its own; libraries read these variables when they are loaded."""
    environment = {**os.environ, **dict.fromkeys(THREADS, "1"), **variables}
    command = [sys.executable, "-m", "ldsim", stage, str(config), "--runs", str(runs)]
    subprocess.run(command, env=environment, check=True)


def made(config: Path, settings: Settings, runs: Path, variables: Mapping[str, str]) -> Path:
    """The folder of a whole run."""
    folder = runs / settings.experiment
    if not (folder / "simulation.h5").exists():
        for stage in FUNCTIONS:
            called_stage(stage, config, runs, variables)
    return folder


def numbers(path: Path) -> dict[str, np.ndarray]:
    """Every dataset of real numbers of an artefact but measured times; what a minimiser counts is none."""
    with h5py.File(path) as file:
        real = {name: data for name, data in datasets(file).items() if data.dtype.kind == "f"}
        return {
            name: np.asarray(data[()], dtype=float)
            for name, data in real.items()
            if name.rpartition("/")[2] != "seconds"
        }


def difference(one: Path, other: Path) -> float:
    """The largest difference of two artefacts, over the largest entry of its dataset; infinite where one has other
    datasets or more rows."""
    first, second = numbers(one), numbers(other)
    if {name: value.shape for name, value in first.items()} != {name: value.shape for name, value in second.items()}:
        return np.inf
    largest = 0.0
    for name, value in first.items():
        apart = np.abs(np.nan_to_num(value) - np.nan_to_num(second[name])).max(initial=0.0)
        largest = max(largest, apart / (np.abs(np.nan_to_num(value)).max(initial=0.0) or 1.0))
    return largest


def errors(folder: Path) -> Iterator[tuple[str, float]]:
    """The online error of the latent space on every role's motions."""
    with Run.open(folder) as run:
        for role in ROLES:
            for found in on_role(run, role):
                if found.space == "latent":
                    yield f"online error, {role}", found.error


def measured(config: Path, runs: Path) -> list[Row]:
    """The rows of one configuration."""
    settings, rows = load_settings(config), list[Row]()
    model = settings.experiment
    first = made(config, settings, runs / "first", {})
    rows += [row(model, f"{what}, first", value) for what, value in errors(first)]
    for variant, variables in VARIANTS.items():
        own = runs / variant.replace(" ", "_")
        known: list[str] = []
        for stage in FUNCTIONS:
            kinds = KINDS_OF[stage]
            folder = own / stage / model
            if not all((folder / f"{kind}.h5").exists() for kind in kinds):
                called_stage(stage, config, linked(first, folder, known).parent, variables)
            known += kinds
            apart = max(difference(first / f"{kind}.h5", folder / f"{kind}.h5") for kind in kinds)
            rows.append(row(model, f"largest difference, {stage}, {variant}", apart))
        whole = made(config, settings, own / "whole", variables)
        rows += [row(model, f"{what}, {variant}", value) for what, value in errors(whole)]
    for seed in SEEDS:
        path = runs / f"seed_{seed}.yaml"
        changed = seeded(settings, seed, settings)
        path.write_text(changed.dump(), encoding="utf-8")
        folder = made(path, changed, runs / f"seed_{seed}", {})
        rows += [row(model, f"{what}, seed {seed}", value) for what, value in errors(folder)]
    return rows


def main() -> None:
    arguments = parser(NAME, __doc__)
    arguments.add_argument("configurations", nargs="+", type=Path, help="of small solids; each is made some ten times")
    arguments.add_argument("--folder", type=Path, default=Path("runs") / NAME, help="where runs lie; kept runs go on")
    given, rows = arguments.parse_args(), list[Row]()
    for path in given.configurations:
        own = measured(path.resolve(), given.folder.resolve() / path.stem)
        show(own, path.stem)
        rows += own
    inputs = [str(path.resolve().relative_to(ROOT)) for path in given.configurations]
    write_results(NAME, called(NAME), rows, inputs=[*PIPELINE, *inputs])


if __name__ == "__main__":
    main()

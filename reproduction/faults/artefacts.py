"""Attacks on artefacts: spoilt ones are given to commands that read them, checkpoints to the stage that wrote them."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from unittest.mock import patch

import h5py
import numpy as np

from ldsim.learn import training
from ldsim.pipeline import pca, train
from reproduction.faults.alone import invoke, outcome
from reproduction.faults.bench import EXPERIMENTS, KINDS, PICTURES, Bench, own_copy, same
from reproduction.faults.mutations import OF_ARTEFACTS, sealed

Found = Iterator[tuple[str, str, str]]
READERS = {
    "scene": ("pca", "train", "simulate", "export", "report"),
    "snapshots": ("snapshot", "pca", "train", "cubature", "simulate", "report"),
    "tests": ("snapshot", "simulate", "report"),
    "basis": ("train", "cubature", "simulate", "export", "report"),
    "model": ("cubature", "simulate", "export", "report"),
    "cubature": ("simulate", "export", "report"),
    "simulation": ("export", "report"),
}
LOOKS = ("info", "info of the run", "list", "make")
TELLS = LOOKS[1:]  # which say what is wrong with it and end well
FORMATS = ("npz", "safetensors", "c", "gltf")


def artefacts(bench: Bench, rng: np.random.Generator) -> Found:
    """A spoilt artefact, a command that looks at it, and one that works with it."""
    name, kind = str(rng.choice(EXPERIMENTS)), str(rng.choice(KINDS))
    how = str(rng.choice(list(OF_ARTEFACTS)))
    run = bench.copy(name)
    path = run / f"{kind}.h5"
    before = own_copy(path)
    spoil, must_be_refused = OF_ARTEFACTS[how]
    spoil(path, rng)
    after = path.read_bytes()
    if after == before:
        return
    yield "spoilt artefacts", "files", ""
    if rng.random() < 0.5:
        relinked(run, kind)
    readers = READERS[kind] if rng.integers(4) == 0 else READERS[kind][:-1]  # a report takes longer than all others
    commands = [str(rng.choice(LOOKS)), str(rng.choice(readers))]
    form, pictures = str(rng.choice(FORMATS)), PICTURES if rng.integers(10) == 0 else ""
    told = bench.alone(*(partial(_read, bench, command, path, form, pictures) for command in commands))
    for command, said in zip(commands, told, strict=False):
        said = "silent" if must_be_refused and said == "accepted" and command not in TELLS else said
        must_be_refused &= said != "made anew"
        bench.keep(said, f"{how}-{command}-{hashlib.sha256(after).hexdigest()[:12]}-{kind}.h5", after)
        yield "commands on spoilt artefacts", said, f"{how} of {kind} of {name}, {command}"


def _read(bench: Bench, command: str, path: Path, form: str, pictures: str) -> str:
    run = path.parent
    if command in LOOKS:
        words: dict[str, tuple[object, ...]] = {
            "info": ("info", path),
            "info of the run": ("info", run),
            "list": ("list", "--runs", bench.made),
            "make": ("make", bench.config(run.name), "--runs", bench.made, "--dry-run"),
        }
        return outcome(invoke(*words[command]))
    if command == "export":
        return outcome(invoke("export", run, "--format", form, "--output", bench.made / "exported"))
    said = bench.stage(command, run.name + (pictures if command == "report" else ""), bench.made)
    anew = command == "snapshot" and said == "accepted" and same(path, bench.whole / run.name / path.name)
    return "made anew" if anew else said


def relinked(run: Path, spoilt: str) -> None:
    """Write the hash of a spoilt artefact into those that were made from it, as who did it on purpose would."""
    for kind in KINDS[KINDS.index(spoilt) + 1 :]:
        path = run / f"{kind}.h5"
        own_copy(path)
        with h5py.File(path, "r+") as file:
            inputs = json.loads(file.attrs["inputs"])
            hashes = {name: hashlib.sha256((run / f"{name}.h5").read_bytes()).hexdigest() for name in inputs}
            file.attrs["inputs"] = json.dumps(hashes)
        sealed(path)


def checkpoints(bench: Bench, rng: np.random.Generator) -> Found:
    """A spoilt checkpoint of an interrupted stage, which does that piece anew or refuses it, but never uses it."""
    name, stage = [("small", "train"), ("condensed", "train"), ("small", "pca")][int(rng.integers(3))]
    kept = bench.folder / "partial" / f"{name}-{stage}"
    kind = {"train": "model", "pca": "basis"}[stage]
    if not kept.exists():
        _interrupted(bench, name, stage, kept)
    run = bench.copy(name)
    left = run / f"{kind}.partial"
    shutil.copytree(kept, left)
    (run / f"{kind}.h5").unlink()
    paths = sorted(left.rglob("*.h5"))
    path = paths[int(rng.integers(len(paths)))]
    before = path.read_bytes()
    how = str(rng.choice(list(OF_ARTEFACTS)))
    spoil, must_be_refused = OF_ARTEFACTS[how]
    spoil(path, rng)
    if path.read_bytes() == before:
        return
    (said,) = bench.alone(partial(bench.stage, stage, name, bench.made))
    whole = same(run / f"{kind}.h5", bench.whole / name / f"{kind}.h5")
    said = "silent" if must_be_refused and said == "accepted" and not whole else said
    bench.keep(said, f"{how}-{path.name}", path.read_bytes() if path.exists() else b"")
    yield "spoilt checkpoints", said, f"{how} of {path.name} of {name}, {stage}"


def _interrupted(bench: Bench, name: str, stage: str, kept: Path) -> None:
    """All checkpoints that a stage writes, kept when it would remove them."""

    def keep(folder: Path) -> None:
        shutil.move(folder, kept)

    def trial() -> str:
        often = patch.object(training, "CHECKPOINT", 10)  # epochs: it has 40
        with often, patch.object(train, "remove_checkpoints", keep), patch.object(pca, "remove_checkpoints", keep):
            return bench.stage(stage, name, bench.made)

    run = bench.copy(name)
    (run / ("model.h5" if stage == "train" else "basis.h5")).unlink()
    kept.parent.mkdir(exist_ok=True)
    (said,) = bench.alone(trial)
    assert said == "accepted" and any(kept.rglob("*.h5")), said

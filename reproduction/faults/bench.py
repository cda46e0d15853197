"""What every attack works on: two small finished runs, and a copy of one to spoil."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import sys
import tempfile
from functools import partial
from pathlib import Path
from unittest.mock import patch

import h5py
from click.testing import Result

from ldsim.artefacts.sealed_file import datasets
from ldsim.artefacts.store import STAGE_OF
from ldsim.settings import STAGES
from reproduction.faults.alone import FAULTS, Trial, alone, invoke, outcome

ROOM = Path(__file__).parent
EXPERIMENTS = ("small", "condensed")
KINDS = ("scene", "snapshots", "tests", "basis", "model", "cubature", "simulation")
# The same configuration with a report of pictures, which take ten times as long as all else that it shows.
PICTURES = "_pictures"
WRITES = {stage: kind for kind, stage in STAGE_OF.items()}


class Bench:
    """The folder of a campaign.

    Attributes:
        whole: the finished runs, which nothing changes.
        made: where the copy of one is spoilt, of this process alone.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.whole, self.made = folder, folder / "whole", folder / "made" / str(os.getpid())
        scratch = folder / "scratch"
        scratch.mkdir(parents=True, exist_ok=True)
        tempfile.tempdir, os.environ["TMPDIR"], sys.dont_write_bytecode = str(scratch), str(scratch), True
        for name in EXPERIMENTS:
            text = (ROOM / f"{name}.yaml").read_text(encoding="utf-8")
            self.config(name).write_text(text, encoding="utf-8")
            self.config(f"{name}{PICTURES}").write_text(
                text.replace("pictures: false", "pictures: true"), encoding="utf-8"
            )
            for stage in STAGES if not (self.whole / name / "report").exists() else ():
                (said,) = self.alone(partial(self.stage, stage, name, self.whole))
                assert said == "accepted", f"{stage} of {name}: {said}"

    def config(self, name: str) -> Path:
        return self.folder / f"{name}.yaml"

    def command(self, stage: str, name: str, runs: Path) -> Result:
        return invoke(stage, self.config(name), "--runs", runs)

    def stage(self, stage: str, name: str, runs: Path) -> str:
        """What came of a stage; its workers are forked too, and need no start of their own."""
        forked = multiprocessing.get_context("fork")
        with patch.object(multiprocessing, "get_context", lambda _: forked):
            return outcome(self.command(stage, name, runs))

    def copy(self, name: str) -> Path:
        """A run again, its files linked but for those that a trial replaces."""
        shutil.rmtree(self.made, ignore_errors=True)
        apart = shutil.ignore_patterns("report", "*.partial")
        shutil.copytree(self.whole / name, self.made / name, copy_function=os.link, ignore=apart)
        return self.made / name

    def alone(self, *trials: Trial) -> list[str]:
        """Trials in a process of their own that may change nothing outside the campaign's folder and the caches."""
        return alone(trials, within=(self.folder, Path.home() / ".cache", Path.home() / ".config"))

    def keep(self, said: str, name: str, content: bytes) -> None:
        """Keep what found something."""
        if said.split(":")[0] in FAULTS:
            (self.folder / "found").mkdir(exist_ok=True)
            (self.folder / "found" / name).write_bytes(content)


def own_copy(path: Path) -> bytes:
    """Replace a linked file by a copy of its own; returns its content."""
    content = path.read_bytes()
    path.unlink()
    path.write_bytes(content)
    return content


def same(a: Path, b: Path) -> bool:
    """Whether two artefacts hold the same, times apart; one that cannot be read holds nothing."""
    if not a.is_file():
        return False
    with h5py.File(a) as one, h5py.File(b) as other:
        names = [name for name in datasets(one) if not name.endswith("seconds")]
        found = [name for name in datasets(other) if not name.endswith("seconds")]
        try:
            return names == found and all(one[name][()].tobytes() == other[name][()].tobytes() for name in names)
        except OSError:
            return False

"""Tries to break the program: spoilt artefacts, configurations, meshes and recordings, kills, violent loads.

Where a crash is possible, a trial runs in a process of its own, so that it is seen for what it is. Outcomes: refused
(one line, exit status 1), accepted (exit status 0), silent (accepted where it had to be refused), traceback, crash,
hang. Only the last four are faults; their messages are printed. `--trials` is for each attack; of kills there are a
hundredth.
"""

from __future__ import annotations

import json
import math
import os
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import h5py
import numpy as np
from click.testing import CliRunner, Result
from tqdm import trange

from ldsim.artefacts.opening import datasets
from ldsim.cli.app import main as ldsim
from ldsim.jit import one_thread
from ldsim.mechanics.motion import Drag, Motion
from ldsim.mechanics.recording import read_recording, write_recording
from ldsim.mesh.formats import read_surface
from ldsim.mesh.repair import repaired
from ldsim.run import SPACES, Run
from ldsim.simulator import load
from reproduction.bench.soak import soak
from reproduction.faults.mutations import OF_ARTEFACTS, text_spoilt
from reproduction.harness import Row, called, parser, row, show, write_results

ROOM, NAME = "faults", "campaign"
LIMIT = 120.0
FAULTS = ("silent", "traceback", "crash", "hang")
READERS = {
    "scene": ("info", "pca", "simulate"),
    "snapshots": ("info", "pca"),
    "basis": ("info", "cubature", "export"),
    "model": ("info", "simulate", "export"),
    "cubature": ("info", "simulate", "export"),
    "simulation": ("info", "report"),
}
STAGES = ("mesh", "snapshot", "pca", "train", "cubature", "simulate", "report")
Trial = Callable[[], str]


def outcome(result: Result) -> str:
    """What came of a command."""
    if result.exit_code == 0:
        return "accepted"
    lines = [line for line in result.stderr.splitlines() if line.startswith(("error: ", "Error: "))]
    if isinstance(result.exception, SystemExit) and len(lines) == 1:
        return "refused"
    return f"traceback: {result.exception!r}"


def alone(trial: Trial, limit: float = LIMIT) -> str:
    """The outcome of a trial in a process of its own."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        try:
            os.write(writing, trial().encode()[:2000])
        except BaseException as error:
            os.write(writing, f"traceback: {error!r}".encode()[:2000])
        os._exit(0)
    os.close(writing)
    ready, _, _ = select.select([reading], [], [], limit)
    if not ready:
        os.kill(child, signal.SIGKILL)
    said = os.read(reading, 4000).decode(errors="replace")
    os.close(reading)
    _, status = os.waitpid(child, 0)
    return "hang" if not ready else said or f"crash: signal {os.WTERMSIG(status)}"


def here(trial: Trial, limit: float = LIMIT) -> str:
    """The outcome of a trial of nothing compiled, which needs no process of its own."""

    def late(*_: object) -> None:
        raise TimeoutError

    signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, limit)
    try:
        return trial()
    except Exception as error:
        return f"traceback: {error!r}"
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


class Campaign:
    """One seed, one small finished run, and the counts of every attack."""

    def __init__(self, config: Path, folder: Path, seed: int, seconds: float) -> None:
        self.seconds = seconds
        self.config, self.folder, self.rng = config, folder, np.random.default_rng(seed)
        self.counts: dict[str, Counter[str]] = {}
        self.whole, self.made = folder / "whole", folder / "made"
        for stage in STAGES if not (self.whole / config.stem / "report").exists() else ():
            result = self.command(stage, self.whole)
            assert result.exit_code == 0, result.output
        self.run = self.whole / config.stem

    def command(self, name: str, runs: Path) -> Result:
        return CliRunner().invoke(ldsim, [name, str(self.config), "--runs", str(runs)])

    def count(self, attack: str, said: str, what: str) -> None:
        kind = said.split(":")[0]
        self.counts.setdefault(attack, Counter())[kind] += 1
        if kind in FAULTS:
            print(f"{attack}, {what}: {said}", flush=True)

    def copy(self) -> Path:
        """The run again, its files linked but for those that a trial replaces."""
        shutil.rmtree(self.made, ignore_errors=True)
        shutil.copytree(self.run, self.made / self.config.stem, copy_function=os.link)
        return self.made / self.config.stem

    def trials(self, most: int) -> Iterator[int]:
        """The numbers of an attack's trials, as many as its time allows."""
        started = time.monotonic()
        for number in trange(most, mininterval=30, file=sys.stderr):
            if time.monotonic() - started > self.seconds:
                return
            yield number

    def artefacts(self, trials: int) -> None:
        """Each spoilt artefact, and every command that reads it."""
        for _ in self.trials(trials):
            kind = str(self.rng.choice(list(READERS)))
            how = str(self.rng.choice(list(OF_ARTEFACTS)))
            run = self.copy()
            path = run / f"{kind}.h5"
            before = path.read_bytes()
            path.unlink()
            path.write_bytes(before)
            spoil, refused = OF_ARTEFACTS[how]
            spoil(path, self.rng)
            if path.read_bytes() == before:
                continue
            self.counts.setdefault("spoilt artefacts", Counter())["files"] += 1
            after = path.read_bytes()
            for command in READERS[kind]:
                said = alone(lambda: outcome(self.reader(command, path, run)))
                if refused and said == "accepted":
                    said = "silent"
                self.count("commands on spoilt artefacts", said, f"{how} of {kind}, {command}")
                if said.split(":")[0] in FAULTS:
                    (self.folder / f"found-{time.time_ns()}-{kind}.h5").write_bytes(after)

    def reader(self, command: str, path: Path, run: Path) -> Result:
        if command == "info":
            return CliRunner().invoke(ldsim, ["info", str(path)])
        if command == "export":
            words = ["export", str(run), "--format", "safetensors", "--output", str(self.made / "a.safetensors")]
            return CliRunner().invoke(ldsim, words)
        return self.command(command, self.made)

    def configurations(self, trials: int) -> None:
        """Spoilt texts of the configuration."""
        whole = self.config.read_text(encoding="utf-8")
        path = self.folder / "spoilt.yaml"
        for number in self.trials(trials):
            path.write_text(text_spoilt(whole, self.rng), encoding="utf-8")
            said = here(lambda: outcome(CliRunner().invoke(ldsim, ["settings", str(path)])))
            self.count("configurations", said, f"number {number}")

    def files(self, trials: int) -> None:
        """Spoilt meshes, surfaces and recordings."""
        scene = Run(self.run, self.config.stem).scene
        points = "\n".join(" ".join(map(repr, map(float, x))) + " 0" for x in scene.mesh.vertices)
        cells = "\n".join(" ".join(str(i + 1) for i in cell) + " 0" for cell in scene.mesh.cells)
        mesh = (
            f"MeshVersionFormatted 1\nDimension 3\nVertices\n{len(scene.mesh.vertices)}\n{points}\nTetrahedra\n"
            f"{len(scene.mesh.cells)}\n{cells}\nEnd\n"
        )
        corners = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
        surface = f"OFF\n4 4 6\n{corners}3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n"
        point = scene.mesh.vertices[scene.free[0]]
        pull = Drag(2, point, point + self.rng.normal(size=(30, 3)), 0.02, 30.0)
        write_recording(self.folder / "whole.csv", Motion("a", 40, (pull,)))
        recording = (self.folder / "whole.csv").read_text(encoding="utf-8")
        low = float(scene.mesh.vertices[:, 0].min())
        text = (
            "experiment: files\nmesh:\n  file: a.mesh\n  material: {youngs_modulus: 40000.0}\n  pins:\n"
            "  - slab: {axis: x, "
            f"thickness: {abs(low) * 1e-3 + 1e-3}}}\nsnapshot: {{motions: [{{name: a, recording: a.csv}}]}}\n"
        )
        (self.folder / "files.yaml").write_text(text, encoding="utf-8")
        attacks: dict[str, tuple[str, Callable[[Path], object]]] = {
            "mesh": (mesh, self._mesh_command),
            "off": (surface, lambda path: repaired(read_surface(path))),
            "csv": (recording, lambda path: read_recording(path, "a")),
        }
        for number in self.trials(trials):
            suffix = str(self.rng.choice(list(attacks)))
            whole, read = attacks[suffix]
            path = self.folder / f"a.{suffix}"
            path.write_text(text_spoilt(whole, self.rng), encoding="utf-8")
            self.count("meshes and recordings", here(lambda: _read(read, path)), f"{suffix} number {number}")

    def _mesh_command(self, path: Path) -> object:
        words = ["mesh", str(self.folder / "files.yaml"), "--runs", str(self.folder / "files")]
        return outcome(CliRunner().invoke(ldsim, words))

    def kills(self, trials: int) -> None:
        """A stage killed at a random moment and run again: the same datasets as those of the undisturbed run."""
        for number in self.trials(trials):
            stage = str(self.rng.choice(STAGES[:-1]))
            kind = {"mesh": "scene", "snapshot": "snapshots", "pca": "basis", "train": "model"}.get(stage, stage)
            kind = "simulation" if kind == "simulate" else kind
            run = self.copy()
            if self.rng.random() < 0.5:
                (run / f"{kind}.h5").unlink()
            words = [sys.executable, "-m", "ldsim", stage, str(self.config), "--runs", str(self.made)]
            quiet = subprocess.DEVNULL
            with subprocess.Popen(words, start_new_session=True, stdout=quiet, stderr=quiet) as process:
                time.sleep(float(self.rng.uniform(0.5, 12)))
                os.killpg(process.pid, signal.SIGKILL)
            again = subprocess.run(words, stdout=quiet, stderr=subprocess.PIPE, text=True, timeout=900)
            same = (
                again.returncode == 0 and kind in ("simulation",) or _same(run / f"{kind}.h5", self.run / f"{kind}.h5")
            )
            said = "continued" if same else f"silent: {again.stderr.strip().splitlines()[-1:]}"
            self.count("kills", said, f"{stage} number {number}")

    def soak(self, trials: int) -> None:
        """Violent loads in the three spaces, a hundred steps a trial."""
        for space in SPACES:
            simulator, rng = load(self.run, space, seconds=0.1), np.random.default_rng(1)
            for _ in self.trials(trials):
                soak(simulator, rng, 100)
            counts = {outcome.name.lower(): count for outcome, count in simulator.counts.items()}
            self.counts[f"steps in the {space} space"] = Counter(counts)

    def rows(self) -> list[Row]:
        rows = []
        for attack, counts in self.counts.items():
            tried = sum(count for kind, count in counts.items())
            rows.append(row(self.config.stem, f"{attack}, tried", tried))
            rows += [row(self.config.stem, f"{attack}, {kind}", counts[kind]) for kind in sorted(counts)]
            if not attack.startswith("steps") and attack != "spoilt artefacts":
                rows += [
                    row(self.config.stem, f"{attack}, {kind}", counts[kind], goal="0")
                    for kind in FAULTS
                    if kind not in counts
                ]
        return rows


def _read(read: Callable[[Path], object], path: Path) -> str:
    from ldsim.errors import LdsimError

    try:
        said = read(path)
    except LdsimError:
        return "refused"
    return said if isinstance(said, str) else "accepted"


def _same(a: Path, b: Path) -> bool:
    """Whether two artefacts hold the same, times apart."""
    if not a.is_file():
        return False
    with h5py.File(a) as one, h5py.File(b) as other:
        names = [name for name in datasets(one) if not name.endswith("seconds")]
        found = [name for name in datasets(other) if not name.endswith("seconds")]
        return names == found and all(one[name][()].tobytes() == other[name][()].tobytes() for name in names)


def main() -> None:
    arguments = parser(NAME, __doc__, ROOM)
    attacks = ("artefacts", "configurations", "files", "kills", "soak")
    arguments.add_argument("--config", type=Path, default=Path("configs/ci.yaml"))
    arguments.add_argument("--attacks", nargs="+", choices=attacks, default=attacks)
    arguments.add_argument("--trials", type=int, default=5000)
    arguments.add_argument("--seed", type=int, default=0)
    arguments.add_argument("--seconds", type=float, default=math.inf, help="that an attack may take at most")
    arguments.add_argument("--keep", type=Path, help="folder for the run and for what found something")
    arguments.add_argument("--quick", action="store_true", help="write no results")
    given = arguments.parse_args()
    folder = given.keep or Path(tempfile.mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    campaign = Campaign(given.config.resolve(), folder.resolve(), given.seed, given.seconds)
    for attack in given.attacks:
        with one_thread():
            getattr(campaign, attack)(given.trials // 100 if attack == "kills" else given.trials)
        show(campaign.rows(), attack)
        if not given.quick:
            write_results("faults", called(NAME, ROOM), campaign.rows())
    print(json.dumps({attack: dict(counts) for attack, counts in campaign.counts.items()}))


if __name__ == "__main__":
    main()

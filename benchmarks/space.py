"""What the reduced space is worth, every element integrated: python benchmarks/space.py runs/x runs/beam …

For each finished run: online error of the latent space and of linear ones on every motion, uninterrupted and restarted
from the full space every 0.25 s; how many linear dimensions one latent one is worth; and, at poses of every motion, how
far the forces of the decoded pose would move the solid. `--quick` takes 60 frames and three linear dimensions.
`--pca` measures the streamed PCA against one in memory as well (250,000 × 1,000 float32).
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import h5py
import numpy as np
from every_element import EveryElement, State, run
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.sparse import csr_array, eye_array

from ldsim.artefacts.records import StoredModel, read_basis, read_model, read_scene
from ldsim.artefacts.snapshots import Snapshots
from ldsim.evaluation.machine import describe_machine
from ldsim.mechanics.elastic import add_elastic_gradient
from ldsim.mechanics.scene import Scene
from ldsim.reduction.decoder import Decoder
from ldsim.reduction.encoder import Encoder, nearest_latent
from ldsim.reduction.pca import inner_product, leading_modes
from ldsim.reduction.reconstruction import all_coordinates
from ldsim.threads import one_thread

Array = NDArray[np.float64]
Row = dict[str, object]

RESULTS = Path(__file__).parent / "results" / "space.json"
DIMENSIONS = (10, 15, 20, 25, 30, 35, 40, 50, 60)
QUICK = (10, 25, 40)
WINDOW = 0.25
POSES = 20
# r of the paper's Table 1.
PAPER_R = {"x": 6, "beam": 10, "elephant": 7, "armadillo": 20}


@dataclass(frozen=True, eq=False)
class Space:
    """A reduced space: its stepper, and the way back from coordinates of the whole basis."""

    name: str
    stepper: EveryElement
    encoder: Encoder

    def state(self, q: Array, frame: int) -> State:
        """The state that continues after a frame of the full-space run with coordinates q, (N, K)."""
        k, decoder = self.stepper.decoder.k, self.stepper.decoder
        now, before = q[frame, :k], q[frame - 1, :k]
        codes = self.encoder(np.stack([now, before]))
        z = [nearest_latent(decoder, target, code) for target, code in zip((now, before), codes, strict=True)]
        return State(z[0], z[1], now, before)


def spaces(scene: Scene, U: Array, model: StoredModel, dimensions: tuple[int, ...]) -> list[Space]:
    found = [Space("latent", EveryElement(scene, U, model.decoder), model.encoder)]
    for k in (k for k in dimensions if k <= U.shape[1]):
        narrow = np.ascontiguousarray(U[:, :k])
        found.append(Space(f"linear {k}", EveryElement(scene, narrow, Decoder.identity(k)), Encoder((), ())))
    return found


def online_error(U: Array, q: Array, full: NDArray[np.float32]) -> float:
    """Mean vertex distance over mean displacement; infinite where the run was lost."""
    distance = moved = 0.0
    for start in range(0, len(q), 64):
        u = full[start : start + len(q[start : start + 64])].astype(np.float64)
        distance += float(np.linalg.norm((q[start : start + 64] @ U.T).reshape(u.shape) - u, axis=2).sum())
        moved += float(np.linalg.norm(u, axis=2).sum())
    return distance / moved if np.isfinite(distance) else np.inf


def worth(latent: float, linear: dict[int, float]) -> float | None:
    """The linear dimension with the same error, interpolated in its logarithm; None beyond what was swept."""
    if not linear or not np.isfinite(latent):
        return None
    k = np.array(sorted(linear))
    errors = np.log([linear[i] for i in k])
    if not errors.min() <= np.log(latent) <= errors.max():
        return None
    falling = np.minimum.accumulate(errors)[::-1]
    return float(np.interp(np.log(latent), falling, k[::-1]))


def forces_at_decoded_poses(space: Space, q: Array, full: NDArray[np.float32]) -> tuple[float, float, float]:
    """Medians over poses: relative shift of the equilibrium, mismatch of the projected forces, ratio of energies."""
    stepper, decoder = space.stepper, space.stepper.decoder
    k = decoder.k
    result = []
    for frame in np.linspace(5, len(q) - 1, min(POSES, len(q) - 5)).astype(int):
        u = full[frame].astype(np.float64)
        z = nearest_latent(decoder, q[frame, :k], space.encoder(q[frame : frame + 1, :k])[0])
        J = np.eye(k) if decoder.is_identity else decoder.jacobian(z)
        true = np.zeros_like(u)
        energy = add_elastic_gradient(stepper.scene.elements, u, true)
        decoded, force = stepper.force(decoder(z))
        there = J.T @ (stepper.U.T @ true.ravel())
        difference = J.T @ force - there
        shift = J @ np.linalg.solve(J.T @ stepper.stiffness(u) @ J, difference)
        result.append(
            (
                np.linalg.norm(shift) / np.linalg.norm(q[frame, :k]),
                np.linalg.norm(difference) / np.linalg.norm(there),
                decoded / energy,
            )
        )
    shift_share, mismatch, ratio = np.median(np.array(result), axis=0)
    return float(shift_share), float(mismatch), float(ratio)


def measure(folder: Path, quick: bool) -> list[Row]:
    """The rows of one finished run."""
    scene, _ = read_scene(folder / "scene.h5")
    U = read_basis(folder / "basis.h5")[0].basis.U
    model, header = read_model(folder / "model.h5")
    metric, name, r = inner_product(scene.mass, "mass"), folder.name, model.decoder.r
    rows = [row(name, "r", r, "", f"<= {PAPER_R[name]}" if name in PAPER_R else None)]
    rows.append(row(name, "k", model.decoder.k))
    rows.append(row(name, "train stage", float(header.notes["seconds"]), "s", "<= 60"))
    every = max(round(WINDOW / scene.time_step), 1)
    with Snapshots(folder / "snapshots.h5") as snapshots:
        for motion in snapshots.names:
            recorded, reader = snapshots.recorded(motion), snapshots.reader(motion)
            frames = min(60, recorded.motion.frames) if quick else recorded.motion.frames
            full = reader(0, frames)
            q = all_coordinates(lambda motion=motion: snapshots.chunks([motion]), metric, U)[:frames]  # type: ignore[misc]
            trained, linear, latent = recorded.role == "train", {}, np.inf
            for space in spaces(scene, U, model, QUICK if quick else DIMENSIONS):

                def restart(frame: int, space: Space = space, q: Array = q) -> State | None:
                    return space.state(q, frame - 1) if frame > 1 and frame % every == 0 else None

                stepper, held = space.stepper, dict(recorded.held)
                error = online_error(stepper.U, run(stepper, recorded.motion, held, frames), full)
                windowed = online_error(stepper.U, run(stepper, recorded.motion, held, frames, restart), full)
                label = f"{motion} ({recorded.role}), {space.name}"
                if stepper.decoder.is_identity:
                    linear[stepper.decoder.k] = error
                    goals: tuple[str | None, str | None] = (None, None)
                else:
                    latent = error
                    goals = ("<= 0.03", None) if trained else ("<= 0.1", "<= 0.05")
                rows.append(row(name, f"online error, {label}", error, "", goals[0]))
                rows.append(row(name, f"windowed error, {label}", windowed, "", goals[1]))
                shift, mismatch, ratio = forces_at_decoded_poses(space, q, full)
                rows.append(row(name, f"equilibrium shift, {label}", shift))
                rows.append(row(name, f"force mismatch, {label}", mismatch))
                rows.append(row(name, f"energy ratio, {label}", ratio))
            kp = worth(latent, linear)
            value = None if kp is None else kp / r
            rows.append(row(name, f"kp/r, {motion} ({recorded.role})", value, "", None if trained else ">= 2.5"))
    return rows


def measure_pca(quick: bool) -> list[Row]:
    """Seconds of the streamed basis of 29 and of a Gram decomposition in memory, Euclidean, on the same data."""
    size, frames = (25_000, 200) if quick else (250_000, 1000)
    rng = np.random.default_rng(0)
    modes = rng.normal(size=(60, size)).astype(np.float32) * 0.85 ** np.arange(60, dtype=np.float32)[:, None]
    size -= size % 3
    data = (rng.normal(size=(frames, 60)).astype(np.float32) @ modes)[:, :size]
    with tempfile.TemporaryDirectory() as folder, h5py.File(Path(folder) / "data.h5", "w") as file:
        stored = file.create_dataset("u", data=data, chunks=(1, size))
        started = time.perf_counter()
        _, vectors = eigh(data @ data.T)
        np.linalg.qr(data.T @ vectors[:, -29:])
        plain = time.perf_counter() - started
        del data
        rows = max((128 << 20) // (4 * size), 1)
        identity = csr_array(eye_array(size // 3))
        started = time.perf_counter()
        leading_modes(lambda: (stored[i : i + rows] for i in range(0, frames, rows)), identity, 29)
        streamed = time.perf_counter() - started
    return [
        row("synthetic", f"pca, {size:,} × {frames:,}, in memory", plain, "s"),
        row("synthetic", f"pca, {size:,} × {frames:,}, streamed", streamed, "s"),
        row("synthetic", "pca, streamed over in memory", streamed / plain, "", "<= 2"),
    ]


def row(model: str, quantity: str, value: float | None, unit: str = "", goal: str | None = None) -> Row:
    value = value if value is None or np.isfinite(value) else None
    shown = "–" if value is None else f"{value:.4g}"
    print(f"| {model} | {quantity} | {shown} | {unit} | {goal or ''} |", flush=True)
    return {"model": model, "quantity": quantity, "value": value, "unit": unit, "goal": goal}


def main(arguments: list[str]) -> None:
    folders, quick = [Path(argument) for argument in arguments if not argument.startswith("--")], "--quick" in arguments
    print("| model | quantity | value | unit | goal |\n|---|---|---|---|---|")
    with one_thread():
        rows = [found for folder in folders for found in measure(folder, quick)]
        rows += measure_pca(quick) if "--pca" in arguments else []
    described = describe_machine()
    content = {
        "machine": {key: value for key, value in described.items() if key != "versions"},
        "versions": described["versions"],
        "command": "python benchmarks/space.py " + " ".join(arguments),
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "rows": rows,
    }
    target = RESULTS.with_name("space_quick.json") if quick else RESULTS
    target.parent.mkdir(exist_ok=True)
    target.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit("usage: python benchmarks/space.py runs/EXPERIMENT … [--quick] [--pca] (finished runs)")
    main(sys.argv[1:])

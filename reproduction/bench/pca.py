"""The streamed PCA against one in memory, 250,000 × 1,000 float32; `--quick` takes a tenth of the rows."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import h5py
import numpy as np
from scipy.linalg import eigh
from scipy.sparse import csr_array, eye_array

from ldsim.jit import one_thread
from ldsim.space.pca import leading_modes
from reproduction.harness import Row, called, parser, row, show, write_results

NAME = "pca"


def measure(quick: bool) -> list[Row]:
    """Processor seconds, on one thread, of the streamed basis of 29 and of one from a Gram matrix in memory."""
    size, frames = (25_000, 200) if quick else (250_000, 1000)
    rng = np.random.default_rng(0)
    modes = rng.normal(size=(60, size)).astype(np.float32) * 0.85 ** np.arange(60, dtype=np.float32)[:, None]
    size -= size % 3
    data = (rng.normal(size=(frames, 60)).astype(np.float32) @ modes)[:, :size]
    with tempfile.TemporaryDirectory() as folder, h5py.File(Path(folder) / "data.h5", "w") as file:
        stored = file.create_dataset("u", data=data, chunks=(1, size))
        started = time.process_time()
        _, vectors = eigh(data @ data.T)
        np.linalg.qr(data.T @ vectors[:, -29:])
        plain = time.process_time() - started
        del data
        rows = max((128 << 20) // (4 * size), 1)
        identity = csr_array(eye_array(size // 3))
        started = time.process_time()
        leading_modes(lambda: (stored[i : i + rows] for i in range(0, frames, rows)), identity, 29)
        streamed = time.process_time() - started
    return [
        row("synthetic", f"pca, {size:,} × {frames:,}, in memory", plain, "CPU s"),
        row("synthetic", f"pca, {size:,} × {frames:,}, streamed", streamed, "CPU s"),
        row("synthetic", "pca, streamed over in memory", streamed / plain, "", "<= 2"),
    ]


def main() -> None:
    arguments = parser(NAME, __doc__)
    arguments.add_argument("--quick", action="store_true", help="25,000 × 200")
    quick = arguments.parse_args().quick
    with one_thread():
        rows = measure(quick)
    show(rows)
    if not quick:
        write_results(NAME, called(NAME), rows)


if __name__ == "__main__":
    main()

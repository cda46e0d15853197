"""The process in which fTetWild runs: `python -m ldsim.mesh.ftetwild IN.npz OUT.npz`; see `tetrahedralize`.

fTetWild is C++ that can neither be interrupted nor be trusted not to end the process on odd input. So it gets a process
of its own, which the system ends after the given seconds, even when nobody waits for it any more.
"""

from __future__ import annotations

import sys

import numpy as np
from pytetwild.pytetwild import tetrahedralize

STOP_ENERGY = 10.0
PASSES = 20  # of optimisation; with fTetWild's default of 80 a torus took eight times as long for no better tets


def main(source: str, target: str) -> None:
    """Read vertices, faces, edge_length and envelope (both metres); write vertices and cells."""
    with np.load(source) as given:
        diagonal = float(np.linalg.norm(np.ptp(given["vertices"], axis=0)))
        vertices, cells = tetrahedralize(
            given["vertices"],
            given["faces"].astype(np.int32),
            edge_length_abs=float(given["edge_length"]),
            epsilon=float(given["envelope"]) / diagonal,
            stop_energy=STOP_ENERGY,
            num_opt_iter=PASSES,
            vtk_ordering=True,
        )
    np.savez(target, vertices=vertices, cells=cells)


if __name__ == "__main__":
    main(*sys.argv[1:])

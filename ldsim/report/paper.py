"""The paper's Table 1 as data: what Fulton et al. (2019) measured, for orientation beside a run's own numbers."""

from __future__ import annotations

from typing import NamedTuple

PAPER_CITATION = (
    "Fulton, Modi, Duvenaud, Levin, Jacobson: Latent-space Dynamics for Reduced Deformable Simulation, "
    "Computer Graphics Forum 38(2), Eurographics 2019, Table 1"
)
PAPER_MACHINE = "2 × Xeon E5-2637 v3, 8 cores; training on a GTX 970"


class PaperRow(NamedTuple):
    """One row of Table 1: the experiment of ldsim for the same object, and what the paper has of it."""

    experiment: str
    tets: int
    autoencoder_s: float
    pca_s: float
    cubature_s: float
    points: int  # of cubature
    kp: int  # PCA dimension of the linear competitor
    r: int
    k: int
    linear_ms: float  # time of one step
    latent_ms: float
    note: str = ""  # what differs from the print, and why

    @property
    def speedup(self) -> float:
        """How many times faster a latent step is than a linear one."""
        return self.linear_ms / self.latent_ms


PAPER_TABLE_1 = (
    PaperRow("beam", 45151, 266, 10, 1493, 503, 23, 10, 27, 11.0, 8.6),
    PaperRow("x", 29686, 290, 34, 9083, 359, 13, 6, 19, 5.2, 4.6),
    PaperRow("armadillo", 164249, 192, 38, 3360, 401, 62, 20, 62, 10.5, 6.30),
    PaperRow("dragon", 429740, 60, 46, 40493, 197, 25, 11, 29, 7.2, 6.7),
    PaperRow(
        "elephant", 61699, 136, 5, 28, 54, 18, 7, 28, 4.2, 4.2,
        note="Cubature seconds and points are swapped in print; the authors' raw data says 54 points in 28.3 s.",
    ),
)  # fmt: skip


def paper_row(experiment: str) -> PaperRow | None:
    """The paper's row for the object that `experiment` simulates, x or paper-x; None where the paper has none."""
    name = experiment.removeprefix("paper-")
    return next((row for row in PAPER_TABLE_1 if row.experiment == name), None)

"""Whether a quadratic manifold would serve as a kind of latent space: beside a run's autoencoder and linear spaces.

Each finished run has an autoencoder. Every space learns from the same frames, those of synthetic motions included; the
ridge of the quadratic fit is chosen on the motions of role validation, as nothing of an autoencoder is. All are stepped
with every element integrated, so that no cubature rule plays a part. Results go to
reproduction/results/quadratic.json.
"""

from __future__ import annotations

import time
from typing import cast

import numpy as np

from ldsim.run import Run
from ldsim.space.decoder import Decoder
from ldsim.space.projection import all_coordinates
from ldsim.space.space import Space
from reproduction.harness import Row, over_runs, row
from reproduction.reduced_runs import latent, played, reference, training_coordinates
from reproduction.rivals.every_element import EveryElement
from reproduction.rivals.quadratic_manifold import chosen

NAME = "quadratic"
RIDGES = tuple(10.0**power for power in range(-9, 0))
LINEAR, LARGER = (20, 40, 60), 16


def spaces(run: Run) -> tuple[list[tuple[str, Space]], float]:
    """The spaces by what they are called, and the seconds that the quadratic fits took."""
    scene, basis, r = run.scene, run.basis, run.model.decoder.r
    q, synthetic = training_coordinates(run), run.pca.synthetic
    learned = q if synthetic is None else np.concatenate([q, synthetic])
    # a run that keeps back no motion is judged by its own frames
    back = run.chunks("validation") if run.snapshots.with_role("validation") else run.chunks("train")
    kept_back, begun = all_coordinates(back, basis), time.perf_counter()
    sizes = sorted({r, LARGER})
    decoders = {f"quadratic {size}": chosen(learned, kept_back, size, RIDGES) for size in sizes}
    seconds = time.perf_counter() - begun
    encoder = run.model.encoder  # played from rest, no pose is encoded
    found = [(name, Space.latent(scene, basis, (cast(Decoder, each), encoder))) for name, each in decoders.items()]
    found.append((f"autoencoder {r}", latent(run)))
    found += [(f"linear {k}", Space.linear(scene, basis, k)) for k in sorted({r, *LINEAR}) if k <= basis.k]
    return found, seconds


def measure(run: Run) -> list[Row]:
    """The rows of one run."""
    name, (found, seconds) = run.folder.name, spaces(run)
    rows = [row(name, "quadratic fits, all ridges", seconds, "s")]
    for label, space in found:
        for motion in run.played.names:
            error = played(EveryElement(space), reference(run, motion)).relative_error
            rows.append(row(name, f"online error, {motion} ({run.recorded(motion).role}), {label}", error))
    return rows


def main() -> None:
    over_runs(NAME, __doc__, measure, inputs=("reproduction/rivals",))


if __name__ == "__main__":
    main()

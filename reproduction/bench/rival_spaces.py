"""Spaces that ldsim does not offer, beside an autoencoder and linear ones: would they serve?

One is a quadratic manifold (reproduction/rivals/quadratic_manifold.py). The other is a linear space whose grabs act in
series with the residual compliance, as those of a condensed space do, so that linear spaces have had the same help.
Each finished run has an autoencoder and a validation motion. Every space learns from the same frames, those of
synthetic motions included; the ridge of the quadratic fit is chosen on the validation motions, as nothing of an
autoencoder is. All are stepped with every element integrated, so that no cubature rule plays a part. Results go to
reproduction/results/rival_spaces.json.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import cast

import numpy as np

from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.run import Run
from ldsim.space.compliance import Compliance
from ldsim.space.decoder import Decoder
from ldsim.space.projection import all_coordinates
from ldsim.space.space import Space
from reproduction.harness import Row, over_runs, row
from reproduction.reduced_runs import latent, played, reference, training_coordinates
from reproduction.rivals.every_element import EveryElement
from reproduction.rivals.quadratic_manifold import chosen

NAME = "rival_spaces"
RIDGES = tuple(10.0**power for power in range(-9, 0))
LINEAR, LARGER = (20, 40, 60), 16
# Of the steps of linear spaces with compliance, N; the others stop at 1e-6.
STOP = ReducedOptions(tolerance=4e-3)


def steppers(run: Run) -> tuple[dict[str, EveryElement | ReducedStepper], float]:
    """What steps each space, by what it is called, and the seconds that the quadratic fits took."""
    scene, basis, r = run.scene, run.basis, run.model.decoder.r
    q, synthetic = training_coordinates(run), run.pca.synthetic
    learned = q if synthetic is None else np.concatenate([q, synthetic])
    kept_back, begun = all_coordinates(run.chunks("validation"), basis), time.perf_counter()
    sizes = sorted({r, LARGER})
    decoders = {f"quadratic {size}": chosen(learned, kept_back, size, RIDGES) for size in sizes}
    seconds = time.perf_counter() - begun
    encoder = run.model.encoder  # played from rest, no pose is encoded
    found: dict[str, EveryElement | ReducedStepper] = {
        name: EveryElement(Space.latent(scene, basis, (cast(Decoder, each), encoder)))
        for name, each in decoders.items()
    }
    found[f"autoencoder {r}"] = EveryElement(latent(run))
    for k in (k for k in sorted({r, *LINEAR}) if k <= basis.k):
        space = Space.linear(scene, basis, k)
        found[f"linear {k}"] = EveryElement(space)
        yielding = replace(space, compliance=Compliance(scene, basis.columns(k)))
        found[f"linear {k} with compliance"] = ReducedStepper(yielding, STOP)
    return found, seconds


def measure(run: Run) -> list[Row]:
    """The rows of one run."""
    name, (found, seconds) = run.folder.name, steppers(run)
    rows = [row(name, "quadratic fits, all ridges", seconds, "s")]
    for label, stepper in found.items():
        for motion in run.played.names:
            error = played(stepper, reference(run, motion)).relative_error
            rows.append(row(name, f"online error, {motion} ({run.recorded(motion).role}), {label}", error))
    return rows


def main() -> None:
    over_runs(NAME, __doc__, measure, inputs=("reproduction/rivals",))


if __name__ == "__main__":
    main()

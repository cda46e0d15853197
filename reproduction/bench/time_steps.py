"""A condensed space at other time steps than its motions had, and two inertias of it.

The first pulls of role test run for the same seconds at 1, 2, 5 and 10 ms in the full space, and beside it in the
latent space of a finished run: with the inertia of the decoded pose, as `ldsim simulate` has it, and with that of the
coordinates alone, ‖z‖². Nothing is trained anew: V_eff and the decoder know no time step. Beside them the linear space
of all columns, every element integrated (to 10⁻⁶ N, which is enough), for at short steps implicit Euler damps less,
and every error lasts longer.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ldsim.arrays import Array, Indices
from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullStepper
from ldsim.dynamics.reduced.matrices import diagonal_or_whole
from ldsim.dynamics.reduced.options import ReducedOptions
from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.dynamics.simulate import simulate
from ldsim.errors import SettingsError
from ldsim.jit import one_thread
from ldsim.mechanics.options import PullOptions
from ldsim.mechanics.random_pulls import surface_pulls
from ldsim.mechanics.scene import Scene
from ldsim.pipeline.comparison import Reference
from ldsim.run import Run
from ldsim.settings import load_settings
from ldsim.space.space import Space
from reproduction.harness import COMPUTES, ROOT, Row, called, parser, row, show, write_results
from reproduction.reduced_runs import played
from reproduction.rivals.every_element import EveryElement

NAME = "time_steps"
MILLISECONDS = (1.0, 2.0, 5.0, 10.0)
STOP = ReducedOptions(tolerance=1e-8)


class CoordinatesAlone(ReducedStepper):
    """With the mass of what is slaved, and of what couples it to z, left out."""

    def __init__(self, space: Space, options: ReducedOptions) -> None:
        super().__init__(space, options)
        inertia = self.mass / self.scene.time_step**2
        inertia[space.r :], inertia[:, space.r :] = 0.0, 0.0
        self._model = self._model._replace(inertia=diagonal_or_whole(inertia), metric=inertia + self._stiffness)
        self._own_metric = self._model.metric


def as_long(pulls: PullOptions, share: float) -> PullOptions:
    """The same pulls in other frames: share of a frame's time."""
    return pulls.replace(frames=max(round(pulls.frames / share), 2), rest=round(pulls.rest / share))


def full_run(scene: Scene, pulls: PullOptions) -> Reference:
    """The pulls in the full space."""
    motion, stepper = surface_pulls("pulls", scene, pulls), FullStepper(scene, FullOptions())
    frames, held = list[Array](), dict[int, Indices]()
    for frame in simulate(stepper, motion):
        frames.append(stepper.displacement(frame.state))
        held.update(frame.held)
    u = np.array(frames)
    return Reference(motion, held, lambda start, stop: u[start:stop])


def measure(run: Run, pulls: PullOptions) -> list[Row]:
    """The errors at each time step."""
    rows, space = list[Row](), run.space("latent")
    for ms in MILLISECONDS:
        scene = replace(run.scene, time_step=1e-3 * ms)
        full = full_run(scene, as_long(pulls, scene.time_step / run.scene.time_step))
        for kind, stepper in {"decoded pose": ReducedStepper, "coordinates alone": CoordinatesAlone}.items():
            error = played(stepper(replace(space, scene=scene), STOP), full).relative_error
            rows.append(row(run.experiment, f"online error, {ms:g} ms, inertia of the {kind}", error))
        linear = EveryElement(Space.linear(scene, run.basis, run.basis.k))
        error = played(linear, full).relative_error
        rows.append(row(run.experiment, f"online error, {ms:g} ms, linear {run.basis.k}", error))
    return rows


def main() -> None:
    arguments = parser(NAME, __doc__)
    arguments.add_argument("configuration", type=Path)
    arguments.add_argument("run", type=Path, help="folder of its finished run")
    given = arguments.parse_args()
    settings = load_settings(given.configuration)
    pulls = [each.pulls for each in settings.snapshot.motions if each.role == "test" and each.pulls is not None]
    if not pulls or pulls[0] is None:
        raise SettingsError(f"{given.configuration} has no pulls of role test")
    with Run.open(given.run) as run, one_thread():
        if not run.space("latent").is_condensed:
            raise SettingsError(f"the latent space of {given.run} is not condensed")
        rows = measure(run, pulls[0])
    show(rows)
    own = str(given.configuration.resolve().relative_to(ROOT))
    write_results(f"{NAME}_{settings.experiment}", called(NAME), rows, inputs=[*COMPUTES, own])


if __name__ == "__main__":
    main()

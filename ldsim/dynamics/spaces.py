"""The spaces behind one face: what a simulation needs of the full, the linear or the latent space."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Generic, TypeVar, final

import numpy as np
from numpy.typing import NDArray

from ldsim.dynamics.full.options import FullOptions
from ldsim.dynamics.full.stepper import FullState, FullStepper
from ldsim.dynamics.reduced.stepper import ReducedState, ReducedStepper
from ldsim.mechanics.motion import Grab
from ldsim.mechanics.scene import Scene
from ldsim.optimise.solution import Solution

Array = NDArray[np.float64]
S = TypeVar("S", FullState, ReducedState)


class Dynamics(ABC, Generic[S]):
    """Steps states of one kind; states are never changed in place, so that any of them can be kept and gone back to."""

    @abstractmethod
    def at_rest(self) -> S:
        """The undeformed solid, without velocity."""

    @abstractmethod
    def step(self, state: S, grabs: Sequence[Grab]) -> tuple[S, Solution]:
        """Advance by one time step."""

    @abstractmethod
    def still(self, state: S) -> S:
        """The same shape without velocity and with nothing kept from earlier steps."""

    @abstractmethod
    def renewed(self, state: S) -> S:
        """The same shape and velocity with nothing else kept from earlier steps."""

    @abstractmethod
    def coordinates(self, state: S) -> Array:
        """What describes the shape: q (k,) in a reduced space, u (3n,) in the full one."""

    @abstractmethod
    def displacement(self, state: S) -> Array:
        """u, (n, 3) float64, metres."""

    @abstractmethod
    def extent(self, state: S) -> float:
        """The mass-weighted root mean square of the displacement, metres; NaN where the state is not finite."""

    @abstractmethod
    def change(self, gravity: Array, material_scale: float) -> None:
        """Go on under another gravity, (3,) m/s², and with the Lamé parameters of the scene times a number."""


@final
class FullDynamics(Dynamics[FullState]):
    """Every vertex free."""

    def __init__(self, scene: Scene, tolerance: float) -> None:
        self._scene = scene
        self._stepper = FullStepper(scene, FullOptions(tolerance=tolerance))
        self._total_mass = float(scene.mass.sum())

    def at_rest(self) -> FullState:
        return FullState.at_rest(self._scene.mesh.n_vertices)

    def step(self, state: FullState, grabs: Sequence[Grab]) -> tuple[FullState, Solution]:
        return self._stepper.step(state, grabs)

    def still(self, state: FullState) -> FullState:
        return FullState(state.u, state.u, state.u)

    def renewed(self, state: FullState) -> FullState:
        return FullState(state.u, state.u_previous, state.u)

    def coordinates(self, state: FullState) -> Array:
        return state.u.ravel()

    def displacement(self, state: FullState) -> Array:
        return state.u

    def extent(self, state: FullState) -> float:
        return float(np.sqrt(np.vdot(state.u, self._scene.mass @ state.u) / self._total_mass))

    def change(self, gravity: Array, material_scale: float) -> None:
        self._stepper.set_scene(self._scene.changed(gravity, material_scale))


@final
class ReducedDynamics(Dynamics[ReducedState]):
    """u = U φ(z): the linear space with the identity for φ, the latent one with a network."""

    def __init__(self, scene: Scene, stepper: ReducedStepper) -> None:
        self._stepper = stepper
        self._gravity: Array | None = None
        self._total_mass = float(scene.mass.sum())

    def at_rest(self) -> ReducedState:
        return ReducedState.at_rest(self._stepper.decoder)

    def step(self, state: ReducedState, grabs: Sequence[Grab]) -> tuple[ReducedState, Solution]:
        return self._stepper.step(state, grabs, self._gravity)

    def still(self, state: ReducedState) -> ReducedState:
        return ReducedState.moving(state.z, state.z, state.q, state.q)

    def renewed(self, state: ReducedState) -> ReducedState:
        return state.renewed()

    def coordinates(self, state: ReducedState) -> Array:
        return state.q

    def displacement(self, state: ReducedState) -> Array:
        return self._stepper.displacement(state)

    def extent(self, state: ReducedState) -> float:
        with np.errstate(over="ignore", invalid="ignore"):
            return float(np.sqrt(state.q @ self._stepper.mass @ state.q / self._total_mass))

    def change(self, gravity: Array, material_scale: float) -> None:
        self._gravity = gravity
        self._stepper.set_material_scale(material_scale)

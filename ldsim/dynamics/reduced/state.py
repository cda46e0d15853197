"""The state of a reduced run, and the one place that knows how it lies in memory."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ldsim.arrays import Array, Indices
from ldsim.jit import njit
from ldsim.mechanics.loads import Loads

AT_REST = Loads()
# Differences of z that a state keeps, of the second order and up.
DIFFERENCES = 6


@njit(cache=True, inline="always")
def fields(data: Array, r: int, k: int) -> tuple[Array, Array, Array, Array, Array, Array, Array, Array]:
    """z, z_previous, guess, (r,) each; q, q_previous, (k,) each; H, (r, r); differences, (DIFFERENCES, r); springs.

    The springs are those that H includes, B times the root of the stiffness, (3g, k).

    They are views of one array because each array that crosses into compiled code takes time.
    """
    q, H = 3 * r, 3 * r + 2 * k
    D = H + r * r
    B = D + DIFFERENCES * r
    return (
        data[:r],
        data[r : 2 * r],
        data[2 * r : q],
        data[q : q + k],
        data[q + k : H],
        data[H:D].reshape(r, r),
        data[D:B].reshape(DIFFERENCES, r),
        data[B:].reshape((len(data) - B) // k, k),
    )


def numbers_of_a_state(r: int, k: int, grabs: int = 0) -> int:
    """How many numbers there are of a state that holds so many grabs."""
    return (3 + DIFFERENCES + r) * r + (2 + 3 * grabs) * k


def state_rows(z: Array, z_previous: Array, predictor: Array, kept: Array) -> tuple[Array, NDArray[np.bool_]]:
    """The numbers of many states that hold nothing and whose 2qₙ − qₙ₋₁ is the predictor, one a row, and which lack H.

    Args:
        z, z_previous: (n, r). predictor: (n, k).
        kept: numbers of the states that the last steps led to, of which guess, H and differences are taken over; zeros
            where there was none.
    """
    r, k = z.shape[1], predictor.shape[1]
    q, H = 3 * r, 3 * r + 2 * k
    rows = kept[:, : numbers_of_a_state(r, k)].copy()
    rows[:, :r], rows[:, r : 2 * r] = z, z_previous
    rows[:, q : q + k] = rows[:, q + k : H] = predictor
    lacking = rows[:, H] == 0  # an inverse Hessian has a positive diagonal
    rows[lacking, 2 * r : q] = (2 * z - z_previous)[lacking]
    return rows, lacking


class ReducedState:
    """All that the next step depends on; a step makes a new one and leaves the old one as it is.

    Attributes:
        data: all numbers below, one after another (`fields`), float64.
        r, k: latent and outer dimension.
        usable: whether H was made; otherwise the next step makes it.
        held: the vertices of the grabs that H includes.
        fresh_iterations: iterations of the step that made H; excess: iterations beyond those since.
        loads: what acted in the step that led here.
        a, a_previous: where moved pins were in the last two frames, (l,) float64 (`space.lifting`); None at rest.
    """

    __slots__ = ("a", "a_previous", "data", "excess", "fresh_iterations", "held", "k", "loads", "r", "usable")

    def __init__(
        self,
        data: Array,
        dimensions: tuple[int, int],
        preconditioner: tuple[bool, tuple[Indices, ...], int, int] = (False, (), 0, 0),
        pins: tuple[Array | None, Array | None] = (None, None),
        loads: Loads = AT_REST,
    ) -> None:
        self.data, self.loads = data, loads
        self.r, self.k = dimensions
        self.usable, self.held, self.fresh_iterations, self.excess = preconditioner
        self.a, self.a_previous = pins

    @classmethod
    def moving(cls, z: Array, z_previous: Array, q: Array, q_previous: Array) -> ReducedState:
        """The state of two frames, with nothing known of what came before.

        Args:
            z, z_previous: latent coordinates of the last two frames, (r,).
            q, q_previous: outer coordinates, (k,). They need not be φ(z): a state taken from the full space keeps the
                projection of its displacement.
        """
        r = len(z)
        numbers = (z, z_previous, 2 * z - z_previous, q, q_previous, np.eye(r).ravel(), np.zeros(DIFFERENCES * r))
        return cls(np.concatenate(numbers), (r, len(q)))

    def renewed(self) -> ReducedState:
        """The same, but the next step makes its preconditioner anew."""
        state = ReducedState(self.data.copy(), (self.r, self.k), pins=(self.a, self.a_previous), loads=self.loads)
        state.H[:] = np.eye(self.r)
        return state

    def standing(self) -> ReducedState:
        """The same shape without velocity and with nothing kept from earlier steps."""
        state = ReducedState.moving(self.z, self.z, self.q, self.q)
        state.a = state.a_previous = self.a
        state.loads = self.loads
        return state

    def room(self, grabs: int) -> int:
        """Numbers of a state that holds so many grabs."""
        return numbers_of_a_state(self.r, self.k, grabs)

    @property
    def z(self) -> Array:
        """Latent coordinates, (r,) float64."""
        return self.data[: self.r]

    @property
    def z_previous(self) -> Array:
        return self._field(1)

    @property
    def guess(self) -> Array:
        """Where to start the next step, (r,) float64."""
        return self._field(2)

    @property
    def q(self) -> Array:
        """Outer coordinates, (k,) float64."""
        return self.data[3 * self.r : 3 * self.r + self.k]  # read in every step, as z is

    @property
    def q_previous(self) -> Array:
        return self._field(4)

    @property
    def H(self) -> Array:
        """The preconditioner, an estimate of the inverse Hessian, (r, r) float64."""
        return self._field(5)

    def _field(self, number: int) -> Array:
        found: Array = fields.py_func(self.data, self.r, self.k)[number]  # type: ignore[attr-defined]
        return found

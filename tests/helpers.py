"""The oracles that the tests share, and a small scene to try them on."""

from __future__ import annotations

import contextlib
import resource
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ldsim.arrays import Array
from ldsim.artefacts.sealed_file import seal
from ldsim.cubature.rule import CubatureRule
from ldsim.mechanics.properties import Properties
from ldsim.mechanics.scene import Scene, make_scene
from ldsim.mesh.mesh import Mesh
from ldsim.space.basis import Basis, inner_product
from ldsim.space.decoder import Decoder
from ldsim.space.encoder import IDENTITY
from ldsim.space.lifting import Lifting
from ldsim.space.pca import orthonormalised
from ldsim.space.space import Space

STEPS = 1e-2 / 2.0 ** np.arange(7)
WAIT = 60.0  # seconds, for what another process or thread does


def order(remainders: ArrayLike, steps: Array) -> float:
    """The slope of remainders against steps, both logarithmic."""
    return float(np.polyfit(np.log(steps), np.log(np.asarray(remainders)), 1)[0])


def derivative_order(
    f: Callable[[Array], ArrayLike], derivative: Callable[[Array], ArrayLike], x: Array, d: Array, size: float = 1.0
) -> float:
    """The order in h of ‖f(x + h d) − f(x) − h f'(x)·d‖: 2 if the derivative is right, 1 if not, ∞ if f is affine.

    Args:
        f: value, a number or an array.
        derivative: x → f'(x)·d, the directional derivative along d, of the shape of f.
        x, d: a state away from rest and a direction.
        size: scales the steps, 1e-2 … 1.6e-4, to the problem.
    """
    steps = np.asarray(size * STEPS, dtype=np.float64)
    start, slope = np.asarray(f(x)), np.asarray(derivative(x))
    remainders = np.array([np.linalg.norm(np.asarray(f(x + h * d)) - start - h * slope) for h in steps])
    if remainders.max() <= 1e-12 * (np.linalg.norm(start) + np.linalg.norm(slope) * steps[0]):
        return np.inf
    return order(remainders, steps)


def random_rotation(rng: np.random.Generator) -> Array:
    """A rotation, (3, 3), uniform on SO(3)."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def jittered(mesh: Mesh, amount: float, seed: int = 0) -> Mesh:
    """The mesh of a box with its inner vertices moved by up to `amount`, metres."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    inner = ((mesh.vertices > low + 1e-9) & (mesh.vertices < high - 1e-9)).all(axis=1)
    offset = np.random.default_rng(seed).uniform(-amount, amount, mesh.vertices.shape)
    return Mesh(mesh.vertices + offset * inner[:, None], mesh.cells, mesh.cell_type)


def bent(mesh: Mesh, seed: int = 0, noise: float = 0.02) -> Array:
    """A displacement far from rest that inverts nothing: the solid bent, stretched and stirred, (n, 3) metres."""
    x = mesh.vertices
    length = np.ptp(x[:, 0])
    angle = 0.8 * (x[:, 0] - x[:, 0].min()) / length
    curved = np.stack([1.1 * np.cos(angle) * x[:, 0], x[:, 1] + np.sin(angle) * x[:, 0], 0.95 * x[:, 2]], axis=1)
    return curved - x + noise * mesh.diagonal / 10 * np.random.default_rng(seed).normal(size=x.shape)


def uniform_scene(
    mesh: Mesh,
    pinned: NDArray[np.bool_],
    *,
    material: str = "neo_hookean",
    youngs_modulus: float = 1e5,
    poisson_ratio: float = 0.47,
    density: float = 1000.0,
    gravity: tuple[float, float, float] = (0.0, -9.8, 0.0),
    time_step: float = 0.005,
) -> Scene:
    """A scene of one material throughout; moduli in Pa, density in kg/m³, gravity in m/s², time step in s."""
    properties = Properties.uniform(mesh.n_cells, material, youngs_modulus, poisson_ratio, density)
    return make_scene(mesh, pinned, properties, gravity, time_step)


def scene(
    mesh: Mesh, material: str = "neo_hookean", youngs_modulus: float = 1e5, poisson_ratio: float = 0.4, **given: Any
) -> Scene:
    """A scene of one material, pinned where x is smallest; density, gravity and time step may be given by name."""
    x = mesh.vertices[:, 0]
    numbers: dict[str, Any] = {"gravity": (0.0, -9.81, 0.0), "time_step": 0.01} | given
    numbers |= {"youngs_modulus": youngs_modulus, "poisson_ratio": poisson_ratio}
    return uniform_scene(mesh, x < x.min() + 1e-9, material=material, **numbers)


def unit_basis(body: Scene) -> Array:
    """Every displacement of the free vertices, (3n, 3f)."""
    U = np.zeros((3 * body.mesh.n_vertices, 3 * len(body.free)))
    rows = (3 * body.free[:, None] + np.arange(3)).ravel()
    U[rows, np.arange(len(rows))] = 1
    return U


def smooth_basis(body: Scene, k: int) -> Array:
    """Smooth displacements that vanish where x is smallest, mass-orthonormal, (3n, k)."""
    x, rng = body.mesh.vertices, np.random.default_rng(0)
    s = (x[:, 0] - x[:, 0].min()) / np.ptp(x[:, 0])
    fields = [s[:, None] ** (1 + i % 3) * (rng.normal(size=3) + x @ rng.normal(size=(3, 3)) * 5) for i in range(k)]
    return orthonormalised(np.stack([f.ravel() for f in fields], axis=1), inner_product(body.mass, "mass")).matrix


def wait_until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + WAIT
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.002)


@contextlib.contextmanager
def little_memory(extra: int) -> Iterator[None]:
    """For the block, this process can take no more than `extra` bytes besides what it has."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + extra, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


@contextlib.contextmanager
def changed(path: Path) -> Iterator[h5py.File]:
    """A file of ours to be changed on purpose: its checksum fits afterwards."""
    with h5py.File(path, "r+") as file:
        yield file
    with path.open("r+b", buffering=0) as stream:
        seal(stream)


@contextlib.contextmanager
def full_disk(size: int) -> Iterator[None]:
    """For the block, every write beyond `size` bytes of a file fails, in this process and those that it starts.

    As near to a full disk as one comes without being root: for the writer, EFBIG differs from ENOSPC in its number.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def reduced_space(
    body: Scene,
    U: Array,
    decoder: Decoder | None = None,
    rule: CubatureRule | None = None,
    lifting: Lifting | None = None,
) -> Space:
    """The space u = U φ(z) of a basis (3n, k): linear without a decoder, with every point without a rule."""
    basis = Basis.of(U, body.mass)
    decoder = Decoder.identity(basis.k) if decoder is None else decoder
    rule = CubatureRule.every(body) if rule is None else rule
    return Space("reduced", body, basis, decoder, IDENTITY, rule, lifting)

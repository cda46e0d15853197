"""The C library called from Python: built by the machine's own compiler, its functions by `ctypes`."""

from __future__ import annotations

import ctypes
import hashlib
import platform
import shutil
import tempfile
from collections.abc import Sequence
from ctypes import POINTER, byref, c_char_p, c_double, c_int, c_size_t, c_uint32, c_void_p
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ldsim.arrays import Array
from ldsim.errors import SolverError
from ldsim.jit import kernel_cache
from ldsim.optimise.solution import Reason
from ldsim.runtime import source
from ldsim.runtime.compilers import compiler, shared_library

SOURCES = ("ldsim.c", "ldsim.h")


class _Info(ctypes.Structure):
    _fields_ = [(name, c_uint32) for name in ("vertices", "triangles", "r", "features", "points", "supports")]
    _fields_ += [("condensed", c_int), ("time_step", c_double), ("gravity", c_double * 3)]
    _fields_ += [(name, c_double) for name in ("diagonal", "stiffness", "radius")]


class Record(ctypes.Structure):
    _fields_ = [(name, c_int) for name in ("iterations", "evaluations", "reason", "outcome")]
    _fields_ += [("energy", c_double), ("gradient_norm", c_double)]


# Arrays are handed over as such, so that they live until the call returns.
NUMBERS = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")
VERTICES = np.ctypeslib.ndpointer(np.uint32, flags="C_CONTIGUOUS")
SIGNATURES: dict[str, tuple[Any, list[Any]]] = {
    "message": (c_char_p, [c_int]),
    "load": (c_int, [c_char_p, c_size_t, POINTER(c_void_p)]),
    "load_file": (c_int, [c_char_p, POINTER(c_void_p)]),
    "free": (None, [c_void_p]),
    "describe": (None, [c_void_p, POINTER(_Info)]),
    "create": (c_int, [c_void_p, c_int, POINTER(c_void_p)]),
    "destroy": (None, [c_void_p]),
    "reset": (None, [c_void_p]),
    "grab": (c_int, [c_void_p, NUMBERS, NUMBERS, c_double, c_double, POINTER(c_uint32)]),
    "grab_vertices": (c_int, [c_void_p, VERTICES, c_uint32, NUMBERS, c_double, POINTER(c_uint32)]),
    "move": (c_int, [c_void_p, c_uint32, POINTER(c_double * 3)]),
    "release": (c_int, [c_void_p, c_uint32]),
    "centroid": (c_int, [c_void_p, c_uint32, NUMBERS]),
    "force": (c_int, [c_void_p, c_uint32, NUMBERS]),
    "set_gravity": (c_int, [c_void_p, NUMBERS]),
    "set_stiffness": (c_int, [c_void_p, c_double]),
    "move_pins": (c_int, [c_void_p, c_uint32, NUMBERS]),
    "step": (c_int, [c_void_p, POINTER(Record)]),
    "step_many": (c_int, [c_void_p, c_uint32, c_uint32, c_void_p]),
    "displacements": (None, [c_void_p, NUMBERS]),
    "displacement": (c_int, [c_void_p, VERTICES, c_uint32, NUMBERS]),
    "coordinates": (POINTER(c_double), [c_void_p]),
    "novelty": (c_double, [c_void_p]),
    "state_size": (c_size_t, [c_void_p]),
    "save": (None, [c_void_p, c_void_p]),
    "restore": (c_int, [c_void_p, c_char_p, c_size_t]),
}

REASONS = tuple(sorted(Reason))
UNSIGNED = 2**32  # what the library counts in wraps there
# What these return is an outcome, and no code.
STEPS = ("step", "step_many")


def build(folder: Path, flags: Sequence[str] = ()) -> Path:
    """Compile the library into a folder, by this machine's compiler; returns the shared library.

    Raises:
        SolverError: there is no compiler, or it fails.
    """
    return shared_library(folder, SOURCES, "libldsim", flags=flags)


def local_library() -> Library:
    """The library for this very machine, compiled when it is first asked for and kept beside the compiled kernels.

    Raises:
        SolverError: there is no compiler, or it fails.
    """
    flags = () if compiler() is None else ("-march=native",)  # zig has its own words for that
    known = "".join([*map(source, SOURCES), str(compiler()), *flags, _processor()])
    folder = kernel_cache() / f"library-{hashlib.sha256(known.encode()).hexdigest()[:16]}"
    if not folder.is_dir():
        folder.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(dir=folder.parent))
        try:
            build(scratch, flags)
            scratch.rename(folder)
        except OSError:  # another process was faster
            if not folder.is_dir():
                raise
        finally:
            shutil.rmtree(scratch, ignore_errors=True)
    return Library(next(folder.glob("libldsim.*")))


def _processor() -> str:
    """What tells processors apart that do not run each other's code."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    return next((line for line in lines if line.startswith(("flags", "Features"))), "")


class Library:
    """The functions of a library that was built."""

    def __init__(self, path: Path) -> None:
        self.functions = ctypes.CDLL(str(path))
        for name, (result, arguments) in SIGNATURES.items():
            function = getattr(self.functions, f"ldsim_{name}")
            function.restype, function.argtypes = result, arguments

    def __call__(self, name: str, *arguments: Any) -> Any:
        """Call ldsim_name; a code that is not LDSIM_OK is raised in words, but a step's, which is its outcome."""
        found = getattr(self.functions, f"ldsim_{name}")(*arguments)
        if SIGNATURES[name][0] is c_int and name not in STEPS and found:
            raise SolverError(self.functions.ldsim_message(found).decode())
        return found


class NativeModel:
    """A model, loaded; any number of solids and threads may share it."""

    def __init__(self, library: Library, data: bytes) -> None:
        self.library, self.pointer = library, c_void_p()
        library("load", data, len(data), byref(self.pointer))
        self.info = _Info()
        library("describe", self.pointer, byref(self.info))

    def __del__(self) -> None:
        self.library("free", self.pointer)

    def step_many(self, first: Any, count: int, steps: int, records: Any = None) -> None:
        """So many steps of each of some of its solids, from a pointer to the first of their pointers.

        Raises:
            ValueError: the number of steps is not positive, or too large for the library.
        """
        if steps < 1:  # as an unsigned number, -1 would be four billion
            raise ValueError(f"step count is {steps}; it must be at least 1")
        if steps >= UNSIGNED:
            raise ValueError(f"step count is {steps}; it must be less than {UNSIGNED}")
        self.library("step_many", first, count, steps, records)


class NativeSolid:
    """One solid of a model, at rest at first; see ldsim.h for what its functions do.

    Raises:
        SolverError: what a function of the library refuses, in its words, or an array that is not what it reads.
    """

    def __init__(self, model: NativeModel, max_grabs: int = 8) -> None:
        self.model, self.pointer, self._record = model, c_void_p(), Record()
        if not 0 <= max_grabs < UNSIGNED // 2:  # as a C int, 2³² + 1 would be 1
            raise SolverError(f"at most {max_grabs} grabs at once; expected 0 or more, and less than {UNSIGNED // 2}")
        self._call("create", model.pointer, max_grabs, byref(self.pointer), solid=False)
        # of what is called in every step: looking it up, and checks of arguments by ctypes, take longer than the call
        functions, vector = model.library.functions, (c_double * 3)()
        self._step, self._record_at = functions["ldsim_step"], byref(self._record)
        self._move, self._target, self._target_at = (
            functions["ldsim_move"],
            np.ctypeslib.as_array(vector),
            byref(vector),
        )

    def __del__(self) -> None:
        self._call("destroy")

    def _call(self, name: str, *arguments: Any, solid: bool = True) -> Any:
        return self.model.library(name, *((self.pointer,) if solid else ()), *arguments)

    def grab(
        self, point: ArrayLike, target: ArrayLike, stiffness: float | None = None, radius: float | None = None
    ) -> int:
        """A number that names it from now on; the usual stiffness and radius where none are given, or a radius of 0."""
        found, places = c_uint32(), (_vector(point, "point", "m"), _vector(target, "target", "m"))
        self._call("grab", *places, _stiffness(stiffness), radius or 0.0, byref(found))
        return found.value

    def grab_vertices(self, vertices: NDArray[np.integer], target: ArrayLike, stiffness: float | None = None) -> int:
        held, found, place = self._vertices(vertices), c_uint32(), _vector(target, "target", "m")
        self._call("grab_vertices", held, len(held), place, _stiffness(stiffness), byref(found))
        return found.value

    def move(self, grab: int, target: ArrayLike) -> None:
        if np.shape(target) != (3,):
            _vector(target, "target", "m")
        self._target[:] = target
        if code := self._move(self.pointer, grab, self._target_at):
            raise SolverError(self.model.library("message", code).decode())

    def release(self, grab: int) -> None:
        self._call("release", grab)

    def centroid(self, grab: int) -> Array:
        return self._vector("centroid", grab)

    def force(self, grab: int) -> Array:
        return self._vector("force", grab)

    def set_gravity(self, gravity: ArrayLike) -> None:
        self._call("set_gravity", _vector(gravity, "gravity", "m/s²"))

    def set_stiffness(self, scale: float) -> None:
        self._call("set_stiffness", scale)

    def move_pins(self, support: int, map: ArrayLike) -> None:
        placed = np.ascontiguousarray(map, dtype=np.float64)
        if placed.shape != (3, 4):
            raise SolverError(f"the map of a support has the shape {placed.shape}; it must be (3, 4), (A | b)")
        self._call("move_pins", support, placed)

    def step(self) -> tuple[int, int, Reason, int]:
        """Iterations, evaluations, why the minimiser stopped, and the outcome, a number of ldsim_outcome."""
        outcome = self._step(self.pointer, self._record_at)
        record = self._record
        return record.iterations, record.evaluations, REASONS[record.reason], outcome

    def step_many(self, count: int) -> None:
        """So many steps by one call.

        Raises:
            ValueError: the count is not positive, or too large for the library.
        """
        self.model.step_many(byref(self.pointer), 1, count)

    def reset(self) -> None:
        self._call("reset")

    def displacements(self) -> Array:
        """u of all vertices, (n, 3) float64, metres."""
        u = np.empty((self.model.info.vertices, 3))
        self._call("displacements", u)
        return u

    def displacement(self, vertices: NDArray[np.integer]) -> Array:
        """u of some vertices, (v, 3) float64, metres."""
        some = self._vertices(vertices)
        u = np.empty((len(some), 3))
        self._call("displacement", some, len(some), u)
        return u

    @property
    def z(self) -> Array:
        """Coordinates, (r,) float64."""
        return np.array(self._call("coordinates")[: self.model.info.r])

    @property
    def novelty(self) -> float:
        return float(self._call("novelty"))

    def save(self) -> bytes:
        state = ctypes.create_string_buffer(self._call("state_size"))
        self._call("save", state)
        return state.raw

    def restore(self, state: bytes) -> None:
        self._call("restore", state, len(state))

    def _vector(self, name: str, grab: int) -> Array:
        out = np.empty(3)
        self._call(name, grab, out)
        return out

    def _vertices(self, vertices: NDArray[np.integer]) -> NDArray[np.uint32]:
        """As the library reads them, which would take a mask for the numbers 0 and 1, and 2³² for 0."""
        given, n = np.asarray(vertices), self.model.info.vertices
        if given.ndim != 1 or (given.size and given.dtype.kind not in "iu"):
            found = f"{given.dtype} of the shape {given.shape}"
            raise SolverError(f"vertices are {found}; they must be whole numbers one after another, (v,)")
        if given.size and not 0 <= given.min() <= given.max() < n:
            raise SolverError(f"vertices are from {given.min()} to {given.max()}; they must be from 0 to {n - 1}")
        return np.ascontiguousarray(given, dtype=np.uint32)


def _vector(value: ArrayLike, name: str, unit: str) -> Array:
    vector = np.ascontiguousarray(value, dtype=np.float64)
    if np.shape(value) != (3,):
        raise SolverError(f"{name} is {np.asarray(value).tolist()}; it must be three numbers in {unit}")
    return vector


def _stiffness(given: float | None) -> float:
    """As the library reads it, to which 0 means the usual one."""
    if given == 0:
        raise SolverError("stiffness is 0; it must be positive, or left out for the usual one")
    return 0.0 if given is None else given

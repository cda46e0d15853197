"""Functional mock-up units: FMPy finds nothing wrong with them, and steps them as the library steps."""

from __future__ import annotations

import ctypes
import importlib.util
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ldsim.arrays import Array
from ldsim.export import fmu
from ldsim.runtime.library import Library, NativeModel, NativeSolid, build
from ldsim.runtime.model_file import model_bytes
from ldsim.space.space import Space
from tests.runtime.conftest import cc as cc
from tests.runtime.conftest import library as library
from tests.runtime.problems import SPACES
from tests.runtime.test_steps import TIGHT

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("fmpy") is None, reason="fmpy is not installed: pip install 'ldsim[fmi]'"
)
GUIDE = Path(__file__).parents[2] / "docs" / "guide" / "runtime.md"
FRAMES, TAKEN, LEFT = 60, 10, 40


@pytest.fixture(scope="module", params=["latent neo_hookean", "condensed neo_hookean"])
def made(request: pytest.FixtureRequest, cc: str, tmp_path_factory: pytest.TempPathFactory) -> tuple[Space, Path]:
    space, folder = SPACES[request.param](), tmp_path_factory.mktemp("fmu")
    fmu.write_fmu(space, folder)
    return space, folder


def tip_and_target(space: Space) -> tuple[Array, Array]:
    x = space.scene.mesh.vertices
    tip = x[x[:, 0].argmax()]
    return tip, tip + 0.2 * space.scene.mesh.diagonal


def expected(space: Space, folder: Path) -> tuple[Array, Array]:
    """Positions of the vertex at the tip, and forces on the solid, after each frame, (N, 3) both."""
    solid = NativeSolid(NativeModel(Library(build(folder)), model_bytes(space)))
    x, (tip, target) = space.scene.mesh.vertices, tip_and_target(space)
    vertex = np.array([x[:, 0].argmax()])
    rows, forces, grab = [], [], None
    solid.set_gravity([0.0, -3.0, 0.0])
    for frame in range(FRAMES):
        if frame == TAKEN:
            grab = solid.grab(tip, target, 60.0)
        if frame == LEFT and grab is not None:
            solid.release(grab)
            grab = None
        solid.step()
        rows.append(x[vertex[0]] + solid.displacement(vertex)[0])
        forces.append(np.zeros(3) if grab is None else solid.force(grab))
    return np.array(rows), np.array(forces)


class Unit:
    """An FMU of either version, with its numbers by name."""

    def __init__(self, file: Path, folder: Path) -> None:
        import fmpy
        from fmpy.fmi2 import FMU2Slave
        from fmpy.fmi3 import FMU3Slave

        described = fmpy.read_model_description(str(file), validate=True)
        self.meaning = {variable.name: variable.description or "" for variable in described.modelVariables}
        self.names = {variable.name: variable.valueReference for variable in described.modelVariables}
        self.second = described.fmiVersion.startswith("2")
        kind = FMU2Slave if self.second else FMU3Slave
        self.unit: Any = kind(
            guid=described.guid,
            unzipDirectory=fmpy.extract(str(file), str(folder)),
            modelIdentifier=described.coSimulation.modelIdentifier,
            instanceName="solid",
        )
        self.unit.instantiate()

    def begin(self, **numbers: Any) -> None:
        if self.second:
            self.unit.setupExperiment(startTime=0.0)
        self.unit.enterInitializationMode()
        self.set(numbers)
        self.unit.exitInitializationMode()

    def set(self, numbers: dict[str, Any]) -> None:
        for name, value in numbers.items():
            if isinstance(value, bool):
                self.unit.setBoolean([self.names[name]], [value])
                continue
            references = [self.names[f"{name}[{i + 1}]"] for i in range(3)] if np.ndim(value) else [self.names[name]]
            write = self.unit.setReal if self.second else self.unit.setFloat64
            write(references, list(np.atleast_1d(value).astype(float)))

    def get(self, name: str) -> Array:
        read = self.unit.getReal if self.second else self.unit.getFloat64
        return np.array(read([self.names[f"{name}[{i + 1}]"] for i in range(3)]))

    def call(self, name: str, *given: Any) -> Any:
        """A function of states, which FMI 3 spells otherwise."""
        other = name if self.second else name.replace("FMUstate", "FMUState").replace("deS", "des")
        return getattr(self.unit, other)(*given)

    def step(self, time: float, size: float) -> None:
        self.unit.doStep(currentCommunicationPoint=time, communicationStepSize=size)

    def end(self) -> None:
        self.unit.terminate()
        self.unit.freeInstance()


@pytest.mark.parametrize("version", [2, 3])
def test_a_unit_is_valid_and_steps_as_the_library(made: tuple[Space, Path], tmp_path: Path, version: int) -> None:
    from fmpy.validation import validate_fmu

    space, folder = made
    file = folder / f"solid-fmi{version}.fmu"
    assert validate_fmu(str(file)) == []
    unit, h, (tip, target) = Unit(file, tmp_path / "unit"), space.scene.time_step, tip_and_target(space)
    unit.begin(**{"track[2].at": tip})
    unit.set({"gravity": [0.0, -3.0, 0.0]})
    positions, forces, kept, state = [], [], None, None
    for frame in range(FRAMES):
        if frame == TAKEN:
            unit.set({"grab[3].point": tip, "grab[3].target": target, "grab[3].stiffness": 60.0, "grab[3].held": True})
        if frame == LEFT:
            unit.set({"grab[3].held": False})
        if frame == TAKEN + 5:
            state = unit.call("getFMUstate")
            kept = unit.call("serializeFMUstate", state)
        unit.step(frame * h, h)
        positions.append(unit.get("track[2].position"))
        forces.append(unit.get("grab[3].force"))
    wanted = expected(space, tmp_path)
    size = np.abs(wanted[0] - tip).max()
    assert np.abs(positions - wanted[0]).max() <= 1e-6 * size and size > 1e-3 * space.scene.mesh.diagonal
    np.testing.assert_allclose(forces, wanted[1], atol=1e-6 * np.abs(wanted[1]).max())
    assert np.abs(wanted[1]).max() > 0.1
    # back to a state, by itself and by its bytes: the steps that follow are the same to the last bit
    for again in (state, unit.call("deSerializeFMUstate", kept)):
        unit.call("setFMUstate", again)
        unit.step((TAKEN + 5) * h, 3 * h)
        np.testing.assert_array_equal(unit.get("track[2].position"), positions[TAKEN + 7])
    unit.end()


@pytest.mark.parametrize("version", [2, 3])
def test_what_is_read_when_hold_is_taken_says_so_and_changes_nothing_while_it_is_held(
    made: tuple[Space, Path], tmp_path: Path, version: int
) -> None:
    space, folder = made
    unit, h = Unit(folder / f"solid-fmi{version}.fmu", tmp_path), space.scene.time_step
    tip, target = tip_and_target(space)
    taken = {"grab[1].point": tip, "grab[1].stiffness": 60.0, "grab[1].radius": 0.02}
    others = {"grab[1].point": tip - 0.02, "grab[1].stiffness": 20.0, "grab[1].radius": 0.05}
    said = {name.removesuffix("[1]") for name, meaning in unit.meaning.items() if "when held becomes true" in meaning}
    assert {f"grab[{g}].{name}" for g in range(1, 5) for name in ("point", "stiffness", "radius")} <= said
    unit.begin(**{"track[1].at": tip})
    unit.set({**taken, "grab[1].target": target, "grab[1].held": True})
    unit.step(0.0, 2 * h)
    state, found = unit.call("getFMUstate"), []
    for held in (True, False):
        for given in (taken, others):
            unit.call("setFMUstate", state)
            unit.set({**given, "grab[1].held": held})
            unit.step(2 * h, h)
            unit.set({"grab[1].held": True})
            unit.step(3 * h, h)
            found.append(unit.get("track[1].position"))
    np.testing.assert_array_equal(found[0], found[1])
    assert np.abs(found[2] - found[3]).max() > 1e-6 * space.scene.mesh.diagonal
    unit.call("freeFMUstate", state)
    unit.end()


@pytest.mark.parametrize("version", [2, 3])
def test_what_is_tracked_is_chosen_before_the_first_step_and_seen_at_once(
    made: tuple[Space, Path], tmp_path: Path, version: int
) -> None:
    from fmpy.fmi1 import FMICallException

    space, folder = made
    unit = Unit(folder / f"solid-fmi{version}.fmu", tmp_path)
    x, size = space.scene.mesh.vertices, space.scene.mesh.diagonal
    far = unit.get("track[1].at")
    np.testing.assert_allclose(unit.get("track[1].position"), far, atol=0.05 * size)  # it may sag
    if unit.second:
        unit.unit.setupExperiment(startTime=0.0)
    unit.unit.enterInitializationMode()
    before = unit.call("getFMUstate")
    chosen = x[np.linalg.norm(x - far, axis=1).argsort()[len(x) // 2]]
    unit.set({"track[1].at": chosen + 1e-3 * size})
    np.testing.assert_allclose(unit.get("track[1].position"), chosen, atol=0.05 * size)
    unit.unit.exitInitializationMode()
    with pytest.raises(FMICallException):
        unit.set({"track[1].at": far})
    np.testing.assert_array_equal(unit.get("track[1].at"), chosen + 1e-3 * size)
    unit.call("setFMUstate", before)  # which was not initialised
    unit.set({"track[1].at": far})
    unit.call("freeFMUstate", before)
    unit.end()


def test_a_unit_tells_the_time_that_it_reached_and_not_that_of_a_step_that_failed(
    made: tuple[Space, Path], tmp_path: Path
) -> None:
    space, folder = made
    unit, h = Unit(folder / "solid-fmi3.fmu", tmp_path), space.scene.time_step
    unit.unit.enterInitializationMode(startTime=2.0)
    unit.unit.exitInitializationMode()

    def step(time: float) -> tuple[int, float, float]:
        """The status, the time that was reached, and the independent variable."""
        flags, reached = [ctypes.c_bool() for _ in range(3)], ctypes.c_double()
        do = ctypes.CDLL(unit.unit.dll._name).fmi3DoStep
        do.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_bool, *[ctypes.c_void_p] * 4]
        status = do(unit.unit.component, time, 0.5 * h, False, *map(ctypes.byref, flags), ctypes.byref(reached))
        return status, reached.value, unit.unit.getFloat64([0])[0]

    assert unit.unit.getFloat64([0]) == [2.0]
    for halves in range(3):
        now = 2.0 + 0.5 * h * (halves + 1)
        assert step(2.0 + 0.5 * h * halves) == (0, pytest.approx(now), pytest.approx(now))
    unit.set({"grab[1].point": [99.0, 0.0, 0.0], "grab[1].held": True})
    assert step(2.0 + 1.5 * h) == (3, pytest.approx(2.0 + 1.5 * h), pytest.approx(2.0 + 1.5 * h))
    unit.end()


@pytest.mark.parametrize("name", [name for name in SPACES if "pins" not in name])
def test_a_thousand_frames_with_grabs_agree_with_the_library_in_every_space_and_material(
    name: str, library: Library, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fmu, "model_bytes", lambda space: model_bytes(space, TIGHT))
    space = SPACES[name]()
    fmu.write_fmu(space, tmp_path)
    solid = NativeSolid(NativeModel(library, model_bytes(space, TIGHT)))
    unit, h = Unit(tmp_path / "solid-fmi3.fmu", tmp_path / "unit"), space.scene.time_step
    tip, target = tip_and_target(space)
    unit.begin(**{"track[1].at": tip})
    vertex, found, wanted, grab = np.array([space.scene.mesh.vertices[:, 0].argmax()]), [], [], 0
    for frame in range(1000):
        if frame % 50 == 10:
            unit.set({"grab[1].point": tip, "grab[1].target": target, "grab[1].stiffness": 40.0, "grab[1].held": True})
            grab = solid.grab(tip, target, 40.0)
        if frame % 50 == 40:
            unit.set({"grab[1].held": False})
            solid.release(grab)
        gravity = 9.8 * np.array([np.sin(0.01 * frame), -np.cos(0.01 * frame), 0.0])
        unit.set({"gravity": gravity})
        solid.set_gravity(gravity)
        unit.step(frame * h, h)
        solid.step()
        found.append(unit.get("track[1].position") - tip)
        wanted.append(solid.displacement(vertex)[0])
    size = np.abs(wanted).max()
    assert np.abs(np.array(found) - wanted).max() <= 1e-9 * size and size > 1e-3 * space.scene.mesh.diagonal
    unit.end()


def test_the_controller_of_the_guide_brings_the_solid_to_where_it_wants_it(
    made: tuple[Space, Path], tmp_path: Path
) -> None:
    program = re.findall(r"```python\n(.*?)```", GUIDE.read_text(encoding="utf-8"), flags=re.DOTALL)[-1]
    assert "fmpy" in program
    (tmp_path / "controller.py").write_text(program, encoding="utf-8")
    command = [sys.executable, "controller.py", str(made[1] / "solid-fmi3.fmu")]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stderr
    away = [float(line.split()[2]) for line in done.stdout.splitlines()]
    assert away[-1] < 0.2 * away[0]

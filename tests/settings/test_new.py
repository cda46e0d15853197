"""`ldsim new`: settings that follow from a solid, and that can be said."""

from __future__ import annotations

import shutil
from pathlib import Path

import meshio
import numpy as np
import pytest
import yaml

from ldsim.arrays import Array, Indices
from ldsim.errors import SettingsError
from ldsim.mesh.shapes import beam, voxel_mesh
from ldsim.mesh.surface import surface_triangles
from ldsim.pipeline.solid import Solid
from ldsim.run import Run
from ldsim.settings import load_settings
from ldsim.settings.derived import (
    pins_of,
    reach_of_pulls,
    stiffening,
    stiffness_of_pulls,
    time_step,
    unit_of,
)
from ldsim.settings.new import NewOptions, seen
from tests.cli.experiments import invoked, refused
from tests.mesh.painted import WRITERS


@pytest.mark.parametrize(
    ("diagonal", "surface", "unit"),
    [(0.12, True, "m"), (0.12, False, "m"), (2.0, True, "m"), (120.0, True, "mm"), (1500.0, True, "mm")],
)
def test_the_unit_of_a_file_is_guessed_where_only_one_makes_sense(diagonal: float, surface: bool, unit: str) -> None:
    assert unit_of(diagonal, surface) == unit


@pytest.mark.parametrize(("diagonal", "surface"), [(82.0, False), (8.0, True), (8.0, False), (1e5, True), (1e-3, True)])
def test_a_unit_that_is_not_clear_is_asked_for(diagonal: float, surface: bool) -> None:
    with pytest.raises(SettingsError, match=r"in what unit\? say so with --unit mm \(.*cm \(.*m \(.*in \("):
        unit_of(diagonal, surface)


def of_voxels(occupied: Array, edges: object = 0.01) -> tuple[Array, Indices]:
    mesh = voxel_mesh(occupied.astype(bool), edges)  # type: ignore[arg-type]
    return mesh.vertices, surface_triangles(mesh).astype(np.int64)


def ball() -> Array:
    x = np.indices((9, 9, 9)) - 4
    return np.linalg.norm(x, axis=0) < 4.2


@pytest.mark.parametrize(
    ("occupied", "axis", "at", "gravity"),
    [
        (np.ones((12, 2, 2)), 0, "min", (0.0, -9.8, 0.0)),  # a rod lies: held at its end
        (np.ones((2, 12, 2)), 1, "min", (0.0, -9.8, 0.0)),  # it stands
        (np.ones((2, 2, 12)), 2, "min", (0.0, 0.0, -9.8)),  # so it does, with z up
        (np.ones((4, 4, 4)), 1, "min", (0.0, -9.8, 0.0)),  # a cube stands on its low side
        (ball(), 1, "min", (0.0, -9.8, 0.0)),
    ],
    ids=["rod on x", "rod on y", "rod on z", "cube", "ball"],
)
def test_pins_are_proposed(occupied: Array, axis: int, at: str, gravity: tuple[float, ...]) -> None:
    pins = pins_of(*of_voxels(occupied))
    assert (pins.axis, pins.at, pins.gravity) == (axis, at, gravity)
    assert ("flat end" in pins.why) == (occupied.shape != (9, 9, 9))


def test_a_cone_is_held_at_its_base_wherever_that_is() -> None:
    heights = np.arange(12)
    x, y, z = np.indices((9, 9, 12))
    cone = np.hypot(x - 4, y - 4) <= 4.3 - 0.4 * heights[z]
    assert (pins_of(*of_voxels(cone)).axis, pins_of(*of_voxels(cone)).at) == (2, "min")
    assert pins_of(*of_voxels(cone[:, :, ::-1])).at == "max"
    assert pins_of(*of_voxels(cone), "x-max").at == "max"


def a_solid(**changes: object) -> Solid:
    given = {
        "size": 0.2,
        "weight": 2.0,
        "radius": 0.01,
        "sag": 0.004,
        "load_factor": 8.0,
        "frequencies": np.array([5.0, 6.0, 20.0, 31.0, 33.0, 90.0]),
        "softness": np.array([0.001, 0.01, 0.02]),
        "strain": np.array([4.0, 5.0, 50.0]),
        "held": np.full(3, 0.1),
    }
    return Solid(**given | changes)  # type: ignore[arg-type]


def test_a_solid_that_stands_its_weight_stays_as_soft_as_it_is() -> None:
    assert stiffening(a_solid()) == 1
    assert stiffening(a_solid(sag=0.021, load_factor=1.1)) == pytest.approx(2.1)
    assert stiffening(a_solid(load_factor=0.1)) == 20


@pytest.mark.parametrize("change", [{"sag": 0.37}, {"load_factor": 0.013}, {"sag": 3.3, "load_factor": 0.9}])
def test_a_solid_that_does_not_is_made_so_stiff_that_it_does(change: dict[str, object]) -> None:
    solid = a_solid(**change)
    stiff = solid.stiffened(stiffening(solid))
    assert stiff.sag <= 0.05 * stiff.size * 1.01 and stiff.load_factor >= 2 * 0.99
    assert stiffening(stiff) == 1


def test_pulls_and_steps_follow_the_solid() -> None:
    solid = a_solid()
    assert stiffness_of_pulls(solid) == 100
    assert reach_of_pulls(solid) == 0.05
    assert reach_of_pulls(a_solid(strain=np.array([40.0, 50.0, 60.0]))) == 0.02
    assert time_step(solid) == 0.005
    stiff = solid.stiffened(100)
    assert stiffness_of_pulls(stiff) == 100 * stiffness_of_pulls(solid)
    assert reach_of_pulls(stiff) == reach_of_pulls(solid)
    assert time_step(stiff) == pytest.approx(time_step(solid) / 10)


@pytest.fixture
def rod(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A rod of 160 mm as a mesh in metres; the folder is where one is."""
    monkeypatch.chdir(tmp_path)
    mesh = beam(0.16, 0.02, 0.02, 1)
    (tmp_path / "parts").mkdir()
    path = tmp_path / "parts" / "my rod.vtk"
    meshio.Mesh(mesh.vertices, [("tetra", mesh.cells)]).write(path)
    return path


def test_new_writes_a_configuration_that_loads_and_says_what_it_assumed(rod: Path) -> None:
    result = invoked("new", str(rod))
    assert result.exit_code == 0, result.output
    assert "unit: metres, so that it is 162 mm across (--unit)" in result.stdout
    assert "held at x-min" in result.stdout and "(--pin)" in result.stdout
    assert "soft rubber" in result.stdout and "its slowest frequencies" in result.stdout
    assert result.stdout.splitlines()[-1] == (
        "my-rod.yaml is written, change in it what you like; then `ldsim make my-rod.yaml --error 5% --play`"
    )
    settings = load_settings(Path("my-rod.yaml"))
    assert settings.experiment == "my-rod" and settings.train.kind == "condensed"
    assert not settings.model_fields_set & {"pca", "train", "cubature"}  # what is left out follows from the solid
    assert set(settings.snapshot.roles) == {"train", "validation", "test"}
    with Run(Path("runs/my-rod")) as run:
        assert run.scene.time_step == settings.mesh.time_step
        assert run.header("scene").settings == settings.mesh.dump()


def test_what_is_said_is_taken(rod: Path) -> None:
    flags = ["--unit", "cm", "--pin", "y-max", "--youngs-modulus", "2e6", "--output", "cfg/an other.yaml"]
    result = invoked("new", str(rod), *flags, "--runs", "elsewhere")
    assert result.exit_code == 0, result.output
    assert "`ldsim make 'cfg/an other.yaml' --error 5% --play --runs elsewhere`" in result.stdout.splitlines()[-1]
    section = load_settings(Path("cfg/an other.yaml")).mesh
    assert section.scale == 0.01 and section.material.youngs_modulus == 2e6
    assert section.file == "../parts/my rod.vtk"
    slab = section.pins[0].slab
    assert slab is not None and (slab.axis, slab.at) == ("y", "max")


def test_a_shape_needs_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = invoked("new", "--shape", "beam", "--resolution", "1")
    assert result.exit_code == 0, result.output
    shape = load_settings(Path("beam.yaml")).mesh.shape
    assert shape is not None and (shape.name, shape.resolution) == ("beam", 1)


def test_new_overwrites_neither_a_configuration_nor_a_run(rod: Path) -> None:
    Path("my-rod.yaml").write_text("mine", encoding="utf-8")
    assert "my-rod.yaml exists already" in refused(invoked("new", str(rod)))
    assert Path("my-rod.yaml").read_text(encoding="utf-8") == "mine"
    Path("my-rod.yaml").unlink()
    for begun in ("snapshots.h5", "snapshots.partial/pulls_1.frames"):
        Path(f"runs/my-rod/{begun}").parent.mkdir(parents=True)
        Path(f"runs/my-rod/{begun}").touch()
        assert "holds motions of a run already" in refused(invoked("new", str(rod)))
        assert not Path("my-rod.yaml").exists()
        shutil.rmtree("runs")


@pytest.mark.parametrize("kind", ["glb", "gltf"])
def test_a_painted_surface_is_looked_at_as_a_surface(kind: str, tmp_path: Path) -> None:
    file = WRITERS[kind](tmp_path, np.zeros(3), np.array([0.1, 0.2, 0.3]))
    assert any(line.startswith("surface: {file") for line in seen(file, tmp_path / "box.yaml", NewOptions()).lines)
    assert f"`ldsim new {file}`" in refused(invoked("make", str(file)))


@pytest.mark.parametrize(("stem", "name"), [("Ärmel 2", "rmel-2"), ("-a", "a"), (".é.b", "b"), ("球", "solid")])
def test_a_name_begins_with_what_is_no_option_of_a_command(stem: str, name: str) -> None:
    assert seen(None, Path(f"{stem}.yaml"), NewOptions(shape="beam")).name == name


def test_a_surface_is_found_from_a_configuration_in_a_folder_that_is_a_link(tmp_path: Path) -> None:
    file, link = WRITERS["glb"](tmp_path, np.zeros(3), np.array([0.1, 0.2, 0.3])), tmp_path / "link"
    (tmp_path / "far" / "away").mkdir(parents=True)
    link.symlink_to(tmp_path / "far" / "away")
    surface = seen(file, link / "box.yaml", NewOptions()).options.surface
    assert surface is not None and (link / surface.file).samefile(file)


@pytest.mark.parametrize("axis", "xyz")
def test_a_flat_surface_is_refused_in_one_line(axis: str, tmp_path: Path) -> None:
    corners = np.insert([[0, 0], [100, 0], [100, 50], [0, 50]], "xyz".index(axis), 7, axis=1)
    file = tmp_path / "flat.obj"
    file.write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners.tolist()) + "f 1 2 3 4\n", encoding="utf-8")
    with pytest.raises(SettingsError, match=f"flat.obj is flat along {axis}; a solid is needed") as error:
        seen(file, tmp_path / "flat.yaml", NewOptions())
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "or --shape NAME"),
        (["parts/my rod.vtk", "--shape", "beam"], "not both"),
        (["nothing.vtk"], "does not exist"),
        (["--shape", "sphere"], "sphere"),
        (["parts/my rod.vtk", "--youngs-modulus", "-1"], "youngs_modulus"),
        (["large.vtk"], r"--unit mm (82"),
        (["--shape", "beam", "--unit", "mm"], "--unit is for a file; a shape is in metres"),
        (["--shape", "beam", "--cells", "50"], "--cells is for a surface, which is filled with tets"),
        (["parts/my rod.vtk", "--cells", "50"], "--cells is for a surface, which is filled with tets"),
        (["parts/my rod.vtk", "--resolution", "2"], "--resolution is for a --shape"),
    ],
)
def test_bad_input_is_refused_in_one_line(rod: Path, arguments: list[str], words: str) -> None:
    mesh = meshio.read(rod)
    meshio.Mesh(mesh.points * 506.0, mesh.cells).write("large.vtk")
    assert words in refused(invoked("new", *arguments))
    assert not list(Path().glob("*.yaml"))


def test_every_value_of_a_new_configuration_says_where_it_comes_from(rod: Path) -> None:
    assert invoked("new", str(rod)).exit_code == 0
    lines = Path("my-rod.yaml").read_text(encoding="utf-8").splitlines()
    for key in ("scale:", "pins:", "time_step:"):
        assert "#" in next(line for line in lines if line.strip().startswith(key)), key
    assert yaml.safe_load("\n".join(lines))["mesh"]["density"] == 1000

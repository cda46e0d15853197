"""Bad input costs every command one line and exit status 1, and never a finished artefact."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from click.testing import CliRunner

from ldsim.artefacts.store import file_hash
from ldsim.cli.main import main
from tests.cli.experiments import COMMANDS, READS, TINY, WRITES, Experiment, refused
from tests.helpers import full_disk

every_command = pytest.mark.parametrize("command", COMMANDS)

TETS = """MeshVersionFormatted 1
Dimension 3
Vertices
5
0 0 0 0
1 0 0 0
0 1 0 0
0 0 1 0
{apex} 0
Tetrahedra
2
1 2 3 4 0
{cell} 0
End
"""
RECORDING = """# spring_stiffness_n_per_m: 30
# grab_radius_m: 0.03
is_dragging,target_x,target_y,target_z,grabbed_x,grabbed_y,grabbed_z
{rows}
"""
MISS = "\n".join(["0,0,0,0,0,0,0", "1,9,0,0,9,0,0", "1,9,0,0,9,0,0"])


def refusal(experiment: Experiment, command: str) -> str:
    """The refusal of a command, after which all finished files are what they were."""
    before = experiment.finished()
    message = refused(experiment.invoke(command))
    assert experiment.finished() == before
    return message


# The configuration, for every command


def write(content: bytes) -> Callable[[Experiment], None]:
    return lambda experiment: experiment.config.write_bytes(content) and None


def change(path: str, value: object) -> Callable[[Experiment], None]:
    return lambda experiment: experiment.change(path, value)


CONFIGURATIONS: dict[str, tuple[Callable[[Experiment], object], str]] = {
    "missing": (lambda experiment: experiment.config.unlink(), "does not exist"),
    "empty": (write(b""), "is empty"),
    "not YAML": (write(b"mesh: [1,\n  2\n"), "is not valid YAML"),
    "binary": (write(b"\x00\xff\xfe"), "is not valid YAML"),
    "a list": (write(b"- mesh\n"), "expected a mapping"),
    "an unknown section": (lambda experiment: experiment.configure(TINY | {"meshh": {}}), "did you mean 'mesh'?"),
    "an unknown key": (change("train.epoch", 1), "unknown key 'train.epoch'; did you mean 'epochs'?"),
    "a wrong type": (change("train.epochs", "many"), "train.epochs: input should be a valid integer"),
    "out of range": (change("train.learning_rate", 2.0), "train.learning_rate: input should be less than 1, got 2"),
    "a key missing": (change("mesh.material.youngs_modulus", ...), "mesh.material.youngs_modulus is missing"),
    "two sources": (change("mesh.file", "x.mesh"), "mesh: give exactly one of file, shape, surface"),
}


@every_command
@pytest.mark.parametrize("case", CONFIGURATIONS)
def test_a_bad_configuration(experiment: Experiment, command: str, case: str) -> None:
    spoil, words = CONFIGURATIONS[case]
    spoil(experiment)
    message = refusal(experiment, command)
    assert words in message
    assert "tiny.yaml" in message


@pytest.mark.parametrize("case", CONFIGURATIONS)
def test_a_bad_configuration_is_told_by_settings_too(experiment: Experiment, case: str) -> None:
    spoil, words = CONFIGURATIONS[case]
    spoil(experiment)
    for options in ([], ["--stamps", str(experiment.folder / "stamps")]):
        assert words in refused(CliRunner().invoke(main, ["settings", str(experiment.config), *options]))
    assert not (experiment.folder / "stamps").exists()


# The artefacts that a command reads


def replace_kind(path: Path) -> None:
    with h5py.File(path, "r+") as file:
        file.attrs["kind"] = "basis" if file.attrs["kind"] == "scene" else "scene"


def replace_experiment(path: Path) -> None:
    with h5py.File(path, "r+") as file:
        file.attrs["experiment"] = "other"


def drop_dataset(path: Path) -> None:
    with h5py.File(path, "r+") as file:
        names: list[str] = []
        file.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
        del file[sorted(names)[0].split("/")[0]]


ARTEFACTS: dict[str, tuple[Callable[[Path], object], tuple[str, ...]]] = {
    "missing": (lambda path: path.unlink(), ("does not exist; run `ldsim ",)),
    "empty": (lambda path: path.write_bytes(b""), ("is not a readable HDF5 file",)),
    "truncated": (lambda path: os.truncate(path, path.stat().st_size // 2), ("is not a readable HDF5 file",)),
    "foreign": (lambda path: path.write_text("Vertices\n5\n"), ("is not a readable HDF5 file",)),
    "of another kind": (replace_kind, ("; expected '",)),
    "of another experiment": (replace_experiment, ("the experiment 'other'", "belongs to another experiment")),
    "without a group": (drop_dataset, ("lacks the dataset",)),
}


@pytest.mark.parametrize(("command", "file"), [(command, file) for command in COMMANDS for file in READS[command]])
@pytest.mark.parametrize("case", ARTEFACTS)
def test_a_bad_artefact(experiment: Experiment, command: str, file: str, case: str) -> None:
    spoil, words = ARTEFACTS[case]
    spoil(experiment.run / file)
    message = refusal(experiment, command)
    assert file in message
    assert any(word in message for word in words), message


@every_command
def test_a_configuration_under_another_name_does_not_take_the_artefacts_of_the_first(
    experiment: Experiment, command: str
) -> None:
    if READS[command]:
        experiment.change("experiment", "other")
        experiment.run.rename(experiment.run.with_name("other"))
        message = refused(experiment.invoke(command))
        assert "belongs to the experiment 'tiny', expected 'other'" in message


# What a run is exported to


EXPORTS: dict[str, tuple[list[str], str]] = {
    "an unknown format": (["--format", "vrml"], "unknown format 'vrml'; known are vtk, xdmf, gltf"),
    "an unknown motion": (["--format", "gltf", "--motion", "c"], "unknown motion 'c'; known are a, b"),
    "an unknown space": (["--format", "gltf", "--space", "outer"], "unknown space 'outer'; known are full, linear"),
    "a basis of the full space": (["--format", "usd", "--space", "full"], "use --space linear or latent"),
    "too few frames": (["--format", "ply", "--every", "99"], "leaves none of the 40 frames"),
    "another suffix": (["--format", "gltf", "--output", "a.mp4"], "expected '.glb'"),
    "a folder that exists": (["--format", "ply", "--output", "."], "exists already"),
}


@pytest.mark.parametrize("case", EXPORTS)
def test_an_export_that_does_not_suit(experiment: Experiment, case: str) -> None:
    options, words = EXPORTS[case]
    if "usd" in options:
        pytest.importorskip("pxr", reason="usd-core is not installed: pip install 'ldsim[usd]'")
    before = experiment.finished()
    message = refused(CliRunner().invoke(main, ["export", str(experiment.run), *options]))
    assert words in message
    assert experiment.finished() == before


@pytest.mark.parametrize("file", ["scene.h5", "basis.h5", "model.h5", "cubature.h5", "snapshots.h5"])
@pytest.mark.parametrize("case", ARTEFACTS)
def test_a_bad_artefact_of_a_run_to_export(experiment: Experiment, file: str, case: str) -> None:
    spoil, words = ARTEFACTS[case]
    spoil(experiment.run / file)
    before = experiment.finished()
    message = refused(CliRunner().invoke(main, ["export", str(experiment.run), "--playground"]))
    assert file in message
    assert any(word in message for word in words), message
    assert experiment.finished() == before


def test_an_export_of_no_run(tmp_path: Path) -> None:
    message = refused(CliRunner().invoke(main, ["export", str(tmp_path / "nothing"), "--format", "gltf"]))
    assert "does not exist; expected a folder with scene.h5" in message


# The mesh file


def mesh_file(name: str, content: str | None) -> Callable[[Experiment], None]:
    def spoil(experiment: Experiment) -> None:
        if content is not None:
            (experiment.folder / name).write_text(content, encoding="utf-8")
        experiment.change("mesh.shape", ...)
        text = experiment.config.read_text(encoding="utf-8")
        experiment.config.write_text(text.replace("mesh:\n", f"mesh:\n  file: {name}\n", 1), encoding="utf-8")

    return spoil


def add(experiment: Experiment, section: str, line: str) -> None:
    """Add a line to a section of the configuration as it is."""
    text = experiment.config.read_text(encoding="utf-8")
    experiment.config.write_text(text.replace(f"{section}:\n", f"{section}:\n  {line}\n", 1), encoding="utf-8")


def surface_file(content: str, **settings: object) -> Callable[[Experiment], None]:
    def spoil(experiment: Experiment) -> None:
        (experiment.folder / "a.off").write_text(content, encoding="utf-8")
        mesh = {key: value for key, value in TINY["mesh"].items() if key != "shape"}
        surface = {"file": "a.off", "edge_length": 0.1} | settings
        experiment.configure(TINY | {"mesh": mesh | {"surface": surface}})

    return spoil


CORNERS = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
TETRAHEDRON = f"OFF\n4 4 0\n{CORNERS}3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"
FIN = f"OFF\n5 5 0\n{CORNERS}1 1 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n3 0 1 4\n"
HEXES = {"refine": 1, "shape": {"name": "beam", "cell_type": "hex8"}}
GOOD = TETS.format(apex="0 0 -1", cell="1 3 2 5")
MESHES: dict[str, tuple[Callable[[Experiment], object], str]] = {
    "missing": (mesh_file("no.mesh", None), "no.mesh does not exist"),
    "missing from the data": (mesh_file("$LDSIM_DATA/no.mesh", None), "lawsonfulton/AutoDef"),
    "empty": (mesh_file("a.mesh", ""), "a.mesh is empty"),
    "truncated": (mesh_file("a.mesh", GOOD[: GOOD.index("0 0 1 0")]), "a.mesh is not a readable .mesh file"),
    "foreign": (mesh_file("a.vtk", "%PDF-1.4\n"), "a.vtk is not a readable .vtk file"),
    "of an unknown format": (mesh_file("a.doc", GOOD), "unknown extension '.doc'"),
    "a surface": (mesh_file("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"), "holds no tetrahedra"),
    "a surface that is not manifold": (surface_file(FIN), "a.off: the surface is not manifold: 1 of its edges"),
    "an open surface": (surface_file(TETRAHEDRON.replace("4 4 0", "4 3 0")), "a.off: the surface is open: 1 holes"),
    "edges as long as the surface": (surface_file(TETRAHEDRON, edge_length=1.0), "a.off: the edge length is 1 m"),
    "two targets": (surface_file(TETRAHEDRON, cells=100), "mesh.surface: give exactly one of edge_length, cells"),
    "hexes to refine": (change("mesh", TINY["mesh"] | HEXES), "only tet4 meshes can be refined"),
    "inverted cells": (mesh_file("a.mesh", TETS.format(apex="0 0 -1", cell="1 2 3 5")), "mesh.reorient"),
    "flat cells": (mesh_file("a.mesh", TETS.format(apex="1 1 0", cell="1 2 3 5")), "volume"),
    "NaN coordinates": (mesh_file("a.mesh", TETS.format(apex="0 0 nan", cell="1 3 2 5")), "must be finite"),
    "vertices out of range": (mesh_file("a.mesh", TETS.format(apex="0 0 -1", cell="1 3 2 9")), "a.mesh"),
    "an unknown shape": (change("mesh.shape.name", "sphere"), "known are beam, mounted_bar"),
    "pins that hold nothing": (
        change("mesh.pins", [{"ball": {"centre": [9, 9, 9], "radius": 0.1}}]),
        "pins no vertex",
    ),
    "pins of an unknown group": (
        change("mesh.pins", [{"group": "feet"}]),
        "no group 'feet'; known are none: its file defines no groups",
    ),
    "pins of an unknown vertex": (change("mesh.pins", [{"vertices": [1, 99999]}]), "vertex 99999 of a list does not"),
    "an empty set of pins": (change("mesh.pins", []), "mesh.pins: tuple should have at least 1 item"),
    "a negative modulus": (change("mesh.material.youngs_modulus", -1.0), "should be greater than 0, got -1.0"),
    "an incompressible solid": (change("mesh.material.poisson_ratio", 0.5), "should be less than 0.5, got 0.5"),
    "a region without cells": (
        change("mesh.regions", [{"where": {"ball": {"centre": [9, 9, 9], "radius": 0.1}}, "density": 1}]),
        "changes no cell; the solid spans",
    ),
    "cell data that is not there": (
        lambda experiment: (
            mesh_file("a.mesh", GOOD)(experiment),
            add(experiment, "mesh", "cell_data: {density: rho}"),
        ),
        "gives no number 'rho' to its cells; known are medit:ref",
    ),
    "a load on no surface": (
        change("mesh.loads", [{"where": {"ball": {"centre": [9, 9, 9], "radius": 0.1}}, "pressure": 1}]),
        "holds no face of the surface",
    ),
    "pins that hold all": (change("mesh.pins", [{"slab": {"axis": "x", "thickness": 9}}]), "at least one must be free"),
}


@pytest.mark.parametrize("case", MESHES)
def test_a_bad_mesh(experiment: Experiment, case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("LDSIM_DATA", raising=False)
    spoil, words = MESHES[case]
    spoil(experiment)
    assert words in refusal(experiment, "mesh")


def test_the_mesh_file_that_the_bad_ones_are_made_from_is_good(experiment: Experiment) -> None:
    mesh_file("a.mesh", GOOD)(experiment)
    assert experiment.invoke("mesh").exit_code == 0


# The motions


def recording(content: str | None) -> Callable[[Experiment], None]:
    def spoil(experiment: Experiment) -> None:
        if content is not None:
            (experiment.folder / "a.csv").write_text(content, encoding="utf-8")
        experiment.change("snapshot.motions", [{"name": "a", "recording": "a.csv"}])

    return spoil


def motions(*entries: dict[str, object]) -> Callable[[Experiment], None]:
    return lambda experiment: experiment.change("snapshot.motions", list(entries))


def moving(where: dict[str, object], *keyframes: dict[str, object]) -> dict[str, object]:
    return {"where": where, "keyframes": list(keyframes)}


FEET: dict[str, object] = {"slab": {"axis": "y", "thickness": 0.001}}
TOP: dict[str, object] = {"slab": {"axis": "y", "at": "max", "thickness": 0.001}}
MOTIONS: dict[str, tuple[Callable[[Experiment], None], str]] = {
    "missing": (recording(None), "a.csv does not exist"),
    "empty": (recording(""), "holds no frames"),
    "without a column": (recording("is_dragging,target_x\n1,2\n"), "lacks the column 'target_y'"),
    "without a stiffness": (recording(RECORDING.format(rows=MISS).split("\n", 1)[1]), "needs a line '# spring_stiff"),
    "not numbers": (recording(RECORDING.format(rows="1,a,b,c,d,e,f")), "does not hold seven numbers"),
    "not finite": (recording(RECORDING.format(rows="1,nan,0,0,0,0,0")), "not finite"),
    "a grab that hits no vertex": (recording(RECORDING.format(rows=MISS)), "hits no vertex"),
    "a grab of pinned vertices": (recording(RECORDING.format(rows="1,0,-1,0,0.09,-0.075,0")), "only pinned vertices"),
    "a path with one keyframe": (
        motions({"name": "a", "script": {"moving_pins": [moving(FEET, {"time": 0})]}}),
        "moving_pins.0.keyframes: a path needs at least two keyframes, got 1",
    ),
    "a path of what is not pinned": (
        motions({"name": "a", "script": {"moving_pins": [moving(TOP, {"time": 0}, {"time": 1, "angle": 9})]}}),
        "motion a: Slab(axis='y', at_max=True, thickness=0.001) holds no pinned vertex",
    ),
    "a path of an unknown group": (
        motions({"name": "a", "script": {"moving_pins": [moving({"group": "lid"}, {"time": 0}, {"time": 1})]}}),
        "motion a: the mesh has no group 'lid'; known are none",
    ),
    "a script that is not there": (motions({"name": "a", "script_file": "b.yaml"}), "b.yaml does not exist"),
    "no motion to learn from": (
        motions({"name": "a", "role": "heldout", "gravity_sweep": {"duration": 1}}),
        "at least one motion must have the role train",
    ),
}


@pytest.mark.parametrize("case", MOTIONS)
def test_a_bad_motion(experiment: Experiment, case: str) -> None:
    spoil, words = MOTIONS[case]
    spoil(experiment)
    if case == "a grab of pinned vertices":
        text = experiment.folder / "a.csv"
        text.write_text(text.read_text().replace("grab_radius_m: 0.03", "grab_radius_m: 0.001"))
    assert words in refusal(experiment, "snapshot")


@pytest.mark.parametrize("command", ["pca", "simulate"])
def test_pins_that_move_are_refused_in_the_reduced_spaces(experiment: Experiment, command: str) -> None:
    with h5py.File(experiment.run / "snapshots.h5", "r+") as file:
        group = file["motions/a"]
        group["support_maps"] = np.tile(np.eye(3, 4), (1, int(group.attrs["frames"]), 1, 1))
        group["support_vertices"], group["support_count"] = np.array([0]), np.array([1])
    if command == "pca":
        assert "motion a moves pins, which the linear and the latent space cannot do" in refusal(experiment, command)
    else:  # it is another file than the model was made from, which is said first
        assert "was made from another snapshots" in refusal(experiment, command)


def test_a_motion_to_simulate_that_no_one_ran(experiment: Experiment) -> None:
    experiment.configure(TINY | {"simulate": {"motions": ["z"]}})
    assert "simulate.motions names 'z'; the snapshots hold a, b" in refusal(experiment, "simulate")


# The solver of the full space


def test_a_factor_larger_than_the_memory(experiment: Experiment, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ldsim.dynamics.linear_choice.physical_memory", lambda: 1000.0)
    experiment.configure(TINY | {"snapshot": TINY["snapshot"] | {"linear_solver": "direct"}})
    message = refusal(experiment, "snapshot")
    assert "snapshot.linear_solver is direct" in message and "use multigrid or fewer workers" in message


# The poses of cubature


CUBATURES: dict[str, tuple[dict[str, object], str]] = {
    "fewer poses than asked for": ({"poses": 1000}, "needs 1000 poses to fit and 200 to judge, but there are 40"),
    "a tolerance of zero": ({"tolerance": 0.0}, "cubature.tolerance: input should be greater than 0, got 0"),
    "a negative tolerance": ({"tolerance": -0.1}, "cubature.tolerance: input should be greater than 0, got -0.1"),
    "no points": ({"max_points": 0}, "cubature.max_points: input should be greater than or equal to 1, got 0"),
    "an unknown method": ({"method": "magic"}, "cubature.method: input should be 'exchange', 'ecsw'"),
    "more than all of the true forces": ({"closure": 1.5}, "cubature.closure: input should be less than or equal to 1"),
}


@pytest.mark.parametrize("case", CUBATURES)
def test_a_bad_setting_of_cubature(experiment: Experiment, case: str) -> None:
    settings, words = CUBATURES[case]
    experiment.configure(TINY | {"cubature": settings})
    assert words in refusal(experiment, "cubature")


def test_poses_without_any_force(experiment: Experiment) -> None:
    with h5py.File(experiment.run / "snapshots.h5", "r+") as file:
        for motion in file["motions"].values():
            motion["displacements"][:] = 0.0
    hashes = {"snapshots": file_hash(experiment.run / "snapshots.h5")}
    for name in ("basis", "model"):
        with h5py.File(experiment.run / f"{name}.h5", "r+") as file:
            file.attrs["inputs"] = json.dumps(json.loads(file.attrs["inputs"]) | hashes)
        hashes[name] = file_hash(experiment.run / f"{name}.h5")
    assert "the elastic force of all 20 poses is zero" in refusal(experiment, "cubature")


def test_a_model_of_another_scene(experiment: Experiment) -> None:
    with h5py.File(experiment.run / "scene.h5", "r+") as file:
        file["material/mu"][:] *= 2
    assert "scene.h5" in refusal(experiment, "cubature")


# The reduced space


def snapshots_of(value: float, everywhere: bool) -> Callable[[Experiment], None]:
    """Put a value into one displacement of the training motion, or into all."""

    def spoil(experiment: Experiment) -> None:
        with h5py.File(experiment.run / "snapshots.h5", "r+") as file:
            data = file["motions/a/displacements"]
            if everywhere:
                data[:] = value
            else:
                data[7, 0, 0] = value

    return spoil


SPACES: dict[str, tuple[str, Callable[[Experiment], None], str]] = {
    "k above the frames": ("pca", change("pca.k", 500), "k = 500 but there are only 40 training snapshots"),
    "NaN in a snapshot": ("pca", snapshots_of(np.nan, everywhere=False), "training snapshot 7 holds a displacement"),
    "constant data": ("pca", snapshots_of(0.0, everywhere=True), "nothing moves"),
    "a k out of reach": (
        "pca",
        lambda experiment: experiment.configure(TINY | {"pca": {"max_k": 1, "tolerance_mm": 1e-6}}),
        "raise pca.max_k or pca.tolerance_mm",
    ),
    "r above k": ("train", change("train.r", 9), "latent dimension r = 9; allowed are 1 … k = 6"),
    "an r out of reach": (
        "train",
        lambda experiment: experiment.configure(
            TINY | {"train": {"tolerance_mm": 1e-9, "hidden": [8], "epochs": 2, "equilibrium": 0}}
        ),
        "raise train.tolerance_mm or pca.k",
    ),
    "an unknown device": ("train", change("train.device", "gpu"), "train.device: string should match pattern"),
}


@pytest.mark.parametrize("case", SPACES)
def test_a_space_that_cannot_be_found(experiment: Experiment, case: str) -> None:
    command, spoil, words = SPACES[case]
    spoil(experiment)
    assert words in refusal(experiment, command)


def test_no_motion_to_be_judged_on_is_said_in_one_line(experiment: Experiment) -> None:
    with h5py.File(experiment.run / "snapshots.h5", "r+") as file:
        file["motions/b"].attrs["role"] = "train"
    assert experiment.invoke("pca").exit_code == 0
    result = experiment.invoke("train")
    assert result.exit_code == 0
    warnings = [line for line in result.stderr.splitlines() if line.startswith("warning: ")]
    assert warnings == [
        "warning: no motion has the role heldout, so nothing tells how the model does on unseen motions"
    ]


# Where the artefact goes


@every_command
def test_a_full_disk(experiment: Experiment, command: str) -> None:
    with full_disk(2048):
        message = refusal(experiment, command)
    assert message.startswith("cannot write ")


@pytest.mark.parametrize("command", [command for command in COMMANDS if command in WRITES])
def test_a_name_that_cannot_be_written(experiment: Experiment, command: str) -> None:
    target = experiment.run / WRITES[command]
    target.unlink()
    (target / "in the way").mkdir(parents=True)
    message = refusal(experiment, command)
    assert message.startswith(f"cannot write {target}: ")


def test_a_folder_that_cannot_be_made(experiment: Experiment) -> None:
    in_the_way = experiment.folder / "file"
    in_the_way.touch()
    result = CliRunner().invoke(main, ["mesh", str(experiment.config), "--runs", str(in_the_way / "runs")])
    assert "cannot write " in refused(result)
    result = CliRunner().invoke(main, ["settings", str(experiment.config), "--stamps", str(in_the_way / "stamps")])
    assert "cannot write " in refused(result)


# info


@pytest.mark.parametrize(
    ("content", "words"),
    [(None, "does not exist"), (b"", "is not a readable HDF5 file"), (b"Vertices", "is not a readable HDF5 file")],
)
def test_info_of_what_is_no_artefact(tmp_path: Path, content: bytes | None, words: str) -> None:
    path = tmp_path / "a.h5"
    if content is not None:
        path.write_bytes(content)
    assert words in refused(CliRunner().invoke(main, ["info", str(path)]))


def test_info_of_a_foreign_hdf5_file(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["x"] = np.eye(2)
    assert "is not an ldsim artefact" in refused(CliRunner().invoke(main, ["info", str(path)]))

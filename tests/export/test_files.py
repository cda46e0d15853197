"""Files for other programs, read back by other libraries or by a reader written here."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import h5py
import meshio
import numpy as np
import pytest
from numpy.typing import NDArray

from ldsim.arrays import Array
from ldsim.export.arrays import model_arrays, safetensors, unit_loads, write_npz, write_safetensors
from ldsim.export.formats import FORMATS
from ldsim.export.paraview import write_vtu_series, write_xdmf
from ldsim.export.playback import Playback, playback
from ldsim.mechanics.options import MaterialChangeOptions
from ldsim.mesh.shapes import beam
from ldsim.mesh.surface import Surface
from ldsim.pipeline.options import SimulateOptions
from ldsim.run import Run
from ldsim.simulator.fields import FIELDS, VertexField
from tests.helpers import scene
from tests.report.small_run import changed

SPACES = ["full", "linear", "latent"]


def hexes() -> Playback:
    """A swing of a beam of hexahedra."""
    body = scene(beam(resolution=1, cell_type="hex8"))
    mode = np.outer(body.mesh.vertices[:, 0] ** 2, [0.0, 1.0, 0.3])
    return Playback("swing", "full", body, body.time_step, 4, lambda frame: np.sin(frame) * mode)


def playbacks(run: Run) -> list[Playback]:
    return [*(playback(run, "pull_1", space) for space in SPACES), hexes()]


def test_a_vtu_series_gives_back_cells_positions_displacements_and_times(run: Run, tmp_path: Path) -> None:
    for number, played in enumerate(playbacks(run)):
        folder = tmp_path / str(number)
        folder.mkdir()
        write_vtu_series(played, folder)
        entries = re.findall(r'timestep="(.*?)".*file="(.*?)"', (folder / f"{played.title}.pvd").read_text())
        assert len(entries) == played.frames
        for frame, (time, name) in enumerate(entries):
            read = meshio.read(folder / name)
            u = played.displacement(frame)
            np.testing.assert_array_equal(read.cells[0].data, played.mesh.cells)
            np.testing.assert_allclose(read.points, played.mesh.vertices + u, atol=1e-12)
            np.testing.assert_allclose(read.point_data["displacement"], u, rtol=1e-6, atol=1e-9)
            for field in FIELDS:
                np.testing.assert_allclose(read.point_data[field], at_vertices(played, field, u), rtol=1e-5, atol=1e-6)
            assert float(time) == pytest.approx((frame + 1) * played.scene.time_step)


def at_vertices(played: Playback, field: str, u: Array) -> Array:
    """A field by the simulator's own class, which is held to a slow loop elsewhere."""
    return VertexField(played.scene, np.arange(played.mesh.n_vertices))(field, u)


def test_a_run_with_another_material_is_exported_with_the_stress_of_that_material(run: Run, tmp_path: Path) -> None:
    own = playback(run, "pull_1", "linear")
    options = SimulateOptions(material=MaterialChangeOptions(youngs_factor=3.0))
    changed(run, "simulation", settings=options.dump())
    played, u = playback(run, "pull_1", "linear"), own.displacement(0)
    write_vtu_series(played, tmp_path)
    read = meshio.read(min(tmp_path.rglob("*.vtu")))
    np.testing.assert_array_equal(played.displacement(0), u)
    np.testing.assert_allclose(read.point_data["stress"], 3 * at_vertices(own, "stress", u), rtol=1e-5)
    assert playback(run, "pull_1", "full").scene is run.scene  # which ran before, with its own


def xdmf_data(element: ElementTree.Element, path: Path) -> NDArray[np.generic]:
    """The array that the DataItem in an element names, of the type and shape that it gives."""
    (item,) = element.iter("DataItem")
    file, _, dataset = str(item.text).partition(":")
    with h5py.File(path.parent / file) as content:
        values: NDArray[np.generic] = content[dataset][:]
    assert values.shape == tuple(int(size) for size in item.attrib["Dimensions"].split())
    assert values.dtype == {"Int": "<i", "Float": "<f"}[item.attrib["NumberType"]] + item.attrib["Precision"]
    return values


def test_xdmf_gives_back_the_mesh_displacements_and_times(run: Run, tmp_path: Path) -> None:
    for number, played in enumerate(playbacks(run)):
        folder = tmp_path / str(number)
        folder.mkdir()
        write_xdmf(played, folder)
        path = folder / f"{played.title}.xdmf"
        grids = ElementTree.parse(path).findall("Domain/Grid/Grid")
        assert len(grids) == played.frames
        for frame, grid in enumerate(grids):
            topology, geometry, field, time = (
                grid.findall(name)[0] for name in ("Topology", "Geometry", "Attribute", "Time")
            )
            kind = {"tet4": "Tetrahedron", "hex8": "Hexahedron"}[played.mesh.cell_type]
            assert topology.attrib == {"TopologyType": kind, "NumberOfElements": str(played.mesh.n_cells)}
            np.testing.assert_array_equal(xdmf_data(topology, path), played.mesh.cells)
            np.testing.assert_array_equal(xdmf_data(geometry, path), played.mesh.vertices)
            expected = played.displacement(frame)
            np.testing.assert_allclose(xdmf_data(field, path), expected, rtol=1e-6, atol=1e-9)
            scalars = {each.attrib["Name"]: xdmf_data(each, path) for each in grid.findall("Attribute")[1:]}
            assert set(scalars) == set(FIELDS)
            for name, values in scalars.items():
                np.testing.assert_allclose(values, at_vertices(played, name, expected), rtol=1e-5, atol=1e-6)
            assert float(time.attrib["Value"]) == pytest.approx((frame + 1) * played.scene.time_step)


@pytest.mark.parametrize("suffix", ["obj", "ply"])
def test_a_surface_sequence_gives_back_the_deformed_boundary(run: Run, tmp_path: Path, suffix: str) -> None:
    played = playback(run, "push", "latent")
    FORMATS[suffix].motion(played, tmp_path)
    surface = Surface.of(played.mesh)
    files = sorted(tmp_path.iterdir())
    assert len(files) == played.frames
    for frame, path in enumerate(files):
        read = meshio.read(path)
        expected = (played.mesh.vertices + played.displacement(frame))[surface.vertices]
        np.testing.assert_allclose(read.points, expected, rtol=1e-6, atol=1e-8)
        np.testing.assert_array_equal(read.cells_dict["triangle"], surface.triangles)


def test_safetensors_gives_back_every_array_aligned(run: Run, tmp_path: Path) -> None:
    numpy_reader = pytest.importorskip("safetensors.numpy")
    write_safetensors(run, tmp_path / "model.safetensors")
    read = numpy_reader.load_file(tmp_path / "model.safetensors")
    expected = model_arrays(run)
    assert set(read) == set(expected)
    for name, values in expected.items():
        np.testing.assert_array_equal(read[name], values)
        assert read[name].dtype == values.dtype


def test_arrays_of_mixed_types_start_at_multiples_of_their_size() -> None:
    arrays = {"a": np.ones(3, np.uint8), "b": np.ones((2, 3)), "c": np.ones(5, np.float32), "d": np.empty((0, 0))}
    content = safetensors(arrays, {})
    start = 8 + int.from_bytes(content[:8], "little")
    assert start % 8 == 0
    assert len(content) == start + 3 + 48 + 20
    np.testing.assert_array_equal(np.frombuffer(content, "<f8", 6, start), 1)


def test_npz_holds_the_same_arrays(run: Run, tmp_path: Path) -> None:
    write_npz(run, tmp_path / "model.npz")
    expected = model_arrays(run)
    with np.load(tmp_path / "model.npz") as read:
        assert set(read.files) == set(expected)
        for name, values in expected.items():
            np.testing.assert_array_equal(read[name], values)


def test_unit_loads_times_gravity_are_the_weight_in_the_basis(run: Run) -> None:
    body, basis = run.scene, run.basis
    weight = body.vertex_mass[:, None] * body.gravity
    np.testing.assert_allclose(body.gravity @ unit_loads(body, basis), basis.matrix.T @ weight.ravel(), rtol=1e-12)


def test_thinning_keeps_frames_at_multiples_of_the_new_interval(run: Run) -> None:
    whole = playback(run, "pull_1", "latent")
    thinned = whole.thinned(4)
    assert thinned.frames == whole.frames // 4
    for frame in range(thinned.frames):
        other = 4 * frame + 3
        np.testing.assert_array_equal(thinned.displacement(frame), whole.displacement(other))
        assert thinned.time(frame) == pytest.approx(whole.time(other))

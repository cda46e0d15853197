"""Many instances at once are the same instances one by one, whatever the threads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ldsim.errors import ExportError, SolverError
from ldsim.runtime.batch import BatchedSimulator
from ldsim.runtime.library import Library, NativeModel, NativeSolid, local_library
from ldsim.runtime.model_file import model_bytes
from tests.report.small_run import write_run
from tests.runtime.problems import latent


@pytest.mark.parametrize("threads", [1, 3])
def test_instances_step_to_the_last_bit_as_one_by_one(library: Library, threads: int) -> None:
    space = latent()
    model = NativeModel(library, model_bytes(space))
    x = space.scene.mesh.vertices
    tip, size = x[x[:, 0].argmax()], space.scene.mesh.diagonal
    targets = tip + 0.2 * size * np.random.default_rng(0).normal(size=(7, 3))
    gravity = np.random.default_rng(1).normal(size=(7, 3))
    batch, alone = BatchedSimulator(model, 7, threads), [NativeSolid(model) for _ in targets]
    grabs = batch.grab(tip, targets, 50.0)
    batch.set_gravity(gravity)
    assert repr(batch).startswith(f"<BatchedSimulator: 7 solids of {space.r} numbers on {threads} thread")
    assert batch.step(6).tolist() == [0] * 7
    batch.move(grabs, tip)
    batch.step(2)
    batch.release(grabs)
    batch.step()
    for solid, target, own in zip(alone, targets, gravity, strict=True):
        grab = solid.grab(tip, target, 50.0)
        solid.set_gravity(own)
        for step in range(9):
            if step == 6:
                solid.move(grab, tip)
            if step == 8:
                solid.release(grab)
            solid.step()
    np.testing.assert_array_equal(batch.z, [solid.z for solid in alone])
    some = np.array([3, 1])
    np.testing.assert_array_equal(batch.displacement(some), batch.displacement()[:, some])
    assert np.ptp(batch.z, axis=0).max() > 0
    batch.reset()
    assert not batch.z.any()


def test_where_one_instance_refuses_to_be_grabbed_none_is_held(library: Library) -> None:
    space = latent()
    batch = BatchedSimulator(NativeModel(library, model_bytes(space)), 3, 1, max_grabs=1)
    x = space.scene.mesh.vertices
    tip, away = x[x[:, 0].argmax()], np.full(3, 99.0)
    with pytest.raises(SolverError, match="farther from the solid"):
        batch.grab([tip, tip, away], tip + 0.1)
    batch.step()
    assert np.ptp(batch.z, axis=0).max() == 0
    batch.release(batch.grab(tip, tip + 0.1))  # there is room for one grab each


@pytest.mark.parametrize("count", [0, -(2**32) + 1])
def test_no_steps_and_fewer_are_refused_and_nothing_steps(library: Library, count: int) -> None:
    """The negative one would be a single step as an unsigned number."""
    model = NativeModel(library, model_bytes(latent()))
    solid, batches = NativeSolid(model), [BatchedSimulator(model, 2, threads) for threads in (1, 2)]
    for step in (solid.step_many, *(batch.step for batch in batches)):
        with pytest.raises(ValueError, match=f"step count is {count}; it must be at least 1"):
            step(count)
    assert not solid.z.any() and not any(batch.z.any() for batch in batches)


def test_more_steps_than_the_library_counts_are_refused(library: Library) -> None:
    model = NativeModel(library, model_bytes(latent()))
    for step in (NativeSolid(model).step_many, BatchedSimulator(model, 2, 1).step):
        with pytest.raises(ValueError, match="step count is 4294967296; it must be less than 4294967296"):
            step(2**32)


def test_numbers_that_would_wrap_in_the_library_are_refused(library: Library) -> None:
    model = NativeModel(library, model_bytes(latent()))
    for most in (-1, 2**31, 2**32 + 1):
        with pytest.raises(SolverError, match=f"at most {most} grabs at once; expected 0 or more"):
            BatchedSimulator(model, 2, 1, max_grabs=most)
    batch, tip = BatchedSimulator(model, 2, 1), latent().scene.mesh.vertices[-1]
    grabs = batch.grab(tip, tip)
    for turns in (1, -1):
        with pytest.raises(SolverError, match=f"there is no grab {1 + turns * 2**32}"):
            batch.move(grabs + turns * 2**32, tip + 1.0)


def test_the_full_space_is_refused_by_its_name(tmp_path: Path, library: Library) -> None:
    write_run(tmp_path)
    with pytest.raises(ExportError, match="^the C library steps reduced spaces alone; got the full space$"):
        BatchedSimulator.load(tmp_path, 2, "full")


def test_what_is_not_of_the_instances_shape_is_refused(library: Library) -> None:
    batch = BatchedSimulator(NativeModel(library, model_bytes(latent())), 2, 1)
    with pytest.raises(SolverError, match=r"gravity has the shape \(\); it must be \(3,\), or \(2, 3\) for one each"):
        batch.set_gravity(-9.81)
    with pytest.raises(SolverError, match=r"target has the shape \(2, 1\)"):
        batch.grab([0.0, 0.0, 0.0], [[1.0], [2.0]])
    for grabs in (np.array([True, True]), np.array([1.0, 1.0]), np.array([1])):
        with pytest.raises(SolverError, match="grabs are .*; they must be the whole numbers that grab gave"):
            batch.release(grabs)


def test_a_run_and_the_file_that_was_exported_from_it_are_loaded_in_a_line(tmp_path: Path, library: Library) -> None:
    write_run(tmp_path)
    batch = BatchedSimulator.load(tmp_path, 4, "latent")
    batch.step(3)
    assert len(batch) == 4 and batch.z.any()
    with pytest.raises(SolverError, match="this is no model of ldsim"):
        BatchedSimulator.load(tmp_path / "scene.h5", 4)
    with pytest.raises(SolverError, match="0 instances on 2 threads"):
        BatchedSimulator(batch.model, 0, 2)


def test_a_library_that_does_not_compile_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cc: str
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr("ldsim.runtime.compilers.OPTIMISED", ("-no-such-option",))
    with pytest.raises(SolverError, match="no-such-option"):
        local_library()
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_the_library_is_compiled_once_a_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cc: str) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    local_library()
    (made,) = tmp_path.rglob("libldsim.so")
    when = made.stat().st_mtime_ns
    local_library()
    assert [(file, file.stat().st_mtime_ns) for file in tmp_path.rglob("libldsim.so")] == [(made, when)]

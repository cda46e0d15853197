"""The replay holds every motion as the run has it, up to what its caption admits."""

from __future__ import annotations

import json
import re
from base64 import b64decode
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ldsim.mesh.surface import surface_vertices
from ldsim.report import replay as replay_module
from ldsim.report.replay import Replay, _step_words, make_replay, quantised
from ldsim.report.runs import reduced_runs
from ldsim.run import Run
from tests.report.small_run import FRAMES, LOST_FROM, changed


@pytest.fixture(scope="module")
def run(lost_folder: Path) -> Iterator[Run]:
    with Run.open(lost_folder) as opened:
        yield opened


@pytest.fixture(scope="module")
def replay(run: Run) -> Replay:
    found = make_replay(run)
    assert found is not None
    return found


def unpacked(packed: list[str]) -> np.ndarray:
    kind, text = packed
    return np.frombuffer(b64decode(text), dtype=f"<{kind}")


def displacements(data: dict[str, Any], shown: dict[str, Any]) -> np.ndarray:
    """u of the drawn vertices as the page decodes it, (N, v, 3) metres."""
    modes = unpacked(data["modes"]).reshape(-1, len(data["scales"]))
    c = unpacked(shown["coordinates"]).reshape(shown["frames"], -1)
    return (c * np.array(data["scales"]) @ modes.T).reshape(shown["frames"], -1, 3)


def truth(run: Run, motion: str, space: str) -> np.ndarray:
    """u of the surface's vertices in every frame, (N, v, 3) metres."""
    surface = surface_vertices(run.scene.mesh)
    if space == "full":
        return run.snapshots.reader(motion)(0, FRAMES[motion])[:, surface].astype(np.float64)
    q = reduced_runs(run, motion)[space].coordinates
    return (q @ run.basis.matrix[:, : q.shape[1]].T).reshape(len(q), -1, 3)[:, surface]


def every_space(replay: Replay) -> Iterator[tuple[dict[str, Any], dict[str, Any], dict[str, Any]]]:
    data = json.loads(replay.data)
    for motion in data["motions"]:
        for shown in motion["spaces"]:
            yield data, motion, shown


def test_what_is_drawn_is_as_far_from_the_run_as_the_caption_says(run, replay):
    off = []
    for data, motion, shown in every_space(replay):
        true = truth(run, motion["name"], shown["space"])[: shown["frames"]]
        off.append(np.linalg.norm(displacements(data, shown) - true, axis=2).ravel())
    assert len(off) == 6
    mean, worst = re.search(r"Drawn to ([\d.e-]+) mm .* average, ([\d.e-]+) mm", replay.caption).groups()
    assert 1000 * np.concatenate(off).mean() == pytest.approx(float(mean), rel=1e-2)
    assert 1000 * np.concatenate(off).max() == pytest.approx(float(worst), rel=1e-2)
    assert np.concatenate(off).max() < 1e-3 * run.scene.mesh.diagonal


def test_held_out_motions_come_first_and_full_space_leads(replay):
    motions = json.loads(replay.data)["motions"]
    assert [motion["name"] for motion in motions] == ["push", "pull_1"]
    assert all([shown["space"] for shown in motion["spaces"]] == ["full", "linear", "latent"] for motion in motions)


def test_a_space_ends_where_the_run_was_lost(replay):
    ends = {(motion["name"], shown["space"]): shown["frames"] for _, motion, shown in every_space(replay)}
    assert ends[("push", "linear")] == LOST_FROM
    assert ends[("push", "latent")] == FRAMES["push"]


def test_numbers_in_the_panels_are_those_of_the_run(run, replay):
    for _, motion, shown in every_space(replay):
        if shown["space"] != "full":
            true = reduced_runs(run, motion["name"])[shown["space"]].mean_error[: shown["frames"]]
            np.testing.assert_allclose(unpacked(shown["mean_mm"]), 1000 * true, rtol=1e-6)


def test_a_step_that_took_long_is_told_without_an_exponent(monkeypatch):
    timed = SimpleNamespace(seconds=np.array([0.1234, np.nan]))
    monkeypatch.setattr("ldsim.report.replay.runs", lambda run, space: {"push": timed})
    assert _step_words(None, "full", "push") == ", 123 ms"


def test_a_pull_goes_from_the_middle_of_what_is_held_to_its_target(run, replay):
    motion = json.loads(replay.data)["motions"][0]
    (drag,) = motion["drags"]
    recorded = run.recorded("push")
    np.testing.assert_allclose(unpacked(drag["targets"]).reshape(-1, 3), recorded.motion.drags[0].targets, rtol=1e-6)
    held = recorded.held[0]
    frames = np.arange(drag["first"], drag["first"] + 4)
    u = run.snapshots.reader("push")(0, FRAMES["push"]).astype(np.float64)
    q = reduced_runs(run, "push")["latent"].coordinates
    reduced = (q @ run.basis.matrix.T).reshape(len(q), -1, 3)
    for shown, field in (("full", u), ("latent", reduced)):
        (grip,) = next(some["grips"] for some in motion["spaces"] if some["space"] == shown)
        true = (run.scene.mesh.vertices[held] + field[frames][:, held]).mean(axis=1)
        np.testing.assert_allclose(unpacked(grip).reshape(-1, 3), true, rtol=1e-5, atol=1e-8)


def test_frames_are_left_out_and_told_of_before_motions_are(run, monkeypatch):
    row = 2 * (run.basis.k + replay_module.EXTRA_MODES) * 3
    monkeypatch.setattr(replay_module, "COORDINATES_BYTES", 13 * row)
    found = make_replay(run)
    motions = json.loads(found.data)["motions"]
    assert [motion["frames"] for motion in motions] == [FRAMES["push"] // 2, FRAMES["pull_1"] // 2]
    assert found.caption.startswith("2 motions, one frame in 2;")
    data, motion, shown = next(every_space(found))
    true = truth(run, motion["name"], shown["space"])[1::2]
    np.testing.assert_allclose(displacements(data, shown), true, atol=2e-4 * run.scene.mesh.diagonal)
    monkeypatch.setattr(replay_module, "COORDINATES_BYTES", 2 * row)
    found = make_replay(run)
    assert [motion["name"] for motion in json.loads(found.data)["motions"]] == ["push"]
    assert "1 motion (1 more left out for size), " in found.caption


def test_modes_that_do_not_fit_are_left_out_and_the_error_is_told(run, replay, monkeypatch):
    monkeypatch.setattr(replay_module, "MODES_BYTES", 2 * 2 * 3 * len(surface_vertices(run.scene.mesh)))
    found = make_replay(run)
    assert ", 2 modes." in found.caption and found.caption != replay.caption


def test_a_large_surface_is_drawn_by_fewer_vertices(run, monkeypatch):
    monkeypatch.setattr(replay_module, "MAX_VERTICES", 30)
    found = make_replay(run)
    data = json.loads(found.data)
    drawn = len(unpacked(data["rest"])) // 3
    assert drawn <= 30
    assert f"; {drawn} of {len(surface_vertices(run.scene.mesh))} vertices of the surface" in found.caption
    assert unpacked(data["triangles"]).max() == drawn - 1


def test_without_a_reduced_run_there_is_no_replay(run):
    with Run(run.folder, run.experiment) as other:
        assert make_replay(changed(other, "simulation", {})) is None


def test_without_a_frame_that_was_not_lost_there_is_no_replay(run):
    with Run(run.folder, run.experiment) as other:
        lost = {
            space: {
                name: replace(each, coordinates=np.full_like(each.coordinates, np.nan), mean_error=None, max_error=None)
                for name, each in other.simulation[space].items()
            }
            for space in ("linear", "latent")
        }
        assert make_replay(changed(other, "simulation", lost)) is None


def test_quantising_loses_half_a_step_at_most():
    rng = np.random.default_rng(5)
    modes, rows = rng.normal(size=(60, 3)), rng.normal(size=(40, 3)) * [1.0, 1e-3, 0.0]
    scales, small, (found,) = quantised(modes, [rows])
    step = (np.abs(modes).max(axis=0) * np.abs(rows).max(axis=0)).sum() / 32767
    assert np.abs((found * scales) @ small.T - rows @ modes.T).max() <= 1.01 * step
    assert np.abs(small).max() <= 32767 and np.abs(found).max() <= 32767


def test_a_finished_run_is_shown_to_its_end_however_far_a_vertex_was_off(run):
    """Only a run that diverged ends early; a vertex that is far off in a frame neither hides it nor sets the view."""
    with Run(run.folder, run.experiment) as other:
        spaces = dict(other.simulation)
        latent, diagonal = spaces["latent"]["push"], other.scene.mesh.diagonal
        q, far = latent.coordinates.copy(), latent.max_error.copy()
        q[3] *= 2 * diagonal / np.abs(q[3]).max()
        far[3] = 2 * diagonal
        spaces["latent"] = spaces["latent"] | {"push": replace(latent, coordinates=q, max_error=far)}
        data = json.loads(make_replay(changed(other, "simulation", spaces)).data)
    with Run(run.folder, run.experiment) as plain:
        box = json.loads(make_replay(plain).data)
    ends = {shown["space"]: shown["frames"] for shown in data["motions"][0]["spaces"]}
    assert ends == {"full": FRAMES["push"], "linear": LOST_FROM, "latent": FRAMES["push"]}
    np.testing.assert_allclose([data["low"], data["high"]], [box["low"], box["high"]], atol=0.05 * diagonal)

"""USD, read back by its own library."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ldsim.export.playback import playback
from ldsim.export.usd import write_usd
from ldsim.mesh.formats import read_skin
from ldsim.mesh.surface import Surface
from ldsim.run import Run
from tests.mesh.painted import WRITERS


def test_usd_plays_the_motion(run: Run, tmp_path: Path) -> None:
    pytest.importorskip("pxr", reason="usd-core is not installed: pip install 'ldsim[usd]'")
    from pxr import Gf, Usd, UsdSkel

    played = playback(run, "pull_1", "linear")
    path = tmp_path / "a.usdc"
    write_usd(played, path)
    stage = Usd.Stage.Open(str(path))
    assert UsdSkel.BakeSkinning(UsdSkel.Root(stage.GetDefaultPrim()), Gf.Interval(1, played.frames))
    h = played.scene.time_step  # the first time code is the state at h
    assert stage.GetStartTimeCode() / stage.GetTimeCodesPerSecond() == pytest.approx(h)
    assert stage.GetEndTimeCode() / stage.GetTimeCodesPerSecond() == pytest.approx(played.frames * h)
    assert stage.GetFramesPerSecond() == stage.GetTimeCodesPerSecond()
    surface = Surface.of(played.mesh)
    points = stage.GetPrimAtPath("/solid/surface").GetAttribute("points")
    for frame in range(played.frames):
        expected = (played.mesh.vertices + played.displacement(frame))[surface.vertices]
        np.testing.assert_allclose(np.array(points.Get(frame + 1)), expected, atol=1e-6 * played.mesh.diagonal)


def test_a_surface_of_ones_own_keeps_its_texture_coordinates(run: Run, tmp_path: Path) -> None:
    pytest.importorskip("pxr", reason="usd-core is not installed: pip install 'ldsim[usd]'")
    from pxr import Usd, UsdGeom

    x = run.scene.mesh.vertices
    skin = read_skin(WRITERS["obj"](tmp_path, x.min(axis=0), x.max(axis=0)))
    assert skin.uv is not None
    write_usd(replace(playback(run, "pull_1", "linear"), skin=skin), tmp_path / "a.usdc")
    stage = Usd.Stage.Open(str(tmp_path / "a.usdc"))
    prim = stage.GetPrimAtPath("/solid/surface")
    st = UsdGeom.PrimvarsAPI(prim).GetPrimvar("st")
    assert st.GetInterpolation() == "vertex"
    np.testing.assert_allclose(np.array(st.Get()), skin.uv * [1, -1] + [0, 1], atol=1e-6)
    np.testing.assert_allclose(np.array(prim.GetAttribute("points").Get()), skin.positions, atol=1e-6)

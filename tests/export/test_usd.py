"""USD, read back by its own library."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ldsim.export.playback import playback
from ldsim.export.usd import write_usd
from ldsim.mesh.surface import Surface
from ldsim.run import Run


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
    surface = Surface.of(played.mesh)
    points = stage.GetPrimAtPath("/solid/surface").GetAttribute("points")
    for frame in range(played.frames):
        expected = (played.mesh.vertices + played.displacement(frame))[surface.vertices]
        np.testing.assert_allclose(np.array(points.Get(frame + 1)), expected, atol=1e-6 * played.mesh.diagonal)

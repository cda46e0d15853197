"""USD, read back by its own library."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ldsim.run import Run
from ldsim.mesh.surface import Surface
from ldsim.export.playback import playback
from ldsim.export.usd import write_usd


def test_usd_plays_the_motion(source: Source, tmp_path: Path) -> None:
    pytest.importorskip("pxr", reason="usd-core is not installed: pip install 'ldsim[usd]'")
    from pxr import Gf, Usd, UsdSkel

    playback = source.playback("pull_1", "linear")
    path = tmp_path / "a.usdc"
    write_usd(playback, path)
    stage = Usd.Stage.Open(str(path))
    assert UsdSkel.BakeSkinning(UsdSkel.Root(stage.GetDefaultPrim()), Gf.Interval(0, playback.frames - 1))
    surface = Surface.of(playback.mesh)
    points = stage.GetPrimAtPath("/solid/surface").GetAttribute("points")
    for frame in range(playback.frames):
        expected = (playback.mesh.vertices + playback.displacement(frame))[surface.vertices]
        np.testing.assert_allclose(np.array(points.Get(frame)), expected, atol=1e-6 * playback.mesh.diagonal)

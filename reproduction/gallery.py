"""The pictures of docs/gallery.md: every example at rest, and where its first motion moves it most."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ldsim.arrays import Array
from ldsim.dynamics.full.stepper import FullStepper
from ldsim.dynamics.simulate import simulate
from ldsim.export.playback import playback
from ldsim.mechanics.loads import MotionLoads
from ldsim.mechanics.scene import Scene
from ldsim.mesh.surface import surface_triangles
from ldsim.pipeline.mesh import described_scene
from ldsim.pipeline.progress import SILENT
from ldsim.pipeline.snapshot import motion
from ldsim.report.camera import limits_of, look_at_broadside, upright
from ldsim.report.drawing import DrawnPose, Picture, Pull, side_by_side
from ldsim.run import Run
from ldsim.settings import Settings, load_settings
from reproduction.bench.examples import lacking
from reproduction.harness import CONFIGS, is_stale

WIDTH = 720


class Moved(NamedTuple):
    """A frame of an example: its displacement, m, what pulls on it, and when that is, s."""

    scene: Scene
    u: Array
    pulls: list[Pull]
    seconds: float

    @property
    def by(self) -> float:
        """How far its fastest vertex has come, m."""
        return float(np.linalg.norm(self.u, axis=1).max())


def pictures(runs: Path) -> Iterator[tuple[Path, bytes]]:
    """The configuration and the picture, as WebP, of every example that can be drawn here.

    The first motion is read where its run has it, and else stepped, which takes hours for the paper's own meshes.
    """
    for config in sorted(CONFIGS.glob("*.yaml")):
        settings = load_settings(config)
        reason = lacking(config)
        with Run(runs / config.stem, settings.experiment) as run:
            there = reason is None and not is_stale(run, settings, "snapshot", config.parent)
        if there:
            frames = _recorded(runs / config.stem, settings)
        elif reason is None:
            frames = _stepped(settings)
        else:
            print(f"{config.stem} keeps the picture that it has: {reason}")
            continue
        most = max(frames, key=lambda frame: frame.by)
        data = io.BytesIO()
        _drawn(most, settings.snapshot.motions[0].name).save(data, "WEBP", quality=80)
        yield config, data.getvalue()


def _recorded(folder: Path, settings: Settings) -> Iterator[Moved]:
    with Run.open(folder) as run:
        shown = playback(run, settings.snapshot.motions[0].name, "full")
        x = run.scene.mesh.vertices
        for i in range(shown.frames):
            u = shown.displacement(i)
            pulls = [((x + u)[held].mean(axis=0), target) for held, target in shown.pulls(i)]
            yield Moved(run.scene, u, pulls, shown.time(i))


def _stepped(settings: Settings) -> Iterator[Moved]:
    scene = described_scene(settings.mesh, SILENT, CONFIGS)[0]
    first = motion(scene, settings.snapshot.motions[0], CONFIGS)
    loads, before, x = MotionLoads(first, scene), None, scene.mesh.vertices
    for i, frame in enumerate(simulate(FullStepper(scene, settings.snapshot), first)):
        u, grabs = frame.state.u, loads.at(i, before).grabs
        before = u
        pulls = [((x + u)[grab.vertices].mean(axis=0), grab.target) for grab in grabs]
        yield Moved(scene, u, pulls, (i + 1) * scene.time_step)


def _drawn(moved: Moved, name: str) -> Picture:
    scene = moved.scene
    turn = upright(scene.gravity)
    rest, at = scene.mesh.vertices @ turn.T, (scene.mesh.vertices + moved.u) @ turn.T
    turned = [(turn @ held, turn @ target) for held, target in moved.pulls]
    everything = np.concatenate([rest, at, *(np.stack(pull) for pull in turned)])
    view = look_at_broadside(rest, everything)
    poses = [DrawnPose("at rest", rest), DrawnPose(f"{name}, {moved.seconds:.2f} s", at, turned)]
    return side_by_side(poses, surface_triangles(scene.mesh), view, limits_of(view, everything), WIDTH)

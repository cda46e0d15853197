"""The motion as an animated picture or a video, drawn without a graphics card."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ldsim.export.playback import Playback
from ldsim.mesh.surface import surface_triangles
from ldsim.report.camera import look_at_broadside, upright
from ldsim.report.drawing import Picture, moving_pictures, on_white, webp


class Codec(NamedTuple):
    """Of a video: the suffix of its files, its name, and the options that it is given."""

    suffix: str
    name: str
    options: tuple[str, ...]


WEBP_RATE, VIDEO_RATE = 25.0, 30.0
WEBP_WIDTH, VIDEO_WIDTH = 480, 960
# Pixels are kept as yuv420p, which every browser plays.
MP4 = Codec(".mp4", "libx264", ("-crf", "22", "-preset", "veryfast"))
WEBM = Codec(".webm", "libvpx-vp9", ("-crf", "34", "-b:v", "0", "-deadline", "realtime", "-cpu-used", "6"))


def write_webp(playback: Playback, path: Path) -> None:
    """Write an endless animated WebP in real time, of at most 25 frames a second, on a transparent background."""
    stride = frames_apart(playback, WEBP_RATE)
    pictures = list(_pictures(playback, stride, WEBP_WIDTH))
    path.write_bytes(webp(pictures, max(20, round(1000 * stride * playback.frame_seconds))))


def frames_apart(playback: Playback, rate: float) -> int:
    """How far apart shown frames are, so that at most `rate` of them pass in a second of the motion."""
    return max(1, int(np.ceil(1 / (rate * playback.frame_seconds) - 1e-9)))


def _pictures(playback: Playback, stride: int, width: int) -> Iterator[Picture]:
    """Every stride-th frame, upright and seen from its broad side."""
    turn = upright(playback.scene.gravity)
    rest = playback.mesh.vertices @ turn.T
    shown = range(0, playback.frames, stride)
    positions = np.stack([rest + playback.displacement(frame) @ turn.T for frame in shown])
    view = look_at_broadside(rest, positions)
    yield from moving_pictures([(playback.title, positions)], surface_triangles(playback.mesh), view, width)


def write_video(playback: Playback, path: Path, codec: Codec) -> None:
    """Write a video in real time, of at most 30 frames a second, on white."""
    # An optional dependency: `formats.FORMATS` says so before this is called.
    import imageio_ffmpeg

    stride = frames_apart(playback, VIDEO_RATE)
    target, rate = path.with_name(path.name + codec.suffix), 1 / (stride * playback.frame_seconds)
    frames = map(on_white, _pictures(playback, stride, VIDEO_WIDTH))
    first = next(frames)
    looks = {"fps": rate, "codec": codec.name, "quality": None, "macro_block_size": 2}
    try:
        writer = imageio_ffmpeg.write_frames(str(target), first.shape[1::-1], output_params=[*codec.options], **looks)
        writer.send(None)
        for pixels in chain([first], frames):
            writer.send(pixels.tobytes())
        writer.close()
        target.replace(path)
    finally:
        target.unlink(missing_ok=True)

"""The motion as an animated picture or a video, drawn without a graphics card."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ldsim.export.playback import Playback
from ldsim.mesh.surface import surface_triangles
from ldsim.report.camera import look_at_broadside, upright
from ldsim.report.drawing import Picture, moving_pictures, on_white, webp

WEBP_RATE, VIDEO_RATE = 25.0, 30.0
WEBP_WIDTH, VIDEO_WIDTH = 480, 960
# Pixels are kept as yuv420p, which every browser plays.
MP4 = ("libx264", ("-crf", "22", "-preset", "veryfast"))
WEBM = ("libvpx-vp9", ("-crf", "34", "-b:v", "0", "-deadline", "realtime", "-cpu-used", "6"))


def write_webp(playback: Playback, path: Path) -> None:
    """Write an endless animated WebP in real time, of at most 25 frames a second, on a transparent background."""
    stride = frames_apart(playback, WEBP_RATE)
    pictures = list(_pictures(playback, stride, WEBP_WIDTH))
    path.write_bytes(webp(pictures, max(20, round(1000 * stride * playback.frame_seconds))))


def write_mp4(playback: Playback, path: Path) -> None:
    """Write an H.264 video in real time, of at most 30 frames a second, on white."""
    _write_video(playback, path, ".mp4", *MP4)


def write_webm(playback: Playback, path: Path) -> None:
    """Write a VP9 video in real time, of at most 30 frames a second, on white."""
    _write_video(playback, path, ".webm", *WEBM)


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


def _write_video(playback: Playback, path: Path, suffix: str, codec: str, options: tuple[str, ...]) -> None:
    # An optional dependency: `formats.FORMATS` says so before this is called.
    import imageio_ffmpeg

    stride = frames_apart(playback, VIDEO_RATE)
    target = path.with_name(path.name + suffix)
    rate = 1 / (stride * playback.frame_seconds)
    writer = None
    try:
        for picture in _pictures(playback, stride, VIDEO_WIDTH):
            pixels = on_white(picture)
            if writer is None:
                size = (pixels.shape[1], pixels.shape[0])
                writer = imageio_ffmpeg.write_frames(
                    str(target), size, fps=rate, codec=codec, quality=None, macro_block_size=2, output_params=[*options]
                )
                writer.send(None)
            writer.send(pixels.tobytes())
        if writer is not None:
            writer.close()
        target.replace(path)
    finally:
        target.unlink(missing_ok=True)

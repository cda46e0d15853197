"""The motion as an animated picture or a video, drawn without a graphics card."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ldsim.errors import ExportError
from ldsim.export.playback import Playback
from ldsim.mesh.surface import surface_triangles
from ldsim.report.camera import look_at, look_at_broadside, upright
from ldsim.report.drawing import Movement, Picture, fitted, moving_pictures, on_white, webp


class Codec(NamedTuple):
    """Of a video: the suffix of its files, its name, and the options that it is given."""

    suffix: str
    name: str
    options: tuple[str, ...]


class PictureLook(NamedTuple):
    """What may be said of pictures: frames a second, width and height in pixels, azimuth and elevation in degrees.

    A picture has 90 frames a second at most. Left out: at most 25 of a picture, 30 of a video; as high as the solid
    needs; its broad side.
    """

    fps: float | None = None
    size: tuple[int, int] | None = None
    view: tuple[float, float] | None = None


WEBP_RATE, VIDEO_RATE = 25.0, 30.0
# Chromium makes 100 ms of a pause of 10 ms or less.
WEBP_MOST = 90.0
WEBP_WIDTH, VIDEO_WIDTH = 480, 960
# Pixels are kept as yuv420p, which every browser plays.
MP4 = Codec(".mp4", "libx264", ("-crf", "22", "-preset", "veryfast", "-movflags", "+faststart"))
WEBM = Codec(".webm", "libvpx-vp9", ("-crf", "34", "-b:v", "0", "-deadline", "realtime", "-cpu-used", "6"))


def write_webp(playback: Playback, path: Path, look: PictureLook = PictureLook()) -> None:
    """Write an endless animated WebP in real time on a transparent background."""
    shown, rate = shown_frames(playback, look.fps, WEBP_RATE)
    if rate > WEBP_MOST:
        shown, rate = shown_frames(playback, WEBP_MOST, WEBP_RATE)
    path.write_bytes(webp(list(_pictures(playback, shown, look, WEBP_WIDTH)), 1 / rate))


def shown_frames(playback: Playback, fps: float | None, most: float) -> tuple[list[int], float]:
    """Which frames pass in real time, and how many a second: evenly spaced ones, at most `most`, where none is asked.

    Raises:
        ExportError: the motion has not so many.
    """
    own = 1 / playback.frame_seconds
    if fps is None:
        stride = max(1, int(np.ceil(own / most - 1e-9)))
        return list(range(0, playback.frames, stride)), own / stride
    if fps > own * (1 + 1e-9):
        raise ExportError(f"--fps {fps:g} is more than the {own:g} frames a second of the motion; give at most that")
    count = max(int(playback.frames * fps / own + 1e-9), 1)
    return [min(round(i * own / fps), playback.frames - 1) for i in range(count)], fps


def _pictures(playback: Playback, shown: list[int], look: PictureLook, width: int) -> Iterator[Picture]:
    """Some frames, upright, with what pulls."""
    turn = upright(playback.scene.gravity)
    rest = playback.mesh.vertices @ turn.T
    positions = np.stack([rest + playback.displacement(frame) @ turn.T for frame in shown])
    movement = Movement.pulled(playback.title, positions, map(playback.pulls, shown), turn)
    view = look_at_broadside(rest, positions) if look.view is None else look_at(positions, *look.view)
    width = width if look.size is None else look.size[0]
    drawn = moving_pictures([movement], surface_triangles(playback.mesh), view, width)
    yield from drawn if look.size is None else (fitted(picture, look.size) for picture in drawn)


def write_video(playback: Playback, path: Path, codec: Codec, look: PictureLook = PictureLook()) -> None:
    """Write a video in real time on white.

    Raises:
        ExportError: ffmpeg cannot write it.
    """
    shown, rate = shown_frames(playback, look.fps, VIDEO_RATE)
    frames = map(on_white, _pictures(playback, shown, look, VIDEO_WIDTH))
    first = next(frames)
    height, width = first.shape[:2]
    target = path.with_name(path.name + codec.suffix)
    read = ("-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{rate:.6g}", "-i", "-")
    write = ("-c:v", codec.name, "-pix_fmt", "yuv420p", *codec.options, str(target))
    command = [_ffmpeg(), "-y", "-loglevel", "error", *read, *write]
    try:
        with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            assert process.stdin is not None
            try:
                for pixels in chain([first], frames):
                    process.stdin.write(pixels.tobytes())
            except BrokenPipeError:  # it has ended; what it said follows
                pass
            said = process.communicate()[1].decode(errors="replace").strip()
        if process.returncode:
            last = said.splitlines()[-1] if said else f"exit status {process.returncode}"
            raise ExportError(f"{command[0]} could not write {codec.name}: {last}")
        target.replace(path)
    finally:
        target.unlink(missing_ok=True)


def _ffmpeg() -> str:
    """The system's own, or else that of the optional package; `formats.Extra` says where there is neither."""
    found = shutil.which("ffmpeg")
    if found is None:
        import imageio_ffmpeg

        found = str(imageio_ffmpeg.get_ffmpeg_exe())
    return found

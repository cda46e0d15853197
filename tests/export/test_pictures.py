"""Pictures of a motion: in real time at the rate that is asked for, of the size and from where it is asked for."""

from __future__ import annotations

import importlib.util
import stat
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from ldsim.errors import ExportError
from ldsim.export.formats import Choice, export
from ldsim.export.pictures import MP4, PictureLook, shown_frames, write_video, write_webp
from ldsim.export.playback import Playback, playback
from ldsim.run import Run

# Answers as ffmpeg does, and keeps what it was told: the pixels, and behind them its arguments.
FFMPEG = """#!/bin/sh
for last; do :; done
cat > "$last"
echo "$@" >> "$last"
"""


@pytest.fixture
def push(run: Run) -> Playback:
    return playback(run, "push", "full")


def test_frames_pass_in_real_time_at_the_rate_that_is_asked_for(push: Playback) -> None:
    own = 1 / push.frame_seconds
    motion = replace(push, frames=40)
    assert shown_frames(motion, own, 1.0) == (list(range(40)), own)
    shown, rate = shown_frames(motion, own / 2.5, 1.0)
    assert rate == own / 2.5 and len(shown) == 16  # as many seconds as the motion has
    np.testing.assert_allclose(shown, 2.5 * np.arange(16), atol=0.51)
    assert shown_frames(motion, None, own / 3) == (list(range(0, 40, 3)), pytest.approx(own / 3))
    with pytest.raises(ExportError, match="is more than the .* frames a second of the motion"):
        shown_frames(motion, 1.1 * own, 30.0)


@pytest.mark.parametrize(("own", "fps"), [(250.0, 250.0), (240.0, 144.0), (60.0, 60.0), (35.0, None), (250.0, None)])
def test_a_moving_picture_lasts_as_long_as_the_motion(
    push: Playback, tmp_path: Path, own: float, fps: float | None
) -> None:
    motion = replace(
        push, frames=30, frame_seconds=1 / own, displacement=lambda frame: (1 + frame) * push.displacement(5)
    )
    write_webp(motion, tmp_path / "a.webp", PictureLook(fps, size=(40, 30)))
    with Image.open(tmp_path / "a.webp") as image:
        pauses = []
        for frame in range(getattr(image, "n_frames", 1)):
            image.seek(frame)
            image.load()
            pauses.append(image.info["duration"])
    stride = 1 if fps else int(np.ceil(own / 25))
    shown = len(range(0, 30, stride)) * stride if fps is None else 30
    assert sum(pauses) == pytest.approx(1000 * shown / own, abs=12 if fps else 0.51)
    assert min(pauses) >= 11  # a browser makes 100 ms of 10


@pytest.mark.parametrize("size", [(200, 300), (300, 100)])
def test_a_picture_has_the_size_that_is_asked_for(run: Run, tmp_path: Path, size: tuple[int, int]) -> None:
    path, _ = export(run, Choice("webp", "push", "full", every=4, size=size), tmp_path / "a.webp")
    with Image.open(path) as image:
        assert image.size == size
        box = image.convert("RGBA").getbbox()  # what is not transparent
    assert box is not None and max((box[2] - box[0]) / size[0], (box[3] - box[1]) / size[1]) > 0.6


def test_a_view_from_above_is_another_picture(run: Run, tmp_path: Path) -> None:
    seen = []
    for view in (None, (0.0, 90.0)):
        path, _ = export(run, Choice("webp", "push", every=7, size=(200, 200), view=view), tmp_path / "a.webp")
        with Image.open(path) as image:
            seen.append(np.asarray(image.convert("RGBA")).astype(int))
    assert np.abs(seen[0] - seen[1]).mean() > 5


def test_what_pulls_is_known_in_every_frame_and_drawn(run: Run, push: Playback, tmp_path: Path) -> None:
    recorded = run.recorded("push")
    drag, held = recorded.motion.drags[0], recorded.held[0]
    ((vertices, target),) = push.pulls(drag.start)
    np.testing.assert_array_equal(vertices, held)
    np.testing.assert_array_equal(target, drag.targets[0])
    assert push.pulls(drag.stop) == []
    pixels = []
    single = replace(push, frames=1, displacement=lambda _: push.displacement(drag.start))
    for pulls in (push.pulls(drag.start), []):
        write_webp(
            replace(single, pulls=lambda _, pulls=pulls: pulls), tmp_path / "a.webp", PictureLook(size=(200, 200))
        )
        with Image.open(tmp_path / "a.webp") as image:
            pixels.append(np.asarray(image.convert("RGBA")).astype(int))
    assert np.abs(pixels[0] - pixels[1]).max() > 50


@pytest.mark.skipif(
    importlib.util.find_spec("imageio_ffmpeg") is None, reason="ffmpeg is missing: pip install 'ldsim[video]'"
)
def test_a_real_video_has_every_frame_in_its_size_and_moves(push: Playback, tmp_path: Path) -> None:
    import imageio_ffmpeg

    path = tmp_path / "a.mp4"
    write_video(replace(push, frames=6), path, MP4, PictureLook(1 / push.frame_seconds, (160, 96), (30, 15)))
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(path)
    assert frames == 6 and seconds == pytest.approx(6 * push.frame_seconds, abs=0.011)  # told to a hundredth
    read = [imageio_ffmpeg.get_ffmpeg_exe(), "-loglevel", "error", "-i", str(path), "-f", "rawvideo"]
    data = subprocess.run([*read, "-pix_fmt", "rgb24", "-"], capture_output=True, check=True).stdout
    pixels = np.frombuffer(data, np.uint8).reshape(6, 96, 160, 3).astype(int)
    assert pixels[0].std() > 10
    assert np.abs(pixels[-1] - pixels[0]).max() > 30


def test_the_ffmpeg_of_the_system_is_given_every_frame(
    push: Playback, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "bin" / "ffmpeg"
    program.parent.mkdir()
    program.write_text(FFMPEG)
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", str(program.parent), prepend=":")
    motion = replace(push, frames=4)
    write_video(motion, tmp_path / "a.mp4", MP4, PictureLook(1 / push.frame_seconds, (120, 80)))
    pixels, _, told = (tmp_path / "a.mp4").read_bytes().rpartition(b"-y -loglevel")
    assert len(pixels) == 4 * 120 * 80 * 3
    assert f"-s 120x80 -r {1 / push.frame_seconds:.6g} -i - -c:v libx264 -pix_fmt yuv420p" in told.decode()
    program.write_text("#!/bin/sh\necho no such codec >&2\nexit 1\n")
    with pytest.raises(ExportError, match="could not write libx264: no such codec"):
        write_video(motion, tmp_path / "b.mp4", MP4)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mp4", "bin"]


def test_a_look_is_refused_where_nothing_is_drawn(run: Run, tmp_path: Path) -> None:
    with pytest.raises(ExportError, match="gltf is no picture; --fps, --size and --view are for webp, mp4, webm"):
        export(run, Choice("gltf", fps=20.0), tmp_path / "a.glb")

"""Every format that a run can be written in. A new one is added by being listed here, and tested by being listed."""

from __future__ import annotations

import importlib.util
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from ldsim.artefacts.atomic import replacing, replacing_folder
from ldsim.errors import ExportError
from ldsim.export.arrays import write_npz, write_safetensors
from ldsim.export.c_library import write_c, write_wasm
from ldsim.export.fmu import write_fmu
from ldsim.export.gltf import write_glb
from ldsim.export.onnx import write_onnx
from ldsim.export.paraview import write_vtu_series, write_xdmf
from ldsim.export.pictures import MP4, WEBM, PictureLook, write_video, write_webp
from ldsim.export.playback import playback
from ldsim.export.playground import write_playground
from ldsim.export.surfaces import write_surfaces
from ldsim.export.usd import write_usd
from ldsim.mesh.formats import read_skin
from ldsim.mesh.skin import Skin
from ldsim.pipeline.options import MeshOptions
from ldsim.run import AUTO, REDUCED, Run
from ldsim.runtime.model_file import portable
from ldsim.space.space import Space


@dataclass(frozen=True)
class Extra:
    """An optional dependency: what is imported, what installs it, and a program of the system that does as well."""

    module: str
    install: str
    program: str = ""

    @property
    def missing(self) -> bool:
        there = importlib.util.find_spec(self.module) is not None
        return not there and not (self.program and shutil.which(self.program))


@dataclass(frozen=True)
class Format:
    """One way to write a run.

    Attributes:
        meaning: what is written, a phrase.
        suffix: of the file; empty for a folder of files.
        motion, model, space: the writer; one of them is given, by what it writes: a motion, all reduced spaces, or one.
        extra: the package that it needs beyond the installed ones.
        drawn: whether it is made of pictures, whose look can be chosen.
    """

    meaning: str
    suffix: str = ""
    motion: Callable[..., None] | None = None
    model: Callable[[Run, Path], None] | None = None
    space: Callable[[Space, Path], None] | None = None
    extra: Extra | None = None
    drawn: bool = False


VIDEO = Extra("imageio_ffmpeg", "pip install 'ldsim[video]', or install ffmpeg", "ffmpeg")
ONNX = Extra("onnx", "pip install 'ldsim[onnx]'")
FORMATS: dict[str, Format] = {
    "vtk": Format("one .vtu a frame and a .pvd with their times, for ParaView", motion=write_vtu_series),
    "xdmf": Format("XDMF with one HDF5 file, for ParaView", motion=write_xdmf),
    "gltf": Format("glTF 2.0 with morph targets, for viewers and game engines", ".glb", motion=write_glb),
    "usd": Format("USD with blend shapes", ".usdc", motion=write_usd, extra=Extra("pxr", "pip install 'ldsim[usd]'")),
    "obj": Format("the surface, one .obj a frame", motion=partial(write_surfaces, suffix="obj")),
    "ply": Format("the surface, one binary .ply a frame", motion=partial(write_surfaces, suffix="ply", binary=True)),
    "webp": Format("an animated picture", ".webp", motion=write_webp, drawn=True),
    "mp4": Format("a video", ".mp4", motion=partial(write_video, codec=MP4), extra=VIDEO, drawn=True),
    "webm": Format("a video", ".webm", motion=partial(write_video, codec=WEBM), extra=VIDEO, drawn=True),
    "npz": Format("the reduced model as NumPy arrays", ".npz", model=write_npz),
    "safetensors": Format("the reduced model as safetensors", ".safetensors", model=write_safetensors),
    "onnx": Format("the decoder and the encoder as networks", model=write_onnx, extra=ONNX),
    "c": Format("the model and the C library that steps it, with an example", space=write_c),
    "wasm": Format("the model and that library as WebAssembly, with an example in JavaScript", space=write_wasm),
    "fmu": Format("functional mock-up units of FMI 2 and 3 for co-simulation, by a C compiler", space=write_fmu),
    "playground": Format("one web page that simulates, without a server", ".html", model=write_playground),
}


@dataclass(frozen=True)
class Choice:
    """What to export; the motion is the run's first where none is named.

    Attributes:
        surface: a file whose surface is drawn in place of the mesh's boundary, with its texture.
    """

    format: str
    motion: str | None = None
    space: str = AUTO
    every: int = 1
    platforms: tuple[str, ...] = ()
    surface: Path | None = None
    fps: float | None = None
    size: tuple[int, int] | None = None
    view: tuple[float, float] | None = None

    @property
    def look(self) -> PictureLook:
        """Of pictures."""
        return PictureLook(self.fps, self.size, self.view)


# What `Choice.platforms` are for: formats that hold compiled code.
COMPILED = {"c": write_c, "fmu": write_fmu}


# What `Choice.surface` is for.
SURFACES = ("gltf", "usd", "obj", "ply")


def own_surface(run: Run, file: Path) -> Skin:
    """The surface of a file, in metres by the scale that the run's mesh was read with.

    Raises:
        MeshError: it cannot be read, or is no surface.
    """
    settings = run.header("scene").settings
    return read_skin(file, MeshOptions.of_dump(settings).scale if settings else 1.0)


def export(run: Run, choice: Choice, output: Path | None = None) -> tuple[Path, str]:
    """Write a run in a format; returns where and what was written.

    Args:
        output: the file or, for formats of several files, the new folder; by default in the run's folder export/.

    Raises:
        ExportError: the format, motion or space is not known, a package is missing, or the output does not suit.
        ArtefactError: an artefact is missing or the output cannot be written.
    """
    if choice.format not in FORMATS:
        raise ExportError(f"unknown format {choice.format!r}; known are {', '.join(FORMATS)}")
    wanted = FORMATS[choice.format]
    if wanted.extra is not None and wanted.extra.missing:
        raise ExportError(
            f"the format {choice.format} needs the package {wanted.extra.module}, which is not installed; "
            f"run {wanted.extra.install}"
        )
    _check_use(choice, wanted)
    write: Callable[[Path], None]
    if wanted.model is not None:
        write, title, what = partial(wanted.model, run), run.folder.resolve().name, "the reduced model"
    elif wanted.space is not None:
        space = run.chosen if choice.space == AUTO else choice.space
        if space not in run.cubature:
            raise ExportError(f"{choice.format} writes a reduced space, got {space!r}; use {' or '.join(REDUCED)}")
        own, apart = portable(run.space(space))
        write, title = partial(wanted.space, own), run.folder.resolve().name
        if choice.platforms:
            write = partial(COMPILED[choice.format], own, platforms=choice.platforms)
        what = f"the model of the {space} space{apart}"
    else:
        assert wanted.motion is not None, "a format writes a motion, a model or a space"
        played = playback(run, choice.motion, choice.space).thinned(choice.every)
        if choice.surface is not None:
            played = replace(played, skin=own_surface(run, choice.surface))
        lost = f", {played.lost} left out because the run diverged" if played.lost else ""
        write, title = partial(wanted.motion, played), played.title
        write = partial(write, look=choice.look) if wanted.drawn else write
        what = f"{played.frames} frames of {played.motion} in the {played.space} space{lost}"
    path = _output(run, wanted, f"{title}{wanted.suffix or '-' + choice.format}", output)
    with replacing(path) if wanted.suffix else replacing_folder(path) as temporary:
        write(temporary)
    return path, what


def _check_use(choice: Choice, wanted: Format) -> None:
    """Refuse what a format has no use for."""
    drawn = [name for name, entry in FORMATS.items() if entry.drawn]
    moving = [name for name, entry in FORMATS.items() if entry.motion is not None]
    one_space = [name for name, entry in FORMATS.items() if entry.model is None]
    given = {
        "draws no surface of your own; --surface is": (choice.surface is not None, [*SURFACES]),
        "holds no compiled code; --platform is": (bool(choice.platforms), [*COMPILED]),
        "is no picture; --fps, --size and --view are": (choice.look != PictureLook(), drawn),
        "plays no motion; --motion and --every are": (choice.motion is not None or choice.every > 1, moving),
        "holds every reduced space; --space is": (choice.space != AUTO, one_space),
    }
    for said, (asked, formats) in given.items():
        if asked and choice.format not in formats:
            raise ExportError(f"{choice.format} {said} for {', '.join(formats)}")


def _output(run: Run, wanted: Format, name: str, output: Path | None) -> Path:
    """Where to write; a folder that someone named is never replaced."""
    if output is None:
        return run.folder / "export" / name
    if wanted.suffix and output.suffix != wanted.suffix:
        raise ExportError(f"the output {output} has the suffix {output.suffix!r}; expected {wanted.suffix!r}")
    if output.is_dir() and wanted.suffix:
        raise ExportError(f"the output {output} is a folder; give the name of a file that ends in {wanted.suffix}")
    if output.exists() and not wanted.suffix:
        raise ExportError(f"the output folder {output} exists already; give the name of a new one")
    return output


def megabytes(path: Path) -> float:
    """The size of what was written, a file or a folder."""
    return sum(file.stat().st_size for file in (path.rglob("*") if path.is_dir() else [path])) / 1e6

"""The files that a configuration names, and what a stage depends on."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from ldsim.errors import SettingsError
from ldsim.options import Options
from ldsim.settings.experiment import Settings
from ldsim.settings.reading import dump

DATA_VARIABLE = "LDSIM_DATA"
DATA_ORIGIN = "its authors publish it in the GitHub repository lawsonfulton/AutoDef"


def stage_settings(settings: Settings, stage: str) -> Options:
    """The section of a stage."""
    section: Options = getattr(settings, stage)
    return section


def resolve_path(text: str, config: Path) -> Path:
    """A path of a configuration: $LDSIM_DATA expanded, relative to the folder of the configuration.

    Raises:
        SettingsError: LDSIM_DATA is used but not set, or the file is not there.
    """
    from_data = DATA_VARIABLE in text
    if from_data:
        root = os.environ.get(DATA_VARIABLE, "")
        if not root:
            raise SettingsError(
                f"{text} needs the environment variable {DATA_VARIABLE}: the folder that holds the paper's meshes/ and "
                f"interactions/; {DATA_ORIGIN}"
            )
        root = str(Path(root).resolve())
        text = text.replace("${" + DATA_VARIABLE + "}", root).replace("$" + DATA_VARIABLE, root)
    path = config.parent / Path(text).expanduser()
    if not path.exists():
        hint = f"; {DATA_VARIABLE} says where the paper's data lie, {DATA_ORIGIN}" if from_data else ""
        raise SettingsError(f"{path} does not exist{hint}")
    return path


def input_files(settings: Settings, stage: str, config: Path) -> list[Path]:
    """The files outside the run that a stage reads."""
    if stage == "mesh":
        surface = settings.mesh.surface
        name = surface.file if surface is not None else settings.mesh.file
        return [] if name is None else [resolve_path(name, config)]
    if stage == "snapshot":
        motions = settings.snapshot.motions
        names = [name for motion in motions for name in (motion.recording, motion.script_file) if name is not None]
        return [resolve_path(name, config) for name in names]
    return []


def stamp(settings: Settings, stage: str, config: Path) -> str:
    """What a stage depends on besides artefacts: its settings and the hashes of its input files, as text."""
    lines = [dump(stage_settings(settings, stage))]
    for path in input_files(settings, stage, config):
        lines.append(f"# {path.name}: {hashlib.sha256(path.read_bytes()).hexdigest()}\n")
    return "".join(lines)

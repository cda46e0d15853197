"""What a stage depends on besides artefacts, which make compares."""

from __future__ import annotations

import hashlib
from pathlib import Path

from ldsim.artefacts.atomic import replacing
from ldsim.pipeline.files import resolve_path
from ldsim.settings.experiment import STAGES, Settings

# What the stage snapshot writes to tests.h5 depends on motions that make nothing else stale.
TESTS = "tests"


def input_files(settings: Settings, stage: str, base: Path) -> list[Path]:
    """The files outside the run that a stage reads; `base` is the folder of the configuration."""
    names = {
        "mesh": settings.mesh.input_files,
        "snapshot": settings.snapshot.learned.input_files,
        "tests": settings.snapshot.tests.input_files,
    }
    return [resolve_path(name, base) for name in names.get(stage, ())]


def stamp(settings: Settings, stage: str, base: Path) -> str:
    """The settings of a stage and the hashes of its input files, as text."""
    files, sections = (
        input_files(settings, stage, base),
        {"snapshot": settings.snapshot.learned, "tests": settings.snapshot.tests},
    )
    section = sections[stage] if stage in sections else settings.section(stage)
    return section.dump() + "".join(
        f"# {path.name}: {hashlib.sha256(path.read_bytes()).hexdigest()}\n" for path in files
    )


def write_stamps(settings: Settings, base: Path, folder: Path) -> None:
    """Write the stamp of every stage into a folder, touching only those that changed."""
    texts = {folder / f"{stage}.yaml": stamp(settings, stage, base) for stage in (*STAGES, TESTS)}
    for path, text in texts.items():
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            with replacing(path) as temporary:
                temporary.write_text(text, encoding="utf-8")

"""A reduced model as functional mock-up units: FMI 2.0 and 3.0 co-simulation around the C library.

ldsim/runtime/fmu.c implements both interfaces; what is written here is the modelDescription.xml of each, so value
references must be those of that file.
"""

from __future__ import annotations

import tempfile
import uuid
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from ldsim import __version__
from ldsim.runtime import source
from ldsim.runtime.compilers import HERE, PLATFORMS, shared_library
from ldsim.runtime.model_file import model_bytes
from ldsim.space.space import Space

GRABS, TRACKS = 4, 4
GRAVITY, NOVELTY, GRAB, TRACK, PER_GRAB, PER_TRACK = 1, 4, 100, 300, 20, 10
# Of a grab that is held the library changes nothing but the target: to take it anew is to hold other vertices.
TAKEN = "when held becomes true"
# Both are read from the same zip: the unit's library must bear the name of its model.
IDENTIFIER = "ldsim_solid"
UNITS = {
    "m": {"m": "1"},
    "N": {"kg": "1", "m": "1", "s": "-2"},
    "N/m": {"kg": "1", "s": "-2"},
    "m/s2": {"m": "1", "s": "-2"},
}
SOURCES = ("ldsim.c", "ldsim.h", "fmu.c")
FMI2_FOLDERS = {"linux-x86_64": "linux64", "windows-x86_64": "win64", "macos-arm64": "darwin64"}


class Variable(NamedTuple):
    """A number, or a boolean, of a unit."""

    reference: int
    name: str
    causality: str
    meaning: str
    start: float | bool | None = None
    unit: str | None = None


def variables(space: Space) -> Iterator[Variable]:
    """All but the time; what a unit starts from is what `begin` of fmu.c sets."""
    scene = space.scene
    far = _far_vertex(space)
    yield from _vector(GRAVITY, "gravity", "input", "gravity", "m/s2", scene.gravity.tolist())
    yield Variable(NOVELTY, "novelty", "output", "distance from the training data, from 1 on beware; -1 if not known")
    for g in range(GRABS):
        at, name = GRAB + PER_GRAB * g, f"grab[{g + 1}]"
        yield Variable(at, f"{name}.held", "input", "whether the solid is held", False)
        yield from _vector(at + 1, f"{name}.target", "input", "where the held vertices are pulled to", "m", far)
        yield from _vector(
            at + 4, f"{name}.point", "input", f"where on the deformed solid hold is taken {TAKEN}", "m", far
        )
        usual = f"0 for the usual one; read {TAKEN}"
        yield Variable(at + 7, f"{name}.stiffness", "input", f"of the pull, {usual}", 0.0, "N/m")
        yield Variable(at + 8, f"{name}.radius", "input", f"within which vertices are held, {usual}", 0.0, "m")
        yield from _vector(at + 9, f"{name}.force", "output", "on the solid", "N")
    for t in range(TRACKS):
        at, name = TRACK + PER_TRACK * t, f"track[{t + 1}]"
        yield from _vector(at, f"{name}.at", "parameter", "the vertex nearest to this at rest is tracked", "m", far)
        yield from _vector(at + 3, f"{name}.position", "output", "where that vertex is", "m")


def _vector(
    reference: int, name: str, causality: str, meaning: str, unit: str, start: Sequence[float] | None = None
) -> Iterator[Variable]:
    for i in range(3):
        value = None if start is None else float(start[i])
        yield Variable(reference + i, f"{name}[{i + 1}]", causality, f"{meaning}, {'xyz'[i]}", value, unit)


def _far_vertex(space: Space) -> Sequence[float]:
    """The vertex farthest from the first pinned one, or from the first one."""
    scene = space.scene
    x = scene.mesh.vertices
    pinned = np.flatnonzero(~scene.movable)
    away = x - x[pinned[0] if len(pinned) else 0]
    # summed as in fmu.c, so that a tie ends the same
    found: list[float] = x[(away[:, 0] ** 2 + away[:, 1] ** 2 + away[:, 2] ** 2).argmax()].tolist()
    return found


def description(space: Space, version: int) -> bytes:
    """modelDescription.xml for FMI 2 or 3."""
    listed = list(variables(space))
    token = str(uuid.uuid5(uuid.NAMESPACE_URL, f"ldsim {__version__} {[tuple(v) for v in listed]}"))
    h = repr(space.scene.time_step)
    root = ElementTree.Element(
        "fmiModelDescription",
        fmiVersion=f"{version}.0",
        modelName="deformable solid",
        generationTool=f"ldsim {__version__}",
        variableNamingConvention="structured",
    )
    root.set("guid" if version == 2 else "instantiationToken", token)
    cosimulation = ElementTree.SubElement(
        root, "CoSimulation", modelIdentifier=IDENTIFIER, canHandleVariableCommunicationStepSize="true"
    )
    names = ("canGetAndSetFMUstate", "canSerializeFMUstate")
    for name in names if version == 2 else (name.replace("FMUstate", "FMUState") for name in names):
        cosimulation.set(name, "true")
    if version == 3:
        cosimulation.set("fixedInternalStepSize", h)
    units = ElementTree.SubElement(root, "UnitDefinitions")
    for name, base in UNITS.items():
        ElementTree.SubElement(ElementTree.SubElement(units, "Unit", name=name), "BaseUnit", base)
    ElementTree.SubElement(root, "DefaultExperiment", startTime="0", stopTime="1", stepSize=h)
    _write_variables(root, listed, version)
    ElementTree.indent(root)
    text: bytes = ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True)
    return text


def _write_variables(root: ElementTree.Element, listed: Sequence[Variable], version: int) -> None:
    held = ElementTree.SubElement(root, "ModelVariables")
    structure = ElementTree.SubElement(root, "ModelStructure")
    outputs = ElementTree.SubElement(structure, "Outputs") if version == 2 else structure
    unknowns = ElementTree.SubElement(structure, "InitialUnknowns") if version == 2 else structure
    if version == 3:
        time = {"name": "time", "valueReference": "0", "causality": "independent", "variability": "continuous"}
        ElementTree.SubElement(held, "Float64", time)
    for place, variable in enumerate(listed, start=1):
        boolean = isinstance(variable.start, bool)
        kind = "Boolean" if boolean else "Real" if version == 2 else "Float64"
        common = {"name": variable.name, "valueReference": str(variable.reference), "causality": variable.causality}
        common["description"] = variable.meaning
        common["variability"] = (
            "discrete" if boolean else "fixed" if variable.causality == "parameter" else "continuous"
        )
        more = {} if variable.unit is None else {"unit": variable.unit}
        if variable.start is not None:
            more["start"] = str(variable.start).lower() if boolean else repr(variable.start)
        if version == 2:
            ElementTree.SubElement(ElementTree.SubElement(held, "ScalarVariable", common), kind, more)
        else:
            ElementTree.SubElement(held, kind, common | more)
        if variable.causality == "output":
            if version == 2:
                for group in (outputs, unknowns):
                    ElementTree.SubElement(group, "Unknown", index=str(place))
            else:
                ElementTree.SubElement(structure, "Output", valueReference=str(variable.reference))
    for variable in listed if version == 3 else ():
        if variable.causality == "output":
            ElementTree.SubElement(structure, "InitialUnknown", valueReference=str(variable.reference))


def write_fmu(space: Space, folder: Path, platforms: Sequence[str] = ()) -> None:
    """Write solid-fmi2.fmu and solid-fmi3.fmu, each with the library for some platforms; this one where none is named.

    Raises:
        ExportError: the library does not know what the space needs.
        SolverError: a platform is not known, or there is no compiler for it.
    """
    wanted = tuple(platforms) or (HERE,)
    folder.mkdir(exist_ok=True)
    model = model_bytes(space)
    for version in (2, 3):
        with (
            zipfile.ZipFile(folder / f"solid-fmi{version}.fmu", "w", zipfile.ZIP_DEFLATED) as unit,
            tempfile.TemporaryDirectory() as scratch,
        ):
            unit.writestr("modelDescription.xml", description(space, version))
            unit.writestr("resources/model.ldsim", model)
            for name in SOURCES:
                unit.writestr(f"sources/{name}", source(name))
            for platform in wanted:
                made = shared_library(
                    Path(scratch), SOURCES, IDENTIFIER, platform, (f"-DFMI={version}", "-fvisibility=hidden")
                )
                entry = PLATFORMS[platform]
                place = FMI2_FOLDERS.get(platform, platform) if version == 2 else entry.fmi3
                unit.write(made, f"binaries/{place}/{IDENTIFIER}{entry.suffix}")

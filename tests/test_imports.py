"""Imports go one way, and each third-party package has its owner."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import ldsim

PACKAGE = Path(ldsim.__file__).parent
MODULES = sorted(PACKAGE.rglob("*.py"))

# The house from the ground up: a room imports from itself and from those before it.
ROOMS = (
    "ldsim",  # the version
    "arrays",
    "errors",
    "options",
    "jit",
    "mesh",
    "optimise",
    "mechanics",
    "cubature.rule",  # what a space is made of; what finds one lies above the space
    "space",
    "cubature",
    "learn",
    "dynamics",
    "artefacts",
    "run",
    "simulator",
    "runtime",
    "pipeline",
    "web",
    "report",
    "export",
    "viewer",
    "settings",
    "cli",
    "__main__",
    "reproduction",
)
OWNERS = {
    "numba": ("jit", "dynamics/reduced/advance", "optimise/lapack"),
    "llvmlite": ("optimise/lapack",),
    "yaml": ("options", "settings"),
    "pydantic": ("options", "settings", "report/schema", "viewer"),
    "pydantic_core": ("report/schema",),
    "h5py": ("artefacts", "export"),
    "torch": ("learn", "dynamics/batched"),
    "meshio": ("mesh/formats", "export"),
    "pyamg": ("optimise/multigrid",),
    "pymetis": ("optimise/elimination",),
    "dask": ("pipeline/dask_cluster",),
    "distributed": ("pipeline/dask_cluster",),
    "pytetwild": ("mesh/ftetwild",),
    "jinja2": ("report",),
    "markupsafe": ("report",),
    "matplotlib": ("report",),
    "PIL": ("report",),
    "onnx": ("export/onnx",),
    "safetensors": ("export/arrays",),
    "click": ("cli",),
    "tqdm": ("cli",),
    "websockets": ("viewer",),
    "threadpoolctl": ("jit",),
    "pxr": ("export/usd",),
    "imageio_ffmpeg": ("export/pictures",),
}
EVERYWHERE = {"numpy", "scipy", "ldsim", "reproduction", *sys.stdlib_module_names}


def room(module: str) -> int:
    """The place of a dotted module in the house: that of the longest name in `ROOMS` that it begins with."""
    own = "ldsim" if module == "ldsim" else module.removeprefix("ldsim.")
    found = [name for name in ROOMS if own == name or own.startswith(f"{name}.")]
    assert found, f"{module} is in no room of the house"
    return ROOMS.index(max(found, key=len))


def module_name(path: Path) -> str:
    parts = ("ldsim", *path.relative_to(PACKAGE).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports(path: Path) -> set[str]:
    """Every module that a file imports, wherever in the file."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively"
            found.add(node.module or "")
    return found


@pytest.mark.parametrize("path", MODULES, ids=module_name)
def test_a_module_imports_only_from_its_room_and_those_below(path: Path) -> None:
    own = room(module_name(path))
    assert not {name for name in imports(path) if name.split(".")[0] in ("ldsim", "reproduction") and room(name) > own}


@pytest.mark.parametrize("path", MODULES, ids=module_name)
def test_a_third_party_package_is_imported_by_its_owner_alone(path: Path) -> None:
    place = path.relative_to(PACKAGE).with_suffix("").as_posix()
    packages = {name.split(".")[0] for name in imports(path)} - EVERYWHERE
    owned = {
        package
        for package in packages
        if any(place == owner or place.startswith(f"{owner}/") for owner in OWNERS.get(package, ()))
    }
    assert not packages - owned


@pytest.mark.parametrize("arguments", [["--help"], ["--version"]], ids=" ".join)
def test_help_imports_nothing_heavy(arguments: list[str]) -> None:
    code = (
        "import sys\n"
        "from ldsim.cli.app import main\n"
        "try:\n"
        f"    main({arguments})\n"
        "except SystemExit:\n"
        "    pass\n"
        "heavy = {'torch', 'numba', 'numpy', 'scipy', 'matplotlib', 'h5py', 'meshio', 'pydantic', 'yaml'}\n"
        "print('heavy:', *sorted(heavy & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "heavy:"


def test_who_only_reads_a_configuration_needs_no_compiler() -> None:
    code = (
        "import sys, ldsim.settings\nprint('heavy:', *sorted({'torch', 'numba', 'scipy', 'h5py'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "heavy:"


def test_what_a_type_checker_is_told_is_there_and_completed() -> None:
    stub = ast.parse((PACKAGE / "__init__.pyi").read_text(encoding="utf-8"))
    told = {alias.asname for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert told == set(ldsim.HOMES) and set(dir(ldsim)) == {"__version__", *told}
    assert all(callable(getattr(ldsim, name)) for name in ldsim.HOMES)

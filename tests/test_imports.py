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

# A layer imports from itself and from the layers it lists, directly or not.
ALLOWED = {
    "errors": [],
    "compiled": [],
    "threads": [],
    "cluster": ["errors"],
    "mesh": ["errors"],
    "mechanics": ["mesh", "compiled"],
    "solvers": ["mechanics"],
    "reduction": ["solvers", "threads"],
    "dynamics": ["reduction"],
    # Artefacts know the plain data types of all numerics, evaluation's included, and nothing that computes with them.
    "artefacts": ["dynamics", "ldsim"],
    "simulator": ["artefacts"],
    # The simulator's level: runs many motions and keeps their frames.
    "ensemble": ["artefacts", "cluster"],
    "evaluation": ["simulator"],
    "export": ["evaluation"],
    "viewer": ["simulator"],
    "settings": ["errors"],
    "cli": ["settings", "ensemble", "evaluation", "export", "viewer"],
    # The package itself holds the version and says where compiled kernels are kept.
    "ldsim": ["compiled"],
    "__main__": ["cli"],
}
NUMERICS = ("errors", "mesh", "mechanics", "solvers", "reduction", "dynamics")
OWNERS = {
    "yaml": ("settings",),
    "pydantic": ("settings",),
    "h5py": ("artefacts", "export"),
    "torch": ("reduction/autoencoder", "dynamics/batched"),
    "meshio": ("mesh/formats", "export"),
    "pyamg": ("solvers/multigrid",),
    "pymetis": ("solvers/elimination",),
    "dask": ("cluster",),
    "distributed": ("cluster",),
    "pytetwild": ("mesh/ftetwild",),
    "matplotlib": ("evaluation",),
    "PIL": ("evaluation",),
    "onnx": ("export/onnx",),
    "click": ("cli",),
    "tqdm": ("cli",),
    "websockets": ("viewer",),
}


def layer(module: str) -> str:
    """The layer of a dotted module: the part after `ldsim.`."""
    parts = module.split(".")
    return parts[1] if len(parts) > 1 else "ldsim"


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


def reachable(start: str) -> set[str]:
    """The layers that a layer may import."""
    seen, todo = set[str](), [start]
    while todo:
        current = todo.pop()
        if current not in seen:
            seen.add(current)
            todo += ALLOWED[current]
    return seen


@pytest.mark.parametrize("path", MODULES, ids=module_name)
def test_a_module_imports_only_from_its_layer_and_those_below(path: Path) -> None:
    own = layer(module_name(path))
    upward = {name for name in imports(path) if name.split(".")[0] == "ldsim" and layer(name) not in reachable(own)}
    assert not upward


@pytest.mark.parametrize("path", MODULES, ids=module_name)
def test_a_third_party_package_is_imported_by_its_owner_alone(path: Path) -> None:
    place = path.relative_to(PACKAGE).with_suffix("").as_posix()
    foreign = {
        name
        for name in imports(path)
        if (owners := OWNERS.get(name.split(".")[0]))
        and not any(place == owner or place.startswith(f"{owner}/") for owner in owners)
    }
    assert not foreign


def test_the_layers_have_no_cycle() -> None:
    for name, below in ALLOWED.items():
        for lower in below:
            assert name not in reachable(lower)


def test_numerics_know_neither_artefacts_nor_settings_nor_commands() -> None:
    for name in NUMERICS:
        assert reachable(name).isdisjoint({"artefacts", "settings", "cli", "evaluation", "ensemble"})


def test_every_module_has_a_layer() -> None:
    assert {layer(module_name(path)) for path in MODULES} <= set(ALLOWED)


@pytest.mark.parametrize("arguments", [["--help"], ["--version"]], ids=" ".join)
def test_help_imports_nothing_heavy(arguments: list[str]) -> None:
    code = (
        "import sys\n"
        "from ldsim.cli.main import main\n"
        "try:\n"
        f"    main({arguments})\n"
        "except SystemExit:\n"
        "    pass\n"
        "heavy = {'torch', 'numba', 'numpy', 'scipy', 'matplotlib', 'h5py', 'meshio', 'pydantic', 'yaml'}\n"
        "print('heavy:', *sorted(heavy & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "heavy:"

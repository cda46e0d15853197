"""What keeps the house small and each thing in one place: names, commands, options, lines."""

from __future__ import annotations

import ast
import importlib
from collections import defaultdict
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path
from typing import Any, NamedTuple, get_args

import pytest
import yaml

import ldsim
from ldsim.cli.app import COMMANDS
from ldsim.options import Options
from ldsim.settings import STAGES, Settings, load_settings

PACKAGE = Path(ldsim.__file__).parent
ROOT = Path(__file__).parent.parent
CONFIGURATIONS = sorted((ROOT / "configs").rglob("*.yaml"))
TREES = {path: ast.parse(path.read_text(encoding="utf-8")) for path in sorted(PACKAGE.rglob("*.py"))}
JAVASCRIPT_LINES, COMMAND_LINES = 2_500, 40


def lines(path: Path) -> int:
    return len(path.read_text(encoding="utf-8").splitlines())


def test_a_public_class_name_means_one_thing() -> None:
    places = defaultdict(list)
    for path, tree in TREES.items():
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(path.relative_to(PACKAGE).as_posix())
    assert not {name: files for name, files in places.items() if len(files) > 1}


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_is_short(command: str) -> None:
    """It parses, makes one call and says what was done."""
    assert lines(PACKAGE / "cli" / f"{command}.py") <= COMMAND_LINES


def test_the_javascript_written_by_hand_stays_small() -> None:
    marked = [line.split() for line in (ROOT / ".gitattributes").read_text(encoding="utf-8").splitlines()]
    generated = [pattern for pattern, *attributes in marked if "linguist-generated" in attributes]
    ours = (path for path in PACKAGE.rglob("*.js") if "node_modules" not in path.parts)  # where npm was called
    scripts = {path.relative_to(ROOT).as_posix(): lines(path) for path in ours}
    by_hand = {name: n for name, n in scripts.items() if not any(fnmatch(name, pattern) for pattern in generated)}
    assert by_hand and sum(by_hand.values()) <= JAVASCRIPT_LINES


for path in PACKAGE.rglob("options.py"):
    importlib.import_module(".".join(("ldsim", *path.relative_to(PACKAGE).with_suffix("").parts)))


def subclasses(of: type[Options]) -> Iterator[type[Options]]:
    for below in of.__subclasses__():
        yield below
        yield from subclasses(below)


class Defaults(NamedTuple):
    """Where names are given defaults: a class with its fields, or a function with its parameters."""

    place: str
    names: frozenset[str]


def defaults(path: Path, node: ast.AST) -> Defaults | None:
    """Those of a class or a function that are written out; None is no default, and a name is another one's value."""
    given: list[tuple[str, ast.expr | None]] = []
    if isinstance(node, ast.ClassDef):
        fields = [line for line in node.body if isinstance(line, ast.AnnAssign) and isinstance(line.target, ast.Name)]
        given = [(ast.unparse(field.target), field.value) for field in fields]
    elif isinstance(node, ast.FunctionDef):
        names = [*node.args.posonlyargs, *node.args.args]
        given = [
            *zip((name.arg for name in names[len(names) - len(node.args.defaults) :]), node.args.defaults, strict=True),
            *zip((name.arg for name in node.args.kwonlyargs), node.args.kw_defaults, strict=True),
        ]
    else:
        return None
    values = frozenset(name for name, value in given if value is not None and written_out(value))
    return Defaults(f"{path.relative_to(PACKAGE)}: {node.name}", values)


def written_out(value: ast.expr) -> bool:
    """Whether a default is a value that stands there itself, and not None."""
    try:
        return ast.literal_eval(value) is not None
    except ValueError:
        return False


def test_options_are_declared_once() -> None:
    """Whoever repeats two options of a class, with defaults of its own, has declared them a second time."""
    options = {
        kind.__name__: {name for name, field in kind.model_fields.items() if not field.is_required()}
        for kind in subclasses(Options)
    }
    found = [
        defaults(path, node)
        for path, tree in TREES.items()
        for node in ast.walk(tree)
        if not (isinstance(node, ast.ClassDef) and node.name in options)
    ]
    twice = {
        f"{other.place} repeats {', '.join(sorted(other.names & names))} of {kind}"
        for other in found
        for kind, names in options.items()
        if other is not None and len(other.names & names) > 1
    }
    assert not twice


@pytest.mark.parametrize("kind", sorted(set(subclasses(Options)), key=lambda kind: kind.__name__))
def test_an_option_says_what_it_is(kind: type[Options]) -> None:
    """In a sentence, or by being options in their turn."""
    fields = kind.model_fields.items()
    assert not [name for name, field in fields if not field.description and not holds_options(field.annotation)]


def holds_options(annotation: Any) -> bool:
    """Whether a type is a class of options or made from one, as a tuple of them is."""
    itself = isinstance(annotation, type) and issubclass(annotation, Options)
    return itself or any(map(holds_options, get_args(annotation)))


@pytest.mark.parametrize("stage", STAGES)
def test_what_is_left_out_of_a_configuration_is_what_python_leaves_out(stage: str) -> None:
    """The section of a stage is the class that Python makes."""
    given = yaml.safe_load((ROOT / "configs" / "ci.yaml").read_text("utf-8"))
    section = Settings.model_fields[stage].annotation
    assert isinstance(section, type) and issubclass(section, Options)
    assert getattr(Settings.model_validate(given), stage) == section(**given.get(stage, {}))


@pytest.mark.parametrize("config", CONFIGURATIONS, ids=lambda path: path.stem)
def test_a_shipped_configuration_is_valid_and_its_dump_gives_the_same_options(config: Path) -> None:
    settings = load_settings(config)
    assert Settings.of_dump(settings.dump()) == Settings.of_dump(settings.dump(defaults=False)) == settings

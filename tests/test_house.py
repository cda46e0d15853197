"""Each option is declared in one place, with a sentence, and means the same in Python and in a configuration."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pytest
import yaml

from ldsim.options import Options
from ldsim.settings import STAGES, Settings, load_settings

ROOT = Path(__file__).parent.parent
CONFIGURATIONS = sorted((ROOT / "configs").glob("*.yaml"))


def subclasses(of: type[Options]) -> Iterator[type[Options]]:
    for below in of.__subclasses__():
        yield below
        yield from subclasses(below)


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
def test_python_and_a_configuration_with_the_same_values_give_the_same_options(config: Path) -> None:
    settings = load_settings(config)
    again = type(settings)(**{name: getattr(settings, name) for name in settings.model_fields_set})
    assert again == settings and again.dump() == settings.dump()

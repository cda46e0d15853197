"""Options: what can be said to a part of the program, declared once, where it is used.

Every class of options is checked when it is made, from Python as from a configuration: same values, same object. A
field is declared with its type, range, default, unit and a sentence:

    tolerance: Annotated[float, Field(gt=0, description="Relative error of the forces.")] = 0.035

`settings/` composes these classes into the sections of a configuration; the reference page, the editor's schema and
the messages about a wrong value come from the declarations.
"""

from __future__ import annotations

import difflib
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic import Field as Field
from pydantic import field_validator as field_validator
from pydantic import model_validator as model_validator

from ldsim.errors import SettingsError

Vector = tuple[float, float, float]
Positive = Annotated[float, Field(gt=0)]
Seed = Annotated[int, Field(ge=0, lt=2**63)]
# What becomes the name of a file and of a group of an artefact.
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-][A-Za-z0-9_.-]*$", max_length=100)]
# No number of a solid, of a motion or of a fit is larger, in any unit; squares and cubes of it stay far from overflow.
LARGEST = 1e15
# A configuration is a page of text; one entry that stands in many places counts in each.
MOST_BYTES, MOST_ENTRIES = 16 << 20, 1_000_000
# Faults named in one message.
MOST_FAULTS = 10
EXTRA = "extra_forbidden"


class Options(BaseModel):
    """Some options that belong together: frozen, unknown names and values that are not finite refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _no_words_for_numbers(cls, given: Any) -> Any:
        """YAML's yes, no, on and off are true and false, which would pass as 1 and 0."""
        for name, field in cls.model_fields.items() if isinstance(given, dict) else ():
            value = given.get(name)
            values = value if isinstance(value, list | tuple) else (value,)
            if any(isinstance(each, bool) for each in values) and "bool" not in str(field.annotation):
                raise ValueError(f"{name} is {value}; expected numbers or words, and yes, no, on and off are neither")
        return given

    @model_validator(mode="after")
    def _of_this_world(self) -> Self:
        for name, value in self:
            for number in value if isinstance(value, tuple) else (value,):
                if isinstance(number, int | float) and abs(number) > LARGEST and "seed" not in name:
                    got = (
                        f"{number:.3g}" if isinstance(number, float) else f"a number of {len(str(abs(number)))} digits"
                    )
                    raise ValueError(f"{name} is {got}; allowed are sizes up to {LARGEST:g}")
        return self

    def replace(self, **changes: Any) -> Self:
        """The same with other values for some, checked as if it were made anew."""
        given = {name: getattr(self, name) for name in self.model_fields_set}
        return type(self)(**given | changes)

    @classmethod
    def of_dump(cls, text: str) -> Self:
        """The options that a dump is of, as the header of an artefact has it.

        Raises:
            SettingsError: it is not one of theirs.
        """
        try:
            content = yaml.safe_load(text) or {}
        except (yaml.YAMLError, ValueError, RecursionError) as error:
            raise SettingsError(
                f"settings of an artefact are not valid YAML: {' '.join(str(error).split())}"
            ) from error
        if not isinstance(content, dict):
            raise SettingsError(f"settings of an artefact are {type(content).__name__}; expected a mapping")
        return checked_options(content, "settings of an artefact", cls)

    def dump(self, defaults: bool = True) -> str:
        """As YAML, with the defaults or with what was given alone; the same text for the same values."""
        content = self.model_dump(mode="json", exclude_unset=not defaults)
        return yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=120)


def as_yaml(content: Mapping[str, Any]) -> str:
    """A configuration as text, short sections on one line."""
    return yaml.safe_dump(dict(content), sort_keys=False, allow_unicode=True, width=100, default_flow_style=None)


def of_yaml(text: str) -> dict[str, Any]:
    """What a dump says, unchecked."""
    return yaml.safe_load(text) or {}


Given = TypeVar("Given", bound=Options)


def exactly_one(*names: str) -> Any:
    """A check in the body of a class of options: of these fields one is given, and only one."""

    def check(self: Given) -> Given:
        if sum(getattr(self, name) is not None for name in names) != 1:
            raise ValueError(f"give exactly one of {', '.join(names)}")
        return self

    return model_validator(mode="after")(check)


def read_options(path: Path, what: str, kind: type[Given]) -> Given:
    """Read and check a YAML file: the options of a configuration, or of a script.

    Raises:
        SettingsError: the file is missing or not YAML, or a key or value is not allowed; one line names each fault
            with its path, what was got and what is allowed.
    """
    try:
        there, folder = path.is_file(), path.is_dir()
    except OSError as error:  # a name that is too long, a folder that may not be searched
        raise SettingsError(f"{what} {path} cannot be read: {error.strerror}; give a file that can be read") from error
    if folder:
        raise SettingsError(f"{what} {path} is a folder; give a YAML file")
    if not there:
        hint = ", and `ldsim new` writes one" if what == "configuration" else ""
        raise SettingsError(f"{what} {path} does not exist; examples lie in configs/{hint}")
    if path.stat().st_size > MOST_BYTES:
        raise SettingsError(f"{what} {path} has {path.stat().st_size} bytes; allowed are {MOST_BYTES}")
    try:
        content = yaml.load(path.read_text(encoding="utf-8"), _Loader)
        _check_extent(content)
    except OSError as error:
        raise SettingsError(f"{what} {path} cannot be read: {error.strerror}; give a file that can be read") from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())
        raise SettingsError(f"{what} {path} is not valid YAML: {reason}") from error
    if content is None:
        raise SettingsError(f"{what} {path} is empty; examples lie in configs/")
    if not isinstance(content, dict):
        raise SettingsError(f"{what} {path} holds {type(content).__name__}; expected a mapping of sections")
    return checked_options(content, f"{what} {path}", kind)


class _Loader(yaml.SafeLoader):
    """Plain YAML in which no key of a mapping is there twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = [(key.tag, key.value) for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
        twice = [key for key, count in Counter(keys).items() if count > 1]
        if twice:
            words = f"the key {twice[0][1]!r} is there twice"
            raise yaml.constructor.ConstructorError(None, None, words, node.start_mark)
        return super().construct_mapping(node, deep)


def _check_extent(content: object) -> None:
    """Refuse what a few aliases of aliases make endless.

    Raises:
        ValueError: it has too many entries.
    """
    waiting, count = [content], 0
    while waiting:
        entry = waiting.pop()
        count += 1
        if count > MOST_ENTRIES:
            raise ValueError(f"it has more than {MOST_ENTRIES} entries, aliases counted as what they stand for")
        waiting += entry.values() if isinstance(entry, dict) else entry if isinstance(entry, list) else ()


def checked_options(content: Mapping[str, Any], source: str, kind: type[Given]) -> Given:
    """The same of what was read, or made, elsewhere; `source` names it in messages."""
    try:
        return kind.model_validate(dict(content))
    except ValidationError as error:
        found = _roots([dict(fault) for fault in error.errors()], kind)
        faults = [_fault(fault, source.split()[0], kind) for fault in found[:MOST_FAULTS]]
        if len(found) > MOST_FAULTS:
            faults.append(f"and {len(found) - MOST_FAULTS} more")
        told = faults[0] if len(faults) == 1 else "\n".join((f"{len(found)} things are wrong", *faults))
        raise SettingsError(f"{source}: {told}") from error


def _roots(found: list[dict[str, Any]], root: type[BaseModel]) -> list[dict[str, Any]]:
    """Without faults that follow from others: a list short of a wrong entry, a key missing that is misspelt."""
    places = [fault["loc"] for fault in found]
    around = {place[:i] for place in places for i in range(len(place))}
    wanted = {fault["loc"] for fault in found if fault["type"] == "missing"}
    unknown = [place for place, fault in zip(places, found, strict=True) if fault["type"] == EXTRA][:MOST_FAULTS]
    spelt = {(*place[:-1], _nearest(place, root)) for place in unknown}
    return [fault for fault in found if fault["loc"] not in around and fault["loc"] not in wanted & spelt]


def _nearest(location: tuple[int | str, ...], root: type[BaseModel]) -> str | None:
    """The known key that an unknown one at a path may be."""
    return next(iter(difflib.get_close_matches(str(location[-1]), _known_keys(location[:-1], root), 1, 0.4)), None)


def _fault(fault: dict[str, Any], what: str, root: type[BaseModel]) -> str:
    """One fault in words: the key's path, what is wrong, what was got, and the nearest known key."""
    where = ".".join(str(step) for step in fault["loc"]) or what
    if fault["type"] == EXTRA:
        near = _nearest(fault["loc"], root)
        known = ", ".join(sorted(_known_keys(fault["loc"][:-1], root)))
        hint = f"known are {known}" if near is None else f"did you mean {near!r}?"
        return f"unknown key {where!r}; {hint}"
    if fault["type"] == "missing":
        return f"{where} is missing"
    given = repr(fault["input"])
    got = "" if isinstance(fault["input"], dict | list) else f", got {given[:60]}{'…' * (len(given) > 60)}"
    message = fault["msg"].removeprefix("Value error, ")
    if fault["type"] == "too_short":
        message = f"give at least {fault['ctx']['min_length']}"
    if fault["type"] == "model_type":
        message = "expected keys and values"
    return f"{where}: {message[:1].lower()}{message[1:]}{got}"


def _known_keys(location: tuple[int | str, ...], root: type[BaseModel]) -> list[str]:
    """The keys of the section at a path; union members and list indices are passed through."""
    sections: list[type[BaseModel]] = [root]
    for step in location:
        if isinstance(step, int):
            continue
        fields = [section.model_fields[step] for section in sections if step in section.model_fields]
        sections = [inner for field in fields for inner in _sections_in(field.annotation)]
    return [key for section in sections for key in section.model_fields]


def _sections_in(annotation: object) -> list[type[BaseModel]]:
    """The sections named anywhere in a type."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [section for inner in getattr(annotation, "__args__", ()) for section in _sections_in(inner)]

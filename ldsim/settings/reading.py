"""Reading and checking a configuration; the only importer of yaml."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ValidationError

from ldsim.errors import SettingsError
from ldsim.settings.experiment import Settings
from ldsim.settings.motions import ScriptSettings

AnySection = TypeVar("AnySection", bound=BaseModel)


def load_settings(path: Path) -> Settings:
    """Read and check a configuration.

    Raises:
        SettingsError: the file is missing or not YAML, or a key or value is not allowed; one line names each fault
            with its path, what was got and what is allowed.
    """
    if not path.is_file():
        raise SettingsError(f"configuration {path} does not exist; examples lie in configs/")
    return _validated(path, "configuration", Settings)


def load_script(path: Path) -> ScriptSettings:
    """Read and check a script of a motion; see `load_settings`."""
    return _validated(path, "script", ScriptSettings)


def _validated(path: Path, what: str, section: type[AnySection]) -> AnySection:
    """The content of a YAML file as a section."""
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        reason = " ".join(str(error).split())
        raise SettingsError(f"{what} {path} is not valid YAML: {reason}") from error
    if content is None:
        raise SettingsError(f"{what} {path} is empty; examples lie in configs/")
    if not isinstance(content, dict):
        raise SettingsError(f"{what} {path} holds {type(content).__name__}; expected a mapping of sections")
    return _checked(content, str(path), what, section)


def settings_of(content: Mapping[str, Any], source: str) -> Settings:
    """Check a configuration that was read, or made, elsewhere; `source` names it in messages.

    Raises:
        SettingsError: as `load_settings`.
    """
    return _checked(content, source, "configuration", Settings)


def _checked(content: Mapping[str, Any], source: str, what: str, section: type[AnySection]) -> AnySection:
    try:
        return section.model_validate(dict(content))
    except ValidationError as error:
        faults = "; ".join(_fault(dict(fault), what, section) for fault in error.errors())
        raise SettingsError(f"{what} {source}: {faults}") from error


def _fault(fault: dict[str, Any], what: str, root: type[BaseModel]) -> str:
    """One fault in words: the key's path, what is wrong, what was got, and the nearest known key."""
    where = ".".join(str(part) for part in fault["loc"]) or what
    if fault["type"] == "extra_forbidden":
        known = _known_keys(fault["loc"][:-1], root)
        near = difflib.get_close_matches(str(fault["loc"][-1]), known, n=1, cutoff=0.4)
        hint = f"did you mean {near[0]!r}?" if near else f"known are {', '.join(sorted(known))}"
        return f"unknown key {where!r}; {hint}"
    if fault["type"] == "missing":
        return f"{where} is missing"
    got = "" if isinstance(fault["input"], dict | list) else f", got {fault['input']!r}"
    message = fault["msg"].removeprefix("Value error, ")
    return f"{where}: {message[:1].lower()}{message[1:]}{got}"


def _known_keys(location: tuple[int | str, ...], root: type[BaseModel]) -> list[str]:
    """The keys of the section at a path; union members and list indices are passed through."""
    sections: list[type[BaseModel]] = [root]
    for part in location:
        if isinstance(part, int):
            continue
        fields = [section.model_fields[part] for section in sections if part in section.model_fields]
        sections = [inner for field in fields for inner in _sections_in(field.annotation)]
    return [key for section in sections for key in section.model_fields]


def _sections_in(annotation: object) -> list[type[BaseModel]]:
    """The sections named anywhere in a type."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [section for inner in getattr(annotation, "__args__", ()) for section in _sections_in(inner)]


def dump(section: BaseModel, defaults: bool = True) -> str:
    """A section as YAML, with its defaults or with what was given alone, the same text for the same values."""
    content = section.model_dump(mode="json", exclude_unset=not defaults)
    text: str = yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=120)
    return text

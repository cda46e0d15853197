"""What the page says to the server: small JSON messages, each refused unless it is exactly what it should be."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, get_args

from ldsim.errors import LdsimError

MAX_BYTES = 4096

Vector = tuple[float, float, float]


class ProtocolError(LdsimError):
    """A message that the page never sends."""


@dataclass(frozen=True)
class Grab:
    """Take hold of the material point of a displayed space nearest to `point` at rest, or deformed in a recording."""

    id: int
    point: Vector
    target: Vector


@dataclass(frozen=True)
class Move:
    """Pull a grab to another target."""

    id: int
    target: Vector


@dataclass(frozen=True)
class Release:
    """Let a grab go."""

    id: int


@dataclass(frozen=True)
class Gravity:
    """Gravity from now on, m/s²."""

    value: Vector


@dataclass(frozen=True)
class Stiffness:
    """What the moduli are multiplied by from now on."""

    value: float


@dataclass(frozen=True)
class Speed:
    """Simulated seconds a second."""

    value: float


@dataclass(frozen=True)
class Pause:
    """Stop, or go on."""

    value: bool


@dataclass(frozen=True)
class Step:
    """One time step while paused."""


@dataclass(frozen=True)
class Reset:
    """Back to rest."""


@dataclass(frozen=True)
class Spaces:
    """Which spaces to show side by side, by name."""

    value: tuple[str, ...]


@dataclass(frozen=True)
class Colour:
    """What the colour shows."""

    value: str


@dataclass(frozen=True)
class Record:
    """Start a recording from rest, or end it and write it."""

    value: bool


@dataclass(frozen=True)
class Replay:
    """Play the last recording back from rest, or stop doing so."""

    value: bool


Message = Grab | Move | Release | Gravity | Stiffness | Speed | Pause | Step | Reset | Spaces | Colour | Record | Replay
KINDS: dict[str, type[Message]] = {kind.__name__.lower(): kind for kind in get_args(Message)}


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or abs(value) > 1e6:
        raise ValueError
    return float(value)


def _integer(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < 2**31:
        raise ValueError
    return value


def _flag(value: Any) -> bool:
    if not isinstance(value, bool):
        raise ValueError
    return value


def _word(value: Any) -> str:
    if not isinstance(value, str) or not 0 < len(value) <= 40:
        raise ValueError
    return value


def _vector(value: Any) -> Vector:
    if not isinstance(value, list) or len(value) != 3:
        raise ValueError
    x, y, z = (_number(entry) for entry in value)
    return x, y, z


def _words(value: Any) -> tuple[str, ...]:
    if not isinstance(value, list) or not 0 < len(value) <= 8:
        raise ValueError
    return tuple(_word(entry) for entry in value)


READERS: dict[str, Callable[[Any], Any]] = {
    "int": _integer,
    "float": _number,
    "bool": _flag,
    "str": _word,
    "Vector": _vector,
    "tuple[str, ...]": _words,
}


def parse(text: str | bytes) -> Message:
    """A message from its JSON.

    Raises:
        ProtocolError: it is binary, too long, not JSON, of an unknown kind, or its fields are not what they should be.
    """
    if isinstance(text, bytes) or len(text) > MAX_BYTES:
        raise ProtocolError("a message must be text of at most 4096 characters")
    try:
        content = json.loads(text)
        kind = KINDS[content.pop("kind")]
        values = {entry.name: READERS[str(entry.type)](content.pop(entry.name)) for entry in fields(kind)}
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ProtocolError(f"not a message of the page: {text[:80]!r}") from error
    if content:
        raise ProtocolError(f"a message of {kind.__name__.lower()} has no field {next(iter(content))!r:.60}")
    return kind(**values)

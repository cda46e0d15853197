"""What the page says to the server: small JSON messages, each refused unless it is exactly what it should be."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from ldsim.errors import LdsimError

MAX_BYTES = 4096

Number = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]
Place = tuple[Number, Number, Number]
Key = Annotated[int, Field(ge=0, lt=2**31)]
Word = Annotated[str, Field(min_length=1, max_length=100)]


class ProtocolError(LdsimError):
    """A message that the page never sends."""


class PageMessage(BaseModel):
    """What all messages are: frozen, of exact types, without further fields; `kind` tells them apart."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class GrabMessage(PageMessage):
    """Take hold of the material point of a displayed space nearest to `point` at rest, or deformed in a recording."""

    kind: Literal["grab"] = "grab"
    id: Key
    point: Place
    target: Place


class MoveMessage(PageMessage):
    """Pull a grab to another target."""

    kind: Literal["move"] = "move"
    id: Key
    target: Place


class ReleaseMessage(PageMessage):
    """Let a grab go."""

    kind: Literal["release"] = "release"
    id: Key


class GravityMessage(PageMessage):
    """Gravity from now on, m/s²."""

    kind: Literal["gravity"] = "gravity"
    value: Place


class NumberMessage(PageMessage):
    """What the moduli are multiplied by from now on, or simulated seconds a second."""

    kind: Literal["stiffness", "speed"]
    value: Number


class SwitchMessage(PageMessage):
    """Pause or go on; record from rest, or end and write it; play a motion from rest, or stop that."""

    kind: Literal["pause", "record", "replay"]
    value: bool


class ButtonMessage(PageMessage):
    """One time step while paused, back to rest, or back to before the last pull."""

    kind: Literal["step", "reset", "undo"]


class SpacesMessage(PageMessage):
    """Which spaces to show side by side, by name."""

    kind: Literal["spaces"] = "spaces"
    value: Annotated[tuple[Word, ...], Field(min_length=1, max_length=8)]


class WordMessage(PageMessage):
    """What the colour shows; the motion or take to play; a take to delete."""

    kind: Literal["colour", "take", "discard"]
    value: Word


Message = (
    GrabMessage | MoveMessage | ReleaseMessage | GravityMessage | NumberMessage | SwitchMessage | ButtonMessage
    | SpacesMessage | WordMessage
)  # fmt: skip
ANY: TypeAdapter[Message] = TypeAdapter(Annotated[Message, Field(discriminator="kind")])


def parse(text: str | bytes) -> Message:
    """A message from its JSON.

    Raises:
        ProtocolError: it is binary, too long, not JSON, of an unknown kind, or its fields are not what they should be.
    """
    if isinstance(text, bytes) or len(text) > MAX_BYTES:
        raise ProtocolError("a message must be text of at most 4096 characters")
    try:
        return ANY.validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(key) for key in first["loc"][1:])
        raise ProtocolError(f"not a message of the page: {text[:80]!r} ({where} {first['msg'].lower()})") from error
    except (ValueError, OverflowError, RecursionError) as error:  # numbers of hundreds of digits, deep brackets
        raise ProtocolError(f"not a message of the page: {text[:80]!r} ({type(error).__name__})") from error

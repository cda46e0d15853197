"""Messages of the page, and everything that is none."""

from __future__ import annotations

import json
import typing
from dataclasses import asdict

import pytest

from ldsim.viewer import protocol
from ldsim.viewer.protocol import KINDS, ProtocolError, parse

GOOD: list[protocol.Message] = [
    protocol.Grab(3, (0.0, 1.5, -2.0), (1.0, 2.0, 3.0)),
    protocol.Move(3, (1.0, 2.0, 3.0)),
    protocol.Release(3),
    protocol.Gravity((0.0, -9.8, 0.0)),
    protocol.Stiffness(2.5),
    protocol.Speed(0.1),
    protocol.Pause(True),
    protocol.Step(),
    protocol.Reset(),
    protocol.Spaces(("latent", "full")),
    protocol.Colour("stress"),
    protocol.Record(True),
    protocol.Replay(False),
]
BAD = {
    "not JSON": "pull!",
    "nothing": "",
    "a list": "[]",
    "a number": "7",
    "no kind": "{}",
    "an unknown kind": '{"kind": "delete"}',
    "a kind that is no name": '{"kind": ["grab"]}',
    "a field missing": '{"kind": "move", "id": 1}',
    "a field too many": '{"kind": "reset", "id": 1}',
    "text for a number": '{"kind": "speed", "value": "1"}',
    "a flag for a number": '{"kind": "speed", "value": true}',
    "a number for a flag": '{"kind": "pause", "value": 1}',
    "not finite": '{"kind": "speed", "value": NaN}',
    "infinite": '{"kind": "gravity", "value": [0, -Infinity, 0]}',
    "immense": '{"kind": "gravity", "value": [0, -1000001, 0]}',
    "too few numbers": '{"kind": "gravity", "value": [0, 1]}',
    "a negative id": '{"kind": "release", "id": -1}',
    "a fractional id": '{"kind": "release", "id": 1.5}',
    "no spaces": '{"kind": "spaces", "value": []}',
    "too many spaces": json.dumps({"kind": "spaces", "value": ["latent"] * 9}),
    "a long word": json.dumps({"kind": "colour", "value": "x" * 41}),
    "deeply nested": "[" * 2000 + "]" * 2000,
    "too long": json.dumps({"kind": "colour", "value": "x" * 5000}),
    "binary": b"\x00\x01",
}


def test_every_kind_of_message_is_tried_here() -> None:
    assert {type(message) for message in GOOD} == set(KINDS.values()) == set(typing.get_args(protocol.Message))


@pytest.mark.parametrize("message", GOOD, ids=lambda message: type(message).__name__)
def test_a_message_is_what_was_sent(message: protocol.Message) -> None:
    assert parse(json.dumps({"kind": type(message).__name__.lower(), **asdict(message)})) == message


@pytest.mark.parametrize("case", BAD)
def test_what_is_no_message_is_refused(case: str) -> None:
    with pytest.raises(ProtocolError):
        parse(BAD[case])

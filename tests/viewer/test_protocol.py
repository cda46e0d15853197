"""Messages of the page, and everything that is none."""

from __future__ import annotations

import json
import typing

import pytest

from ldsim.viewer import protocol
from ldsim.viewer.protocol import ProtocolError, parse

GOOD: list[protocol.Message] = [
    protocol.GrabMessage(id=3, point=(0.0, 1.5, -2.0), target=(1.0, 2.0, 3.0)),
    protocol.MoveMessage(id=3, target=(1.0, 2.0, 3.0)),
    protocol.ReleaseMessage(id=3),
    protocol.GravityMessage(value=(0.0, -9.8, 0.0)),
    protocol.NumberMessage(kind="stiffness", value=2.5),
    protocol.NumberMessage(kind="speed", value=0.1),
    protocol.SwitchMessage(kind="pause", value=True),
    protocol.ButtonMessage(kind="step"),
    protocol.ButtonMessage(kind="reset"),
    protocol.ButtonMessage(kind="undo"),
    protocol.SpacesMessage(value=("latent", "full")),
    protocol.WordMessage(kind="colour", value="stress"),
    protocol.WordMessage(kind="take", value="motion-2"),
    protocol.WordMessage(kind="discard", value="motion"),
    protocol.SwitchMessage(kind="record", value=True),
    protocol.SwitchMessage(kind="replay", value=False),
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
    "a long word": json.dumps({"kind": "colour", "value": "x" * 101}),
    "deeply nested": "[" * 2000 + "]" * 2000,
    "too long": json.dumps({"kind": "colour", "value": "x" * 5000}),
    "binary": b"\x00\x01",
}


def test_every_kind_of_message_is_tried_here() -> None:
    kinds = [typing.get_args(each.model_fields["kind"].annotation) for each in typing.get_args(protocol.Message)]
    assert {message.kind for message in GOOD} == {kind for some in kinds for kind in some}


@pytest.mark.parametrize("message", GOOD, ids=lambda message: message.kind)
def test_a_message_is_what_was_sent(message: protocol.Message) -> None:
    assert parse(json.dumps(message.model_dump())) == message


@pytest.mark.parametrize("case", BAD)
def test_what_is_no_message_is_refused(case: str) -> None:
    with pytest.raises(ProtocolError):
        parse(BAD[case])

"""Attacks on the page's server: each is turned away, and a healthy page is served at once afterwards."""

from __future__ import annotations

import json
import socket
import time
from urllib.parse import urlsplit

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, WebSocketException

from ldsim.viewer.protocol import ProtocolError, parse
from ldsim.viewer.server import MAX_PAGES, MAX_TEXTS, Client
from reproduction.faults.page import KINDS, VALUES
from tests.viewer.served import joined
from tests.viewer.test_server import next_frame, status_of
from tests.viewer.test_server import url as url

MESSAGES = {
    "an integer of 400 digits": '{"kind": "grab", "id": ' + "9" * 400 + ', "point": [0,0,0], "target": [0,0,0]}',
    "a number of 400 digits": '{"kind": "speed", "value": ' + "9" * 400 + "}",
    "an exponent": '{"kind": "speed", "value": 1e999}',
    "deep brackets": "[" * 4000,
    "a surrogate": '{"kind": "colour", "value": "\\ud800"}',
    "letters of several bytes": '{"kind": "' + "ü€😀" * 100 + '"}',
    "not a number": '{"kind": "speed", "value": NaN}',
    "a key twice": '{"kind": "step", "kind": "reset", "id": 1}',
    "nothing": "",
}


@pytest.mark.parametrize("case", MESSAGES)
def test_a_message_made_to_do_harm_is_refused(case: str) -> None:
    with pytest.raises(ProtocolError) as caught:
        parse(MESSAGES[case])
    assert len(str(caught.value)) < 1000


@pytest.mark.parametrize("case", MESSAGES)
def test_such_a_message_closes_its_page_and_no_other(url: str, case: str) -> None:
    with joined(url) as healthy, joined(url) as page:
        page.send(MESSAGES[case])
        with pytest.raises(ConnectionClosed) as closed:
            for _ in range(10_000):
                page.recv(timeout=30)
        assert closed.value.rcvd is not None and closed.value.rcvd.code == 1008
        assert next_frame(healthy)


@pytest.mark.parametrize("header", ["Host: attacker.example", "Host: {netloc}", "Host:", "Host: \xff"])
def test_two_hosts_are_refused(url: str, header: str) -> None:
    parts = urlsplit(url)
    request = f"GET {parts.path} HTTP/1.1\r\nHost: {parts.netloc}\r\n{header.format(netloc=parts.netloc)}\r\n\r\n"
    with socket.create_connection((parts.hostname or "", parts.port or 0), timeout=30) as raw:
        raw.sendall(request.encode("latin-1"))
        assert raw.recv(100).startswith((b"HTTP/1.1 403", b"HTTP/1.1 400"))
    assert status_of(url) == 200


def test_bytes_that_are_no_request_leave_the_page_as_it_was(url: str) -> None:
    parts, rng = urlsplit(url), np.random.default_rng(5)
    for size in (1, 10, 100, 10_000, 200_000):
        with socket.create_connection((parts.hostname or "", parts.port or 0), timeout=30) as raw:
            try:
                raw.sendall(rng.bytes(size))
                raw.shutdown(socket.SHUT_WR)
                raw.recv(100)
            except OSError:
                pass
    assert status_of(url) == 200


def test_messages_drawn_at_random_never_silence_the_page(url: str) -> None:
    rng = np.random.default_rng(6)
    for _ in range(150):
        with joined(url) as page:
            try:
                for _ in range(rng.integers(1, 8)):
                    words: dict[str, object] = {"kind": KINDS[rng.integers(len(KINDS))]}
                    fields = ["id", "point", "target", "value"]
                    picked = rng.permutation(fields)[: rng.integers(0, 5)]
                    page.send(json.dumps(words | {name: VALUES[rng.integers(len(VALUES))] for name in picked}))
            except WebSocketException:
                pass
    with joined(url) as page:
        page.send('{"kind": "reset"}')
        page.send('{"kind": "pause", "value": false}')
        assert next_frame(page)


def deaf(url: str) -> socket.socket:
    """A page that will read nothing, not even the frame that closes it."""
    parts = urlsplit(url)
    page = socket.create_connection((parts.hostname or "", parts.port or 0), timeout=30)
    page.sendall(
        f"GET {parts.path}socket HTTP/1.1\r\nHost: {parts.netloc}\r\nOrigin: http://{parts.netloc}\r\n"
        "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n".encode()
    )
    assert page.recv(12) == b"HTTP/1.1 101"
    return page


def test_pages_that_are_thrown_out_make_room_at_once(url: str) -> None:
    rude = [deaf(url) for _ in range(MAX_PAGES)]
    for page in rude:
        page.sendall(b"\x81\x81\0\0\0\0{")  # a text of one letter, masked by zeros (RFC 6455)
    started = time.monotonic()
    while time.monotonic() - started < 9:
        try:
            with joined(url) as page:
                assert next_frame(page)
                break
        except WebSocketException:
            time.sleep(0.05)
    assert time.monotonic() - started < 9
    for page in rude:
        page.close()


def test_texts_for_a_page_that_does_not_read_do_not_pile_up() -> None:
    client = Client(1)
    for number in range(10 * MAX_TEXTS):
        client.texts.append(str(number))
    assert client.take() == [str(number) for number in range(9 * MAX_TEXTS, 10 * MAX_TEXTS)]
    assert client.take() == []

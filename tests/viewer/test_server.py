"""The server: what it hands out and to whom, and that a page's departure frees it."""

from __future__ import annotations

import asyncio
import http.client
import json
import socket
import struct
import time
import urllib.error
import urllib.request
import webbrowser
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from ldsim.mechanics.motion import Drag, Motion
from ldsim.simulator import load
from ldsim.viewer.payload import FRAME
from ldsim.viewer.playground import play_server, record_server
from ldsim.viewer.recorder import Recorder
from ldsim.viewer.server import Client, Server, ServerError, hosts_at
from ldsim.viewer.serving import serve
from tests.helpers import wait_until
from tests.simulator.playable import K, solid
from tests.viewer.served import joined, origin, served


@pytest.fixture(scope="module")
def url(playable: Path) -> Iterator[str]:
    with served(play_server(playable, ["latent"], 0, until_closed=False)) as address:
        yield address


def fetch(url: str, **headers: str) -> bytes:
    with urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=30) as answer:
        body: bytes = answer.read()
        return body


def status_of(url: str, **headers: str) -> int:
    try:
        fetch(url, **headers)
    except urllib.error.HTTPError as error:
        return error.code
    return 200


def next_of(page: Any, kind: str) -> dict[str, Any]:
    """The next text message of a kind."""
    while True:
        message = page.recv(timeout=60)
        if isinstance(message, str) and (content := json.loads(message))["kind"] == kind:
            return dict(content)


def next_frame(page: Any) -> bytes:
    while True:
        message = page.recv(timeout=60)
        if isinstance(message, bytes) and message[0] == FRAME:
            return message


def coordinates(frame: bytes) -> np.ndarray:
    (count,) = struct.unpack_from("<I", frame, 24)
    return np.frombuffer(frame, "<f4", count, 60)


def block(content: bytes) -> dict[str, Any]:
    (length,) = struct.unpack_from("<I", content)
    header: dict[str, Any] = json.loads(content[4 : 4 + length])
    at = 4 + length
    for entry in header["arrays"]:
        values = np.frombuffer(content, np.dtype(entry["type"]), int(np.prod(entry["shape"])), at)
        header[entry["name"]] = values.reshape(entry["shape"])
        at += values.nbytes
    assert at == len(content)
    return header


def test_the_page_and_all_its_files_are_handed_out(url: str) -> None:
    page = fetch(url).decode()
    for name in ("app.js", "style.css"):
        assert f'"{name}"' in page
        assert len(fetch(url + name)) > 1000
    assert status_of(url + "session.py") == status_of(url + "../server.py") == 404


def test_without_the_token_there_is_nothing(url: str) -> None:
    base = origin(url)
    for path in ("/", "/app.js", "/solid", "/x/solid", "/" + "a" * 32 + "/", "//", "/%00/"):
        assert status_of(base + path) == 403
    with pytest.raises(InvalidStatus, match="403"), joined(f"{base}/wrong/", origin=base):
        pass


@pytest.mark.parametrize("foreign", ["http://example.org", "null", "https://127.0.0.1:1", None])
def test_a_foreign_page_gets_no_socket(url: str, foreign: str | None) -> None:
    with pytest.raises(InvalidStatus, match="403"), joined(url, origin=foreign):
        pass


def test_a_name_that_only_points_here_is_refused(url: str) -> None:
    assert status_of(url, Host="attacker.example") == 403
    assert status_of(url, Host=f"localhost:{urlsplit(url).port}") == 200


def test_at_the_port_of_http_a_browser_need_not_say_it() -> None:
    assert {"127.0.0.1", "localhost", "127.0.0.1:80"} < set(hosts_at(80))
    assert set(hosts_at(8080)) == {"127.0.0.1:8080", "localhost:8080"}


def test_the_address_without_its_last_slash_leads_to_the_page(url: str) -> None:
    parts = urlsplit(url)
    connection = http.client.HTTPConnection(str(parts.hostname), parts.port, timeout=30)
    connection.request("GET", f"{parts.path.rstrip('/')}?yaw=1")
    answer = connection.getresponse()
    assert (answer.status, answer.getheader("Location")) == (308, f"{parts.path}?yaw=1")
    connection.close()
    assert fetch(url.rstrip("/")) == fetch(url)


def test_only_the_loopback_address_is_listened_on(url: str) -> None:
    parts = urlsplit(url)
    assert parts.hostname == "127.0.0.1"
    with pytest.raises(OSError), socket.create_connection(("127.0.0.2", parts.port or 0), timeout=5):
        pass


@pytest.mark.parametrize(
    ("message", "code"), [("{", 1008), (b"\x01\x02", 1008), ('{"kind": "step", "x": 1}', 1008), ("x" * 100_000, 1009)]
)
def test_a_message_that_the_page_never_sends_ends_the_connection(url: str, message: str | bytes, code: int) -> None:
    with joined(url) as page:
        page.send(message)
        with pytest.raises(ConnectionClosed) as closed:
            for _ in range(10_000):
                page.recv(timeout=60)
    assert closed.value.rcvd is not None and closed.value.rcvd.code == code
    with joined(url) as another:
        assert next_frame(another)


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS"])
def test_a_request_that_is_no_get_is_not_answered_with_the_page(url: str, method: str) -> None:
    parts = urlsplit(url)
    request = f"{method} {parts.path} HTTP/1.1\r\nHost: {parts.netloc}\r\nContent-Length: 3\r\n\r\nabc"
    with socket.create_connection((parts.hostname, parts.port), timeout=30) as raw:
        raw.sendall(request.encode())
        assert not raw.recv(100).startswith(b"HTTP/1.1 2")


def test_what_is_decoded_from_the_blocks_is_the_surface_of_the_api(playable: Path, url: str) -> None:
    sim = load(playable)
    solid, space = block(fetch(url + "solid")), block(fetch(url + "space/latent"))
    np.testing.assert_array_equal(solid["triangles"], sim.surface.triangles)
    np.testing.assert_array_equal(solid["pinned"], sim.scene.pinned[sim.surface.vertices])
    sim.step(30)
    decoded = solid["rest"] + space["basis"] @ sim.coordinates
    expected = (sim.scene.mesh.vertices + sim.displacement())[sim.surface.vertices]
    np.testing.assert_allclose(decoded, expected, atol=1e-6)
    points = space["point_rest"] + space["point_basis"] @ sim.coordinates
    nodes = sim.scene.points.nodes[sim.space.rule.points]
    moved = sim.scene.mesh.vertices + sim.displacement()
    np.testing.assert_allclose(points, moved[nodes].mean(axis=1), atol=1e-6)


def test_a_frame_is_small_and_holds_what_the_api_says(playable: Path, url: str) -> None:
    sim = load(playable)
    tip = sim.surface.rest[sim.surface.rest[:, 0].argmax()]
    target = (tip + [0, 0.05, 0]).tolist()
    with joined(url) as page:
        for message in (
            {"kind": "pause", "value": True},
            {"kind": "reset"},
            {"kind": "gravity", "value": [0, 0, 0]},
            {"kind": "grab", "id": 7, "point": tip.tolist(), "target": target},
            *[{"kind": "step"}] * 12,
            {"kind": "colour", "value": "plain"},
        ):
            page.send(json.dumps(message))
        while next_of(page, "status")["gravity"] != [0, 0, 0]:
            pass
        sim.gravity = (0, 0, 0)
        sim.grab(tip, target, at_rest=True)
        sim.step(12)
        end = time.monotonic() + 30
        while not np.allclose(coordinates(frame := next_frame(page)), sim.coordinates, atol=1e-6):
            assert time.monotonic() < end
        assert len(frame) <= 4096
        assert len(coordinates(frame)) == K and np.abs(sim.coordinates).max() > 1e-3
        (id,) = struct.unpack_from("<I", frame, 60 + 4 * K)
        assert id == 7
        np.testing.assert_allclose(np.frombuffer(frame, "<f4", 3, 64 + 4 * K), target, rtol=1e-6)
        page.send('{"kind": "gravity", "value": [0, -9.81, 0]}')
        page.send('{"kind": "pause", "value": false}')


def test_what_cannot_be_done_is_said_and_nothing_breaks(url: str) -> None:
    with joined(url) as page:
        for message, words in (
            ({"kind": "grab", "id": 1, "point": [99, 0, 0], "target": [0, 0, 0]}, "hits no vertex"),
            ({"kind": "spaces", "value": ["fluid"]}, "offered are latent, linear, full"),
            ({"kind": "colour", "value": "smell"}, "known are plain"),
            ({"kind": "record", "value": True}, "nothing is recorded here"),
            ({"kind": "replay", "value": True}, "nothing to play: there is no motion yet"),
        ):
            page.send(json.dumps(message))
            assert words in next_of(page, "notice")["text"]
        page.send('{"kind": "move", "id": 99, "target": [0, 0, 0]}')
        page.send('{"kind": "release", "id": 99}')
        assert next_frame(page)


def test_a_motion_for_another_solid_ends_its_playback_and_is_told(tmp_path: Path) -> None:
    drag = Drag(3, np.array([9.0, 0.0, 0.0]), np.full((4, 3), 9.0), 0.01, 30.0)
    recorder = Recorder(tmp_path / "m.csv", (30.0, 0.01), {}, Motion("foreign", 10, (drag,)))
    with served(record_server(solid(1), "beam", recorder, 0, until_closed=False)) as url, joined(url) as page:
        page.send('{"kind": "pause", "value": false}')
        page.send('{"kind": "replay", "value": true}')
        text = next_of(page, "notice")["text"]
        assert text.startswith("the playback ends: the grab at frame 3 hits no vertex")
        assert "check that the motion belongs to this mesh" in text
        assert next_frame(page) and not recorder.player.playing


def test_spaces_stand_side_by_side_and_each_has_its_block(url: str) -> None:
    with joined(url) as page:
        page.send('{"kind": "spaces", "value": ["latent", "linear", "full"]}')
        while next_of(page, "status")["spaces"] != ["latent", "linear", "full"]:
            pass
        assert [block(fetch(url + f"space/{name}"))["k"] for name in ("latent", "linear", "full")] == [9, 6, 0]
        while next_frame(page)[1] != 3:
            pass
        page.send('{"kind": "spaces", "value": ["latent"]}')
        while next_of(page, "status")["spaces"] != ["latent"]:
            pass


def test_a_page_that_leaves_lets_go_and_the_solid_stands_still(playable: Path) -> None:
    server = play_server(playable, ["latent"], 0, until_closed=False)
    with served(server) as url:
        tip = load(playable).surface.rest[-1].tolist()
        with joined(url) as page:
            page.send(json.dumps({"kind": "grab", "id": 1, "point": tip, "target": [0, 1, 0]}))
            wait_until(lambda: next_frame(page)[2] == 1)
        with joined(url) as page:
            wait_until(lambda: next_frame(page)[2] == 0)
        session = server._session
        wait_until(lambda: not session._watched.is_set())
        time.sleep(0.3)
        number = session._number
        time.sleep(0.5)
        assert session._number == number


def test_a_server_until_closed_ends_by_itself(playable: Path) -> None:
    server = play_server(playable, ["latent"], 0, until_closed=True)
    with served(server) as url:
        with joined(url) as page:
            next_frame(page)
        wait_until(server._ended.is_set)


def test_the_grace_begins_anew_when_a_page_came_and_left_again(monkeypatch: pytest.MonkeyPatch) -> None:
    session: Any = SimpleNamespace(tell=lambda *_: True, unwatch=lambda: None)
    server, ends = Server(session, b"", until_closed=True), list[Callable[[], None]]()
    loop = SimpleNamespace(call_later=lambda _, call, *given: ends.append(partial(call, *given)))
    monkeypatch.setattr(asyncio, "get_running_loop", lambda: loop)
    for number in (1, 2):
        server._clients.add(page := Client(number))
        server._leave(page)
    first, second = ends
    first()
    assert not server._ended.is_set()
    second()
    assert server._ended.is_set()


def test_a_browser_in_the_foreground_gets_its_page(playable: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As one of a terminal does, it keeps whoever opens it waiting until it ends."""
    server, answers = play_server(playable, ["latent"], 0, until_closed=False), list[int]()
    loops: list[asyncio.AbstractEventLoop] = []

    def told(text: str) -> None:
        if text.startswith("http"):
            loops.append(asyncio.get_running_loop())

    def opened(address: str) -> bool:
        with urllib.request.urlopen(address, timeout=30) as answer:
            answers.append(answer.status)
        loops[0].call_soon_threadsafe(server.end)  # from here alone it would not wake the loop
        return True

    monkeypatch.setattr(webbrowser, "open", opened)
    serve(server, browser=True, tell=told, warn=str)
    assert answers == [200]


def test_a_space_that_is_named_twice_is_shown_once(playable: Path) -> None:
    session = play_server(playable, ["linear", "auto", "latent", "linear"], 0, until_closed=False)._session
    assert [simulator.space.name for simulator in session._shown] == ["linear", "latent"]


def test_a_port_in_use_is_told(playable: Path, url: str) -> None:
    port = urlsplit(url).port
    server: Server = play_server(playable, ["latent"], port or 0, until_closed=False)
    with pytest.raises(ServerError, match=f"port {port}: it is in use; choose another with --port"), served(server):
        pass

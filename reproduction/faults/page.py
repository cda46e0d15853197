"""Attacks on the page: messages, bytes, requests, floods, pages that do not read. A healthy page works after each."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import socket
import time
from collections.abc import Callable
from urllib.parse import urlsplit

import numpy as np
from websockets.exceptions import WebSocketException
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from ldsim.viewer.playground import play_server
from reproduction.faults.alone import fork, starved
from reproduction.faults.artefacts import Found
from reproduction.faults.bench import EXPERIMENTS, Bench

KINDS = "grab move release gravity stiffness speed pause record replay step reset undo spaces colour x".split()
VALUES: tuple[object, ...] = (
    0, 1e6, -1e6, 1e308, 10**400, True, "", "\ud800", [0, 0, 0], [1e6, -1e6, 1e6], [1e308] * 3, ["latent"],
    ["full", "linear"], ["full", "full"], [], {}, "strain", "plain", None,
)  # fmt: skip
RAW = ("[" * 4000, "", "{", '{"kind": "' + "ü€😀" * 100 + '"}', '{"kind": "speed", "value": NaN}', "null", "9" * 5000)
HEADERS = (
    "Host: attacker.example", "Host: {netloc}", "Host:", "Host: \xff", "Origin: http://attacker.example",
    "Origin: null", "Content-Length: 99999999999", "Transfer-Encoding: chunked", "X: " + "x" * 100_000,
    "Upgrade: websocket", ": :",
)  # fmt: skip
PATHS = (
    "{path}", "/", "{path}..", "{path}../../../../etc/passwd", "{path}%2e%2e/", "//", "{path}socket", "{path}solid",
    "\x00", "/" + "a" * 9000,
)  # fmt: skip
# Faults that a page may meet where it is turned away, and within how many seconds a healthy one must have its frames.
TURNED_AWAY = (WebSocketException, OSError, TimeoutError)
HEALTHY = 20.0


class Page:
    """The server in a process of its own."""

    def __init__(self, bench: Bench, name: str) -> None:
        reading, writing = os.pipe()

        def serve() -> str:
            server = play_server(bench.whole / name, ["latent"], 0, until_closed=False)
            asyncio.run(server.run(lambda url: os.write(writing, url.encode() + b"\n")))
            return "ended"

        self.process, _ = fork([serve], ())
        os.close(writing)
        with os.fdopen(reading) as told:
            self.url = told.readline().strip()
        self.parts = urlsplit(self.url)

    def joined(self) -> ClientConnection:
        origin = Origin(f"{self.parts.scheme}://{self.parts.netloc}")
        address = self.url.replace("http", "ws", 1) + "socket"
        return connect(address, origin=origin, open_timeout=HEALTHY, close_timeout=1, max_size=None)

    def raw(self) -> socket.socket:
        return socket.create_connection((self.parts.hostname or "", self.parts.port or 0), timeout=10)

    def health(self) -> str:
        """What a healthy page sees: frames that move on, once it has asked for them."""
        started, why = self._clock(), ""
        while self._clock() - started < HEALTHY:
            try:
                with self.joined() as page:
                    page.send('{"kind": "reset"}')
                    page.send('{"kind": "pause", "value": false}')
                    frames = 0
                    while frames < 5 and self._clock() - started < HEALTHY:
                        frames += isinstance(page.recv(timeout=HEALTHY), bytes)
                return "healthy"
            except TURNED_AWAY as error:
                why = repr(error)
                time.sleep(0.1)
        done, status = os.waitpid(self.process, os.WNOHANG)
        return f"crash: {status}" if done else f"hang: {why}"

    def _clock(self) -> float:
        """Seconds that do not count where this process or the server waited for a processor that others had."""
        return time.monotonic() - starved(self.process) - starved("self")

    def end(self) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process, signal.SIGKILL)
            os.waitpid(self.process, 0)


def messages(page: Page, rng: np.random.Generator) -> None:
    """Messages drawn at random, well formed or not."""
    for _ in range(20):
        with contextlib.suppress(*TURNED_AWAY), page.joined() as client:
            for _ in range(rng.integers(1, 12)):
                words: dict[str, object] = {"kind": KINDS[rng.integers(len(KINDS))]}
                fields = rng.permutation(["id", "point", "target", "value"])[: rng.integers(0, 5)]
                words |= {str(name): VALUES[rng.integers(len(VALUES))] for name in fields}
                client.send(RAW[rng.integers(len(RAW))] if rng.random() < 0.05 else json.dumps(words))


def pulls(page: Page, rng: np.random.Generator) -> None:
    """Grabs that are well formed and violent, in every space."""
    with contextlib.suppress(*TURNED_AWAY), page.joined() as client:
        client.send(json.dumps({"kind": "spaces", "value": list(rng.permutation(["full", "linear", "latent"])[:2])}))
        client.send(json.dumps({"kind": "stiffness", "value": float(10.0 ** rng.uniform(-3, 3))}))
        for number in range(int(rng.integers(1, 9))):
            point, target = rng.normal(size=3) * 0.1, rng.normal(size=3) * 10.0 ** rng.uniform(-2, 6)
            client.send(json.dumps({"kind": "grab", "id": number, "point": list(point), "target": list(target)}))
        for _ in range(60):
            target = list(rng.normal(size=3) * 10.0 ** rng.uniform(-2, 6))
            client.send(json.dumps({"kind": "move", "id": int(rng.integers(9)), "target": target}))
            client.send(json.dumps({"kind": "gravity", "value": list(rng.normal(size=3) * 10.0 ** rng.uniform(0, 4))}))
            client.recv(timeout=5)


def noise(page: Page, rng: np.random.Generator) -> None:
    """Bytes that are no request."""
    for _ in range(30):
        with contextlib.suppress(*TURNED_AWAY), page.raw() as raw:
            raw.sendall(rng.bytes(int(10 ** rng.uniform(0, 5.5))))
            raw.shutdown(socket.SHUT_WR)
            raw.recv(100)


def requests(page: Page, rng: np.random.Generator) -> None:
    """Requests with paths and headers of others; none is answered with what only the token and one host open."""
    for _ in range(30):
        path = PATHS[rng.integers(1, len(PATHS))].format(path=page.parts.path)
        headers = [HEADERS[i].format(netloc=page.parts.netloc) for i in rng.integers(0, len(HEADERS), 2)]
        text = f"GET {path} HTTP/1.1\r\nHost: {page.parts.netloc}\r\n" + "".join(f"{line}\r\n" for line in headers)
        with contextlib.suppress(*TURNED_AWAY), page.raw() as raw:
            raw.sendall(text.encode("latin-1", "replace") + b"\r\n")
            answer = raw.recv(4000)
            without = not path.startswith(page.parts.path) or any(line.startswith("Host") for line in headers)
            stolen = b"root:" in answer or (without and b" 200 " in answer[:20])
            assert not stolen, f"answered {answer[:80]!r} to {text[:200]!r}"


def flood(page: Page, rng: np.random.Generator) -> None:
    """A giant frame, thousands of messages at once, and more pages than there is room for."""
    with contextlib.suppress(*TURNED_AWAY), page.joined() as client:
        client.send(rng.bytes(int(10 ** rng.uniform(3, 7))))
        client.recv(timeout=5)
    with contextlib.suppress(*TURNED_AWAY), page.joined() as client:
        for _ in range(5000):
            client.send('{"kind": "reset"}')
    with contextlib.ExitStack() as stack:
        for _ in range(40):
            with contextlib.suppress(*TURNED_AWAY):
                stack.enter_context(page.raw())


def deaf(page: Page, rng: np.random.Generator) -> None:
    """Pages that do not read, and some that end without a word."""
    clients = []
    for _ in range(6):
        with contextlib.suppress(*TURNED_AWAY):
            clients.append(page.joined())
    for client in clients:
        with contextlib.suppress(*TURNED_AWAY):
            client.send('{"kind": "colour", "value": "strain"}')
    time.sleep(float(rng.uniform(0, 2)))
    for client in clients:
        client.socket.close()


ATTACKS: tuple[Callable[[Page, np.random.Generator], None], ...] = (messages, pulls, noise, requests, flood, deaf)
_PAGES: dict[str, Page] = {}


def page(bench: Bench, rng: np.random.Generator) -> Found:
    """One attack on the page of a run, then a healthy page."""
    name = str(rng.choice(EXPERIMENTS))
    if name not in _PAGES:
        _PAGES[name] = Page(bench, name)
    attack = ATTACKS[int(rng.integers(len(ATTACKS)))]
    try:
        attack(_PAGES[name], rng)
        said = _PAGES[name].health()
    except AssertionError as error:
        said = f"outside: {error}"
    if said != "healthy":
        _PAGES.pop(name).end()
    yield "attacks on the page", said, f"{attack.__name__} on {name}"


def end() -> None:
    """End the servers."""
    for served in _PAGES.values():
        served.end()
    _PAGES.clear()

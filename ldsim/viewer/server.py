"""The server of the page: its files, its data and its socket, on the loopback address and behind a token."""

from __future__ import annotations

import asyncio
import errno
import json
import secrets
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from ldsim import web
from ldsim.errors import LdsimError
from ldsim.viewer.protocol import MAX_BYTES, ProtocolError, parse
from ldsim.viewer.session import Session
from ldsim.viewer.state import Audience

ADDRESS = "127.0.0.1"
# A page that is closed and not opened again for so long has left.
GRACE = 3.0
MAX_PAGES = 8
# Texts kept for a page that does not read, the newest; bytes of the reason in a frame that closes a socket (RFC 6455).
MAX_TEXTS, MAX_REASON = 100, 123
HTML = web.playground('<link rel="stylesheet" href="style.css">', '<script src="app.js"></script>')
PAGE = {
    "": (HTML, "text/html; charset=utf-8"),
    "app.js": (web.bundle("playground"), "text/javascript; charset=utf-8"),
    "style.css": (web.playground_style(), "text/css; charset=utf-8"),
}


class ServerError(LdsimError):
    """The server cannot listen."""


@dataclass(eq=False)
class Client:
    """One page: what waits to be sent to it. A frame or colour not sent yet is replaced by the next."""

    number: int
    frame: bytes | None = None
    colours: dict[int, bytes] = field(default_factory=dict)
    texts: deque[str] = field(default_factory=lambda: deque(maxlen=MAX_TEXTS))
    news: asyncio.Event = field(default_factory=asyncio.Event)

    def take(self) -> list[str | bytes]:
        """What waits, which then no longer does."""
        waiting: list[str | bytes] = [*self.texts, *self.colours.values()]
        if self.frame is not None:
            waiting.append(self.frame)
        self.texts.clear()
        self.colours, self.frame = {}, None
        self.news.clear()
        return waiting


def hosts_at(port: int) -> tuple[str, ...]:
    """What a browser may call this machine at a port; it leaves out that of HTTP."""
    hosts = (f"{ADDRESS}:{port}", f"localhost:{port}")
    return (*hosts, ADDRESS, "localhost") if port == 80 else hosts


class Server:
    """Serves one session to the pages of this machine.

    Args:
        solid: the block of the solid (`payload.solid_block`).
        port: 0 for any that is free.
        until_closed: end when the last page has been closed.
    """

    def __init__(self, session: Session, solid: bytes, port: int = 0, until_closed: bool = False) -> None:
        self._session, self._solid, self._port, self._until_closed = session, solid, port, until_closed
        self._left = 0  # how often the last page has left
        self._token = secrets.token_urlsafe(24)
        self._clients: set[Client] = set()
        self._served = 0
        self._hosts: tuple[str, ...] = ()
        self._ended = asyncio.Event()

    async def run(self, ready: Callable[[str], object]) -> None:
        """Serve until `end`; `ready` is given the address of the page.

        Raises:
            ServerError: the port is taken, or not allowed.
        """
        loop = asyncio.get_running_loop()
        stepping = threading.Thread(target=self._session.run, name="stepping", daemon=True)
        try:
            listening = await serve(
                self._talk,
                ADDRESS,
                self._port,
                process_request=self._answer,
                max_size=MAX_BYTES,
                compression=None,
                ping_interval=None,  # a page that is busy drawing is not gone, and one that is gone closes its socket
                server_header=None,
                close_timeout=2.0,
            )
        except (OSError, OverflowError) as error:
            taken = isinstance(error, OSError) and error.errno == errno.EADDRINUSE
            reason = "it is in use" if taken else str(error)
            raise ServerError(
                f"cannot listen on port {self._port}: {reason}; choose another with --port, or 0 for any that is free"
            ) from error
        port = listening.sockets[0].getsockname()[1]
        self._hosts = hosts_at(port)
        self._audience = Audience(
            lambda frame: loop.call_soon_threadsafe(self._send_frame, frame),
            lambda space, colours: loop.call_soon_threadsafe(self._send_colours, space, colours),
            lambda status: loop.call_soon_threadsafe(self._send_text, json.dumps(status)),
            lambda text: loop.call_soon_threadsafe(self._send_text, json.dumps({"kind": "notice", "text": text})),
        )
        stepping.start()
        try:
            async with listening:
                ready(f"http://{ADDRESS}:{port}/{self._token}/")
                await self._ended.wait()
        finally:
            self._session.stop()
            await asyncio.to_thread(stepping.join, 5.0)

    @property
    def farewell(self) -> str:
        """What is to be said when `run` has ended; empty where there is nothing."""
        return self._session.farewell

    def end(self) -> None:
        """Stop serving; in the thread that serves, for another one would not wake it."""
        self._ended.set()

    # Plain requests

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """The page's files and blocks; None lets the socket through."""
        path, mark, asked = request.path.partition("?")
        token, slash, name = path.removeprefix("/").partition("/")
        hosts = request.headers.get_all("Host")
        if (
            len(hosts) != 1
            or hosts[0] not in self._hosts
            or not secrets.compare_digest(token.encode(), self._token.encode())
        ):
            return _response(403, "Forbidden", b"open the address that ldsim printed\n")
        if not slash:  # the page asks for its files beside it
            return _response(308, "Permanent Redirect", b"", Location=f"/{token}/{mark}{asked}")
        if name == "socket":
            return self._admit(request)
        if name in PAGE:
            text, kind = PAGE[name]
            return _response(200, "OK", text.encode(), kind)
        block = self._solid if name == "solid" else self._session.blocks.get(name.removeprefix("space/"))
        if block is None:
            return _response(404, "Not Found", b"no such thing\n")
        return _response(200, "OK", block, "application/octet-stream")

    def _admit(self, request: Request) -> Response | None:
        """Only a page of this server, and not too many of them."""
        origins = request.headers.get_all("Origin")
        if len(origins) != 1 or origins[0] not in [f"http://{host}" for host in self._hosts]:
            return _response(403, "Forbidden", b"the socket is for the page of this server\n")
        if len(self._clients) >= MAX_PAGES:
            return _response(503, "Service Unavailable", b"too many pages are open\n")
        return None

    # The socket

    async def _talk(self, connection: ServerConnection) -> None:
        self._served += 1
        client = Client(self._served)
        self._clients.add(client)
        sending = asyncio.create_task(_send(connection, client))
        try:
            self._send_text(json.dumps(self._session.status()))
            self._session.watch(self._audience)
            async for text in connection:
                reason = self._obeyed(client, text)
                if reason:
                    self._leave(client)  # now: a page that does not answer holds its place until the close times out
                    await connection.close(1008, reason.encode()[:MAX_REASON].decode(errors="ignore"))
                    break
        except ConnectionClosed:
            pass
        finally:
            sending.cancel()
            self._leave(client)

    def _obeyed(self, client: Client, text: str | bytes) -> str:
        """Pass a message on; returns why it was not, or nothing."""
        try:
            message = parse(text)
        except ProtocolError as error:
            return str(error)
        return "" if self._session.tell(client.number, message) else "too many messages"

    def _leave(self, client: Client) -> None:
        if client not in self._clients:
            return
        self._clients.discard(client)
        self._session.tell(client.number, None)
        if not self._clients:
            self._session.unwatch()
            if self._until_closed:
                self._left += 1
                asyncio.get_running_loop().call_later(GRACE, self._end_if_alone, self._left)

    def _end_if_alone(self, left: int) -> None:
        """Unless somebody came, or came and left again, since the last page left."""
        if not self._clients and left == self._left:
            self.end()

    def _send_frame(self, frame: bytes) -> None:
        for client in self._clients:
            client.frame = frame
            client.news.set()

    def _send_colours(self, space: int, colours: bytes) -> None:
        for client in self._clients:
            client.colours[space] = colours
            client.news.set()

    def _send_text(self, text: str) -> None:
        for client in self._clients:
            client.texts.append(text)
            client.news.set()


async def _send(connection: ServerConnection, client: Client) -> None:
    """Send whatever waits, as fast as the page takes it."""
    try:
        while True:
            await client.news.wait()
            for message in client.take():
                await connection.send(message)
    except ConnectionClosed:
        pass


def _response(status: int, reason: str, body: bytes, kind: str = "text/plain; charset=utf-8", **more: str) -> Response:
    headers = Headers(
        {
            "Content-Type": kind,
            "Content-Length": str(len(body)),
            "Connection": "close",
            "Cache-Control": "no-store",
            "Content-Security-Policy": "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; "
            "connect-src 'self' ws://127.0.0.1:* ws://localhost:*; "
            "frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
            **more,
        }
    )
    return Response(status, reason, headers, body)

"""A server in a thread of its own, for the length of a test."""

from __future__ import annotations

import asyncio
import contextlib
import queue
import threading
from collections.abc import Iterator
from typing import Any
from urllib.parse import urlsplit

from websockets.sync.client import ClientConnection, connect

from ldsim.viewer.server import Server


@contextlib.contextmanager
def served(server: Server) -> Iterator[str]:
    """The address of the page; the server has ended, thread and all, when the block has."""
    told: queue.Queue[str | BaseException] = queue.Queue()
    loop = asyncio.new_event_loop()

    def serve() -> None:
        asyncio.set_event_loop(loop)
        try:
            loop.run_until_complete(server.run(told.put))
        except BaseException as error:
            told.put(error)
        finally:
            loop.close()

    thread = threading.Thread(target=serve)
    thread.start()
    address = told.get(timeout=60)
    if isinstance(address, BaseException):
        thread.join()
        raise address
    try:
        yield address
    finally:
        with contextlib.suppress(RuntimeError):  # it may have ended by itself
            loop.call_soon_threadsafe(server.end)
        thread.join(timeout=60)
        assert not thread.is_alive()


def origin(url: str) -> str:
    """scheme://host:port of an address."""
    parts = urlsplit(url)
    return f"{parts.scheme}://{parts.netloc}"


def joined(url: str, **changes: object) -> ClientConnection:
    """The socket of a page, as a browser opens it."""
    given: dict[str, Any] = {"origin": origin(url), "open_timeout": 30, "max_size": None} | changes
    found: ClientConnection = connect(url.replace("http", "ws", 1) + "socket", **given)
    return found

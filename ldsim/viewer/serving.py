"""Serving a page until it is closed or interrupted."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import threading
import webbrowser
from collections.abc import Callable

from ldsim.jit import one_thread
from ldsim.viewer.server import Server

Tell = Callable[[str], None]


def serve(server: Server, browser: bool, tell: Tell, warn: Tell) -> None:
    """Serve until interrupted, or until the page is closed where the server was told so.

    Args:
        browser: whether to open the page in one.
        tell, warn: what take the address of the page and what became of a recording, and what went wrong with the
            browser.
    """
    with one_thread(), contextlib.suppress(KeyboardInterrupt):
        asyncio.run(_serve(server, browser, tell, warn))
    if server.farewell:
        tell(server.farewell)
    tell("stopped")


async def _serve(server: Server, browser: bool, tell: Tell, warn: Tell) -> None:
    if threading.current_thread() is threading.main_thread():  # no other thread can take signals
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            with contextlib.suppress(NotImplementedError):  # on Windows, where Ctrl+C interrupts the loop itself
                loop.add_signal_handler(number, server.end)
    opening: list[threading.Thread] = []

    def announce(url: str) -> None:
        tell(f"{url}\npull the solid there; press Ctrl+C here to stop")
        if browser:  # one that runs in the foreground keeps whoever opens it waiting, and itself waits for the page
            opening.append(threading.Thread(target=_open, args=(url, warn), daemon=True))
            opening[0].start()

    await server.run(announce)
    for thread in opening:
        thread.join(1.0)


def _open(url: str, warn: Tell) -> None:
    opened = False
    with contextlib.suppress(webbrowser.Error):
        opened = webbrowser.open(url)
    if not opened:
        warn("no browser could be started here; open the address above in one")

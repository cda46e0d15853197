"""What `play` and `record` share: serving a page until it is closed or interrupted."""

from __future__ import annotations

import asyncio
import signal
import threading
import webbrowser

import click

from ldsim.jit import one_thread
from ldsim.viewer.server import Server

port_option = click.option("--port", type=click.IntRange(0, 65535), default=0, help="0 for any that is free.")
browser_option = click.option("--browser/--no-browser", default=True, help="Open the page in the browser.")
until_closed_option = click.option("--until-closed", is_flag=True, help="End when the page is closed.")


def serve(server: Server, browser: bool) -> None:
    """Serve until interrupted, or until the page is closed where the server was told so."""
    with one_thread():
        asyncio.run(_serve(server, browser))
    click.echo("stopped")


async def _serve(server: Server, browser: bool) -> None:
    if threading.current_thread() is threading.main_thread():  # no other thread can take signals
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, server.end)
    await server.run(lambda url: _announce(url, browser))


def _announce(url: str, browser: bool) -> None:
    click.echo(f"{url}\npull the solid there; press Ctrl+C here to stop")
    if browser and not _opened(url):
        click.echo("no browser could be started here; open the address above in one", err=True)


def _opened(url: str) -> bool:
    try:
        return webbrowser.open(url)
    except webbrowser.Error:
        return False

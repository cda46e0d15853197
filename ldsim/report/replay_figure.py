"""The replay as an element of the page: hidden until the page's script shows it."""

from __future__ import annotations

from ldsim.report.html import Markup, element
from ldsim.report.replay import Replay

# Multiples of real time.
SPEEDS = {"real time": "1", "half": "0.5", "a quarter": "0.25", "a tenth": "0.1"}


def replay_figure(replay: Replay) -> Markup:
    """The figure with its data."""
    canvas = element(
        "canvas",
        class_="canvas",
        tabindex="0",
        role="img",
        aria_label="The deformed solid in each space. Drag or arrow keys turn it, plus and minus zoom, space plays.",
    )
    pulls = Markup('<svg class="pulls" aria-hidden="true"></svg>')
    stage = element("div", canvas, pulls, element("div", class_="panels"), class_="stage")
    key = element(
        "p",
        "distance to full space: 0 ",
        element("i", class_="bar"),
        " ",
        element("output", class_="limit"),
        " and more",
        class_="key-bar",
    )
    hint = "Drag to turn; a wheel (after a click) or two fingers zoom. "
    return element(
        "figure",
        stage,
        _controls(),
        key,
        element("figcaption", hint, replay.caption),
        element("script", Markup(replay.data), type="application/json", class_="data"),
        class_="replay",
        hidden="",
    )


def _controls() -> Markup:
    speeds = (element("option", name, value=value) for name, value in SPEEDS.items())
    return element(
        "div",
        element("button", "Play", type="button", class_="play"),
        element("input", type="range", class_="scrub", min="0", value="0", aria_label="Time"),
        element("output", class_="time"),
        element("label", "Motion ", element("select", class_="motion")),
        element("label", "Speed ", element("select", *speeds, class_="speed")),
        element("button", "Reset view", type="button", class_="home"),
        class_="controls",
    )

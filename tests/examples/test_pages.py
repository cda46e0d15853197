"""The example that is a page: pulled at with the pointer, it draws what the library called from Python steps to."""

from __future__ import annotations

import functools
import http.server
import re
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from ldsim.mechanics.scene import Scene
from ldsim.runtime.library import NativeModel, NativeSolid
from tests.examples.conftest import EXAMPLES
from tests.viewer.browser import CHROMIUM, chromium

needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
needs_three = pytest.mark.skipif(
    not (EXAMPLES / "threejs" / "node_modules" / "three").is_dir(),
    reason="three is not installed: npm install --no-package-lock in examples/threejs",
)
# Time goes on by the frames that a test asks for, and every step is counted.
BY_HAND = """
window.steps = 0;
performance.now = () => 0;
window.requestAnimationFrame = (frame) => { window.frame = frame; return 1; };
"""
COUNT = "{ const step = solid.step; solid.step = () => { steps++; return step.call(solid); }; }"
# The corner towards the camera: which vertex, where it is, and where on the screen.
TIP = """
(() => {
  const x = mesh.geometry.attributes.position.array, along = (v) => x[3 * v] + x[3 * v + 1] + x[3 * v + 2];
  let tip = 0;
  for (let v = 0; v < model.vertices; v++) if (along(v) > along(tip)) tip = v;
  const at = target.clone().fromArray(x, 3 * tip), seen = at.clone().project(camera);
  return [tip, ...at.toArray(), (seen.x + 1) / 2 * innerWidth, (1 - seen.y) / 2 * innerHeight];
})()
"""


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: object) -> None:
        pass


@pytest.fixture
def address(root: Path) -> Iterator[str]:
    """Of the page, its files copied beside the export by its own commands."""
    page = (EXAMPLES / "threejs" / "index.html").read_text("utf-8")
    _, copy, enter, install, serve = re.findall(r"^     (\w.+)$", page.partition("-->")[0], re.M)
    assert (copy, install, serve) == (
        "cp examples/threejs/* runs/demo/export/demo-wasm",
        "npm install",
        "python3 -m http.server",
    )
    folder = root / enter.removeprefix("cd ")
    for name in ("index.html", "package.json"):
        shutil.copy(EXAMPLES / "threejs" / name, folder)
    (folder / "node_modules").symlink_to(EXAMPLES / "threejs" / "node_modules")
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=folder)) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/index.html"
        server.shutdown()


@needs_three
@needs_chromium
def test_a_pull_in_the_three_js_page_ends_where_python_ends(
    address: str, model: NativeModel, scene: Scene, tmp_path: Path
) -> None:
    with chromium() as tab:
        tab.size(900, 600)
        tab.call("Page.addScriptToEvaluateOnNewDocument", source=BY_HAND)
        tab.open(address)
        tab.wait("window.solid !== undefined && window.frame !== undefined")
        tab.evaluate(f"frame(0); {COUNT}")  # cameras know where they are once they have drawn
        tip, *point, left, top = tab.evaluate(TIP)
        tab.mouse("mousePressed", (left - 4, top + 4))
        tab.mouse("mouseMoved", (left + 40, top - 150))
        target = tab.evaluate("target.toArray()")
        for frame in range(1, 101):
            tab.evaluate(f"frame({16 * frame} + 1e-6)")
        drawn = tab.evaluate("Array.from(mesh.geometry.attributes.position.array)")
        steps = tab.evaluate("steps")
        tab.picture(tmp_path / "pulled.png")
        tab.mouse("mouseReleased", (left + 40, top - 150))
        for frame in range(101, 103):
            tab.evaluate(f"frame({16 * frame})")
        let_go = tab.evaluate("[steps, ...mesh.geometry.attributes.position.array]")
        assert not tab.complaints
    solid = NativeSolid(model)
    pull = solid.grab(scene.mesh.vertices[tip], target)
    np.testing.assert_allclose(point, scene.mesh.vertices[tip], atol=1e-6)
    assert steps == round(1.6 / scene.time_step) and let_go[0] > steps
    for count, positions in ((steps, drawn), (let_go[0] - steps, let_go[1:])):
        for _ in range(count):
            solid.step()
        expected = scene.mesh.vertices + solid.displacements()
        np.testing.assert_allclose(np.reshape(positions, (-1, 3)), expected, rtol=0, atol=1e-6)
        if count == steps:
            solid.release(pull)

"""Running the page's solid.js, and with it the library as WebAssembly, in node and in Chromium."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

import ldsim.runtime
import ldsim.web
from tests.viewer.browser import CHROMIUM, chromium

NODE = shutil.which("node")
SOLID = Path(ldsim.web.__file__).parent / "src" / "solid.js"
LIBRARY = Path(ldsim.runtime.__file__).parent / "ldsim.wasm"
PREPARED = f"""
import {{ readFileSync }} from "node:fs";
import {{ Model, Solid, runtimeOf }} from {json.dumps(SOLID.as_uri())};
const runtime = await runtimeOf(new Uint8Array(readFileSync({json.dumps(str(LIBRARY))})));
const unpacked = (text) => new Model(runtime, new Uint8Array(Buffer.from(text, "base64")));
const given = JSON.parse(readFileSync(0, "utf8"));
let result;
"""
# In a browser a module comes from an address, and a page without one makes it of the text.
LOADED = """
(async (text, library, given) => {
  const bytes = (base64) => Uint8Array.from(atob(base64), (character) => character.charCodeAt(0));
  const address = URL.createObjectURL(new Blob([text], { type: "text/javascript" }));
  const { Model, Solid, runtimeOf } = await import(address);
  const runtime = await runtimeOf(bytes(library));
  const unpacked = (base64) => new Model(runtime, bytes(base64));
  let result;
  %s
  return result;
})(%s)
"""
needs_node = pytest.mark.skipif(NODE is None, reason="node is not installed: it runs the library as WebAssembly")
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")


def run_javascript(program: str, given: object) -> Any:
    """What `program` leaves in `result`, with `given` as JSON in `given`."""
    assert NODE is not None
    text = f"{PREPARED}\n{program}\nconsole.log(JSON.stringify(result));\n"
    command = [NODE, "--input-type=module", "--eval", text]
    done = subprocess.run(command, input=json.dumps(given), capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def run_in_chromium(program: str, given: object) -> Any:
    """The same in a page of Chromium."""
    handed = SOLID.read_text(encoding="utf-8"), base64.b64encode(LIBRARY.read_bytes()).decode(), given
    with chromium() as tab:
        found = tab.evaluate(LOADED % (program, ", ".join(map(json.dumps, handed))))
        assert not tab.complaints
    return found

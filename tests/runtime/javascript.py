"""Running the page's solid.js, and with it the library as WebAssembly, in node."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

import ldsim.runtime
import ldsim.web

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
needs_node = pytest.mark.skipif(NODE is None, reason="node is not installed: it runs the library as WebAssembly")


def run_javascript(program: str, given: object) -> Any:
    """What `program` leaves in `result`, with `given` as JSON in `given`."""
    assert NODE is not None
    text = f"{PREPARED}\n{program}\nconsole.log(JSON.stringify(result));\n"
    command = [NODE, "--input-type=module", "--eval", text]
    done = subprocess.run(command, input=json.dumps(given), capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)

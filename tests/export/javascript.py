"""Running the page's JavaScript in node."""

from __future__ import annotations

import json
import shutil
import subprocess
from typing import Any

import pytest

from ldsim.export.playground import PHYSICS, script

NODE = shutil.which("node")
needs_node = pytest.mark.skipif(NODE is None, reason="node is not installed: it runs the playground's step")


def run_javascript(program: str, given: object) -> Any:
    """What `program` leaves in `result`, with the page's step loaded and `given` as JSON in `given`."""
    assert NODE is not None
    read = "const given = JSON.parse(require('fs').readFileSync(0, 'utf8'));"
    # The step is a script of its own in the page; a function keeps its names apart here.
    text = f"{{\n{script(PHYSICS)}\n{read}\nlet result;\n{program}\nconsole.log(JSON.stringify(result));\n}}"
    done = subprocess.run([NODE, "-e", text], input=json.dumps(given), capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)

"""Running the page's JavaScript in node."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

import ldsim.web

NODE = shutil.which("node")
SOURCES = Path(ldsim.web.__file__).parent / "src"
NAMES = {
    "arrays": "readSafetensors",
    "generated/materials": "material",
    "model": "held, spaceOf, springOn",
    "stepping": "Stepper",
    "surface": "displaced",
}
IMPORTS = 'import { readFileSync } from "node:fs";' + "".join(
    f"import {{ {names} }} from {json.dumps((SOURCES / f'{module}.js').as_uri())};" for module, names in NAMES.items()
)
needs_node = pytest.mark.skipif(NODE is None, reason="node is not installed: it runs the playground's step")


def run_javascript(program: str, given: object) -> Any:
    """What `program` leaves in `result`, with the page's step loaded and `given` as JSON in `given`."""
    assert NODE is not None
    read = "const given = JSON.parse(readFileSync(0, 'utf8'));"
    text = f"{IMPORTS}\n{read}\nlet result;\n{program}\nconsole.log(JSON.stringify(result));\n"
    command = [NODE, "--input-type=module", "--eval", text]
    done = subprocess.run(command, input=json.dumps(given), capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)

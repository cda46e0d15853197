"""The fuzzer of fuzz.c, compiled with sanitizers and run."""

from __future__ import annotations

import subprocess
from pathlib import Path

FLAGS = ("-std=c99", "-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")


def built(compiler: str, folder: Path, sources: Path) -> Path:
    """The program.

    Raises:
        subprocess.CalledProcessError: it does not compile; a compiler without sanitizers says so.
    """
    made = folder / "fuzz"
    files = [str(Path(__file__).with_name("fuzz.c")), str(sources / "ldsim.c")]
    command = [compiler, *FLAGS, f"-I{sources}", *files, "-o", str(made), "-lm"]
    subprocess.run(command, capture_output=True, text=True, check=True)
    return made


def damaged(program: Path, model: Path, seed: int, rounds: int) -> list[int]:
    """How many damaged copies of a model were refused, and how many ran; fails with what a sanitizer reports."""
    done = subprocess.run([program, model, str(seed), str(rounds)], capture_output=True, text=True)
    assert done.returncode == 0, f"{model.name}, seed {seed}: {done.stderr[:4000]}"
    return [int(count) for count in done.stdout.split()]

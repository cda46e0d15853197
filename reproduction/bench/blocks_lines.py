"""The lines for a shell on README and the guide's pages: which there are, who runs them, and why some cannot run."""

from __future__ import annotations

import re
from pathlib import Path

FENCED = re.compile(r"^```(\w*)\n(.*?)^```", re.M | re.S)
PROGRAMS = r"source|\(?cd|make|node|dask|pip|python|(?:\S*/)?(?:ldsim|python)"
LINE = re.compile(rf"^    ((?:\w+=\S* )*(?:{PROGRAMS})(?: [^\n]*)?)$", re.M)
COMMENT = re.compile(r"\s+#.*$")
# The commands that take seconds: tests/docs/test_blocks.py runs them on a small run.
QUICK = ("info", "list", "open", "export", "compare")
QUICK_LINE = re.compile(rf"(?:\S*/)?ldsim (?:{'|'.join(QUICK)})\b")
# What is not as it is for a reader: a folder that machines share, the machine of a scheduler, and that pip installs.
STANDS_FOR = {
    "pip install": "pip install --dry-run",
    "/shared/runs": "{folder}/shared",
    "//head:": "//127.0.0.1:",
    "dask scheduler": "dask scheduler --host 127.0.0.1",
}
# What a page presumes to have been typed before.
PRESUMED = {"cubature": ["ldsim make configs/part.yaml --until train"]}
# Lines that run nowhere by themselves, by how they begin, and why.
REASONS = {
    "ldsim snapshot configs/part.yaml --runs /shared/runs --scheduler tls://": (
        "it needs a cluster with certificates of its own; the same over tcp is run"
    ),
    "LDSIM_DATA=… python -m reproduction.bench.full_space": (
        "it takes hours and the paper's data; reproduction/results/full_space_*.json are what it wrote"
    ),
    "#!/bin/bash\n#SBATCH": "it needs Slurm; bash and the command line read it (tests/docs/test_blocks.py)",
}


def lines_of(page: Path) -> list[str]:
    """The lines of a page, without their comments, in order; a script for bash is one."""
    text = page.read_text(encoding="utf-8")
    found = [(at.start(), at[2].strip()) for at in FENCED.finditer(text) if at[1] == "bash"]
    blank = FENCED.sub(lambda at: re.sub(r"[^\n]", " ", at[0]), text)  # other blocks are not for a shell
    found += [(at.start(), COMMENT.sub("", at[1])) for at in LINE.finditer(blank)]
    return [line for _, line in sorted(found) if "[--" not in line]  # which says how a command is used, and is none


def reason(line: str) -> str | None:
    """Why a line is not run; None where it has to be."""
    return next((why for begins, why in REASONS.items() if line.startswith(begins)), None)


def is_quick(line: str) -> bool:
    """Whether the tests run it."""
    return QUICK_LINE.match(line) is not None


def is_server(line: str) -> bool:
    """Whether it runs beside the others, until it is ended."""
    return line.startswith("dask ")

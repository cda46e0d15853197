"""Numbers in README and the guide that come from reproduction/results/: docs/generate.py fills them in.

In a page stands

    <!-- number: demo.json | demo | online error, latent, pulls_1 | {:.1%} -->5.8%<!-- /number -->
    <!-- table: demo.json | motions --> … <!-- /table -->
    <!-- stale: numbers --> … <!-- /stale -->

and what is between the two comments is written anew from the file; a test fails where they differ. A table ends in
where it comes from, and in whether code or configurations have changed since; the last tells the same of all numbers of
the page, and is empty where nothing has changed.
"""

from __future__ import annotations

import ast
import hashlib
import io
import json
import re
import tokenize
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
RESULTS = ROOT / "reproduction" / "results"
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs" / "guide").glob("*.md")))
MARKED = re.compile(r"<!-- (number|table|stale): (.*?) -->(.*?)<!-- /\1 -->", re.S)

Content = Mapping[str, Any]


def filled(text: str, results: Path = RESULTS) -> str:
    """A page with the numbers of the files.

    Raises:
        KeyError: a file has no such model, quantity or table.
        FileNotFoundError: there is no such file.
    """

    def replaced(found: re.Match[str]) -> str:
        kind, spec = found[1], [part.strip() for part in found[2].split("|")]
        if kind == "stale":
            return f"<!-- stale: {found[2]} -->{stale_numbers(text, results)}<!-- /stale -->"
        content = json.loads((results / spec[0]).read_text(encoding="utf-8"))
        inside = _number(content, *spec[1:]) if kind == "number" else _table(spec[0], content, spec[1])
        return f"<!-- {kind}: {found[2]} -->{inside}<!-- /{kind} -->"

    return MARKED.sub(replaced, text)


def stale_numbers(text: str, results: Path = RESULTS) -> str:
    """What a page says of its numbers whose results are stale, with the days they are of; nothing where none is."""
    numbers = {
        tuple(map(str.strip, found[2].split("|")[:2])) for found in MARKED.finditer(text) if found[1] == "number"
    }
    contents = {file: json.loads((results / file).read_text(encoding="utf-8")) for file, _ in numbers}
    measured = [origin_of(contents[file], model) for file, model in numbers]
    days = sorted({origin["created"][:10] for origin in measured if _is_stale(origin)})
    if not days:
        return ""
    when = days[0] if len(days) == 1 else f"{days[0]} to {days[-1]}"
    return f" **Stale**: the code has changed since numbers of this page were measured ({when})."


def unmarked(text: str) -> str:
    """A page without what is filled in."""
    return MARKED.sub("", text)


def values(content: Content) -> dict[tuple[str, str], Any]:
    """(model, quantity) → value of a result."""
    return {(row["model"], row["quantity"]): row["value"] for row in content["rows"]}


def _number(content: Content, model: str, quantity: str, form: str) -> str:
    value = values(content)[model, quantity]
    return "–" if value is None else form.format(value)


def _table(file: str, content: Content, name: str) -> str:
    head, *lines = TABLES[name](content)
    rows = [head, ["---"] * len(head), *lines]
    body = "\n".join("| " + " | ".join(row) + " |" for row in rows)
    machine = content["machine"]
    commit = f", commit {content['commit']}" if content.get("commit") else ""
    return (
        f"\n\n{body}\n\nMeasured by `{content['command']}` on {machine['cpu']}, {machine['cores']} cores, "
        f"{content['created'][:10]}{commit} (`reproduction/results/{file}`).{staleness(content)}\n\n"
    )


def motions(content: Content) -> list[list[str]]:
    """Every motion of every model: step and online error of the linear space of kp columns and of the latent one."""
    found = values(content)
    pattern = re.compile(r"median step, latent, (.*)")
    lines = [["experiment", "motion", "linear step", "linear error", "latent step", "latent error"]]
    for model, quantity in found:
        motion = pattern.fullmatch(quantity)
        if motion is not None:
            cells = [model, motion[1]]
            for space in ("linear", "latent"):
                step, error = (
                    found[model, f"{what}, {space}, {motion[1]}"] for what in ("median step", "online error")
                )
                cells += [
                    "–" if step is None else f"{step:.2g} ms",
                    "lost" if error is None else f"{100 * error:.1f} %",
                ]
            lines.append(cells)
    return lines


TABLES: dict[str, Callable[[Content], list[list[str]]]] = {"motions": motions}


def input_hashes(paths: Iterable[str]) -> dict[str, str]:
    """SHA-256 of files, and of folders with all their Python files, by their path in the project.

    Of Python files the code counts: what only explains it differently has changed no result.
    """
    return {path: _hash(ROOT / path) for path in sorted(paths)}


def _hash(path: Path) -> str:
    digest = hashlib.sha256()
    for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
        digest.update(str(file.relative_to(path)).encode())
        content = file.read_bytes() if file.is_file() else b"missing"
        digest.update(code(content.decode()).encode() if file.suffix == ".py" else content)
    return digest.hexdigest()


@cache
def code(source: str) -> str:
    """Python source without comments, docstrings and empty lines."""
    lines = source.splitlines()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            row, column = token.start
            lines[row - 1] = lines[row - 1][:column]
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            first = node.body[0] if node.body else None
            if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant) and first.end_lineno is not None:
                lines[first.lineno - 1 : first.end_lineno] = [""] * (first.end_lineno - first.lineno + 1)
    return "\n".join(line.rstrip() for line in lines if line.strip())


def origin_of(content: Content, model: str) -> Content:
    """What tells where the rows of a model come from: the result itself, or its entry in `earlier`."""
    origin: Content = content.get("earlier", {}).get(model, content)
    return origin


def staleness(content: Content) -> str:
    """What a page says of a result some of whose inputs have changed since, or are not known; else nothing."""
    stale = any(map(_is_stale, [content, *content.get("earlier", {}).values()]))
    return " **Stale**: the code has changed since." if stale else ""


def _is_stale(origin: Content) -> bool:
    inputs = origin.get("inputs")
    return not inputs or input_hashes(inputs) != dict(inputs)

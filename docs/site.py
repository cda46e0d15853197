"""What mkdocs does not do by itself: the pages at the project's root are pages of the site too, and the demo is one."""

from __future__ import annotations

import logging
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

LOG = logging.getLogger("mkdocs.hooks.site")
HERE = Path(__file__).parent
ROOT = HERE.parent
FROM_ROOT = ("CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md")
README = ROOT / "README.md"
EXAMPLES = sorted(config.stem for config in ROOT.glob("configs/*.yaml"))
# The demo's page is there for everybody, that of another example where `make site` found its run and exported it.
LIVE = {name: ROOT / "runs" / name / "export" / f"{name}.html" for name in EXAMPLES}
LIVE = {name: page for name, page in LIVE.items() if page.is_file()}
LIVE |= {page.stem: page for page in (HERE / "live").glob("*.html")}
# Of the gallery: the name of an example, and what its configuration says of it.
EXAMPLE = re.compile(r"^## (\w+)\n\n.*\n", re.M)
LINK = re.compile(r"(?<!!)\[([^\]]*)\]\(([^)\s]+)\)")


def on_files(files: Any, config: Any) -> Any:
    """Add the pages of the root, and the live pages of examples that lie in their runs."""
    for name in FROM_ROOT:
        files.append(File.generated(config, name, abs_src_path=str(ROOT / name)))
    for name, page in LIVE.items():
        if HERE not in page.parents:
            files.append(File.generated(config, f"live/{name}.html", abs_src_path=str(page)))
    if lacking := [name for name in EXAMPLES if name not in LIVE]:
        LOG.info("no live page of %s, which have not run here: make examples, then make site", ", ".join(lacking))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Links as they are on the site; its first page begins as README does."""
    own = ROOT / page.file.src_uri if page.file.src_uri in FROM_ROOT else ROOT / "docs" / page.file.src_uri
    if page.file.src_uri == "index.md":
        first = README.read_text(encoding="utf-8").partition("\n## Your own solid")[0]
        return _moved(first, README, "") + _moved(markdown.replace("# Documentation of ldsim\n", ""), own, "")
    return _moved(markdown, own, "../" * page.file.src_uri.count("/"))


def _moved(markdown: str, own: Path, up: str) -> str:
    """Links as they are where docs/ is the root; what is no page of the site is named without one.

    Args:
        own: the file that the text is of.
        up: from the page to the root of the site.
    """

    def moved(found: re.Match[str]) -> str:
        target, _, anchor = found[2].partition("#")
        if "://" in target:
            return found[0]
        if not target:  # a place further down: of README only the beginning is here
            return found[1] if own == README else found[0]
        file = (own.parent / target).resolve()
        if not file.is_relative_to(ROOT / "docs") and file not in [ROOT / name for name in FROM_ROOT]:
            return found[1]
        place = file.relative_to(ROOT / "docs") if file.is_relative_to(ROOT / "docs") else Path(file.name)
        return f"[{found[1]}]({up}{place.as_posix()}{'#' if anchor else ''}{anchor})"

    shown = LINK.sub(moved, markdown.replace("](docs/pictures/", "](pictures/"))
    return EXAMPLE.sub(lambda found: found[0] + (_live(found[1], up) if own.stem == "gallery" else ""), shown)


def _live(name: str, up: str) -> str:
    if name not in LIVE:
        return f"\nIts live page is not on this copy of the site: `make EXPERIMENT={name}`, then `make site`.\n"
    return f"\n**[Pull at it]({up}live/{name}.html)**: this page simulates by itself.\n"

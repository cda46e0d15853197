"""The pages of a reader: made from the code where they can be, and true where a machine can tell."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from docs import generate
from ldsim.settings import Settings

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "examples" / "README.md", *(ROOT / "docs").rglob("*.md")]
)
# What is frozen shows configurations as they were.
LIVE = [page for page in PAGES if page.parent.name != "notebook"]
EXAMPLE = ROOT / "README.md"


def _yaml_blocks(page: Path) -> list[dict[str, Any]]:
    return [yaml.safe_load(block) for block in re.findall(r"^```yaml\n(.*?)^```", page.read_text("utf-8"), re.M | re.S)]


def _name(page: Path) -> str:
    return page.name


@pytest.mark.parametrize(
    "name",
    ["settings.md", "schema.json", "artefacts.md", "commands.md", "report.md", "python.md", "gallery.md", "demo.html"],
)
def test_a_generated_page_is_what_the_code_says(name: str) -> None:
    found = {path: text for path, text in generate.pages().items() if path.name == name}
    assert found
    for path, text in found.items():
        assert path.read_text("utf-8") == text, "run `python docs/generate.py` and commit what it writes"


@pytest.mark.parametrize("page", LIVE, ids=_name)
def test_every_configuration_shown_is_valid(page: Path) -> None:
    """A part of a configuration is completed by the README's example, section by section."""
    (example,) = (block for block in _yaml_blocks(EXAMPLE) if "experiment" in block)
    for block in _yaml_blocks(page):
        Settings.model_validate(block if "experiment" in block else example | block)


@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_every_link_between_pages_leads_somewhere(page: Path) -> None:
    for target in re.findall(r"(?<!!)\[[^\]]*\]\(([^)\s]+)\)", page.read_text("utf-8")):
        if "://" in target:
            continue
        name, _, anchor = target.partition("#")
        file = (page.parent / name) if name else page
        assert file.exists(), f"{page.name} links to {target}"
        headings = re.findall(r"^#+ (.*)$", file.read_text("utf-8"), re.M) if anchor else []
        anchors = {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}
        assert not anchor or anchor in anchors, f"{page.name} links to {target}"


@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_no_page_names_a_folder_of_one_machine(page: Path) -> None:
    assert not re.findall(r"(?<![\w.])/(?:work|home|root|Users)/", page.read_text("utf-8"))

"""What may be installed, and what is: every range of pyproject.toml allows the version that `make` installs."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


def named(requirement: str) -> str:
    return re.sub(r"[-_.]+", "-", requirement).lower()


def locked() -> dict[str, str]:
    lines = (ROOT / "requirements.lock").read_text("utf-8").splitlines()
    pairs = [line.split("==") for line in lines if not line.startswith("#")]
    return {named(name): version for name, version in pairs}


def wanted() -> list[Requirement]:
    extras = PROJECT["optional-dependencies"]
    texts = [*PROJECT["dependencies"], *(text for extra in extras.values() for text in extra)]
    return [Requirement(text) for text in texts if not text.startswith("ldsim[")]


def test_the_lock_file_holds_a_version_that_is_allowed_of_everything() -> None:
    versions = locked()
    for requirement in wanted():
        assert requirement.specifier.contains(versions[named(requirement.name)]), str(requirement)


def test_what_users_install_beside_other_packages_is_a_range() -> None:
    assert all(requirement.specifier for requirement in wanted())
    for text in PROJECT["dependencies"]:
        assert "==" not in text, f"{text} shuts out every other version"


def test_make_installs_by_the_lock_file() -> None:
    makefile = (ROOT / "Makefile").read_text("utf-8")
    assert "--constraint requirements.lock" in makefile and "grep ^torch== requirements.lock" in makefile
    assert "torch" in locked() and not re.search(r"[+]cpu", (ROOT / "requirements.lock").read_text("utf-8"))

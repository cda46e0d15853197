"""The materials in JavaScript are made of the Python as it is, and of nothing that the translation does not know."""

from __future__ import annotations

from pathlib import Path

import pytest

from tools import port


def test_the_generated_file_is_that_of_the_materials_as_they_are() -> None:
    hint = "run `python -m tools.port` and ldsim/web/build.sh, and commit what they write"
    assert port.TARGET.read_text(encoding="utf-8") == port.materials_script(), hint


@pytest.mark.parametrize(
    ("body", "words"),
    [("return np.linalg.det(F)", "np.linalg.det"), ("return helper(F)", "helper"), ("while F: pass", "While")],
)
def test_what_has_no_translation_is_refused_by_name(
    body: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "odd.py").write_text(f"def energy_stress(F):\n    {body}\n", encoding="utf-8")
    translation = port.Port()
    monkeypatch.setattr(port, "FOLDER", tmp_path)
    port.module.cache_clear()
    with pytest.raises(port.PortError, match=words):
        translation.add("energy_stress", "odd")

"""`ldsim make --error` as a whole: what fresh motions say of a model may send it on to learn."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from ldsim.pipeline.convergence import Round, read_rounds, write_rounds
from ldsim.settings import load_settings, settings_of
from ldsim.settings.enrich import learn
from tests.settings.test_enrich import CONTENT


def learned(
    folder: Path, monkeypatch: pytest.MonkeyPatch, stated: list[float | None], helped: int, minutes: float = 20.0
) -> tuple[list[float], list[int], list[str]]:
    """What is asked of each call of `enrich`, the seeds of the fresh motions, and what is said.

    Args:
        stated: the error that fresh motions say of one model after another.
        helped: calls that make another model.
    """
    content = CONTENT | {"simulate": {"statement": {"motions": 2, "pulls": {"count": 1, "reach": 0.1, "seed": 4}}}}
    config, run = folder / "part.yaml", folder / "runs" / "part"
    config.write_text(settings_of(content, "a test").dump(defaults=False), encoding="utf-8")
    (run / "model.partial").mkdir(parents=True, exist_ok=True)
    asked, seeds, said, clock = list[float](), list[int](), list[str](), iter(range(0, 10_000, 300))

    def enrich(config: Path, runs: Path, percent: float, left: float, say: object) -> dict[str, str]:
        asked.append(percent)
        if len(asked) <= helped:
            write_rounds(
                run, [*read_rounds(run), Round(error=0.8 * percent / 100, pulls=30, seconds=100.0, changed="")]
            )
        return {"train": "it learns"} if len(asked) <= helped else {}

    def make(config: Path, *_: object) -> dict[str, str]:
        statement = load_settings(config).simulate.statement
        assert statement is not None
        seeds.append(statement.pulls.seed)
        return {"simulate": "a model"}

    def report_of(folder: Path) -> SimpleNamespace:
        latent = SimpleNamespace(error=stated[len(seeds) - 1])
        return SimpleNamespace(kind="condensed", statement=SimpleNamespace(latent=latent))

    for name, fake in {"enrich": enrich, "make": make, "report_of": report_of}.items():
        monkeypatch.setattr(f"ldsim.settings.enrich.{name}", fake)
    monkeypatch.setattr("ldsim.settings.enrich._model_of", lambda *_: str(min(len(asked), helped)))
    monkeypatch.setattr("ldsim.settings.enrich.time.monotonic", lambda: next(clock))
    assert set(learn(config, folder / "runs", 5.0, minutes, "report", said.append)) == {"train", "simulate"}
    return asked, seeds, said


def test_what_is_stated_sends_it_on_to_learn_and_other_motions_judge_what_comes_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, seeds, said = learned(tmp_path, monkeypatch, [0.0625, None, 0.049], helped=3, minutes=1000.0)
    assert asked == pytest.approx([5.0, 4.0, 3.6]) and seeds == [4, 5, 6]
    assert said == [
        "6.25 % are stated, 5 % were asked: it goes on, for 3.2 % on the pulls kept aside",
        "fresh motions were lost, 5 % were asked: it goes on, for 2.9 % on the pulls kept aside",
    ]
    assert not (tmp_path / "runs" / "part" / "model.partial").exists()


def test_it_does_not_go_on_without_time_or_where_nothing_helps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked, seeds, said = learned(tmp_path, monkeypatch, [0.06], helped=1, minutes=6.0)
    assert (asked, seeds, said) == ([5.0], [4], [])
    asked, seeds, _ = learned(tmp_path, monkeypatch, [0.06], helped=1, minutes=1000.0)
    assert len(asked) == 2 and seeds == [4, 4]
    assert (tmp_path / "runs" / "part" / "model.partial").exists()

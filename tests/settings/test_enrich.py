"""`ldsim make --error`: rounds of evaluating and extending, and the configuration that they come to."""

from __future__ import annotations

import errno
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from ldsim.errors import ArtefactError, SettingsError
from ldsim.mechanics.motion import Drag, Motion
from ldsim.pipeline.convergence import Round, by_pull, improved, read_rounds, write_rounds
from ldsim.settings import Settings, load_settings, settings_of
from ldsim.settings.enrich import MOST, current, enrich, extended, passed_over, planned, write_enriched
from ldsim.settings.make import StageFailed

CONTENT = {
    "experiment": "part",
    "mesh": {
        "shape": {"name": "beam"},
        "material": {"youngs_modulus": 1e5},
        "pins": [{"slab": {"axis": "x", "thickness": 0.01}}],
    },
    "snapshot": {
        "motions": [
            {"name": "a", "role": "train", "pulls": {"count": 1, "reach": 0.1}},
            {"name": "b", "role": "validation", "pulls": {"count": 1, "reach": 0.1}},
        ]
    },
    "train": {"kind": "condensed", "hidden": [32, 100], "condensed": {"rounds": 1, "points": 20, "features": 6}},
}


@dataclass
class Made:
    """Errors come one after another, each after some seconds; it can be extended a number of times."""

    errors: list[float]
    seconds: float = 10.0
    more: int = 100
    now: float = 0.0
    asked: list[str] = field(default_factory=list)

    def evaluate(self) -> tuple[float, int]:
        self.now += self.seconds
        self.asked.append("evaluate")
        return self.errors[self.asked.count("evaluate") - 1], 5

    def extend(self) -> str:
        self.asked.append("extend")
        self.more -= 1
        return "more" if self.more >= 0 else ""


def rounds(made: Made, asked: float, seconds: float = math.inf) -> list[Round]:
    return list(improved(made, asked, seconds, lambda: made.now))


def test_it_is_extended_until_the_error_is_held() -> None:
    made = Made([0.2, 0.07, 0.05, 0.01])
    assert [each.error for each in rounds(made, 0.05)] == [0.2, 0.07, 0.05]
    assert made.asked == ["evaluate", "extend", "evaluate", "extend", "evaluate"]


def test_what_holds_at_once_is_not_extended() -> None:
    made = Made([0.01])
    assert rounds(made, 0.05) == [Round(error=0.01, pulls=5, seconds=10.0, changed="")] and made.asked == ["evaluate"]


@pytest.mark.parametrize(("seconds", "count"), [(0.0, 1), (19.0, 1), (20.0, 2), (39.0, 3)])
def test_no_round_is_begun_that_would_end_too_late(seconds: float, count: int) -> None:
    assert len(rounds(Made(10 * [0.2]), 0.05, seconds)) == count


def test_it_ends_where_nothing_is_left_to_extend() -> None:
    found = rounds(Made([0.3, 0.2, 0.1], more=1), 0.05)
    assert [each.changed for each in found] == ["more", ""]


def test_a_model_that_is_lost_is_extended_and_said_to_be_lost() -> None:
    found = rounds(Made([math.inf, 0.01]), 0.05)
    assert [each.error for each in found] == [None, 0.01]
    assert found[0].line(1, 0.05, 0.04) == (
        "round 1: lost on 5 pulls kept aside (so few must be below 4 % for 5 % on many), 10 s; next: more"
    )


def test_wider_layers_come_first_and_then_more_of_its_own_runs() -> None:
    settings = settings_of(CONTENT, "a test")
    wider, words = extended(settings, 10, 40, poor_fit=False, last="", helped=True)
    assert wider.train == settings.train.replace(hidden=(64, 128)) and words == "train.hidden [64, 128]"
    more, words = extended(wider, 10, 40, poor_fit=False, last="train.hidden", helped=True)
    assert more.train == wider.train.replace(condensed=settings.train.condensed.replace(rounds=3))
    assert words == "train.condensed.rounds 3"
    for helped in (True, False):  # as often as it helps
        again = extended(more, 10, 40, poor_fit=False, last="train.condensed.rounds", helped=helped)[1]
        assert again == ("train.condensed.rounds 5" if helped else "train.r 14")


def test_a_potential_that_misses_poses_gets_more_points_with_the_wider_layers() -> None:
    wider, words = extended(settings_of(CONTENT, "a test"), 10, 40, poor_fit=True, last="", helped=True)
    assert (wider.train.hidden, wider.train.condensed.points, wider.train.condensed.features) == ((64, 128), 40, 12)
    assert words == "train.hidden [64, 128], condensed.features 12, condensed.points 40"


def test_what_did_not_help_is_not_tried_again_and_coordinates_come_last() -> None:
    settings = settings_of(CONTENT, "a test")
    assert extended(settings, 10, 40, False, "train.hidden", helped=False)[1] == "train.condensed.rounds 3"
    more, words = extended(settings, 10, 40, False, "train.condensed.rounds", helped=False)
    assert more.train == settings.train.replace(r=14) and words == "train.r 14"
    assert extended(settings, 22, 40, False, "train.r", helped=True)[1] == f"train.r {MOST}"
    assert extended(settings, MOST, 40, False, "train.r", helped=True) == (settings, "")
    assert extended(settings, 14, 15, False, "train.r", helped=True)[1] == "train.r 15"
    assert extended(settings, 15, 15, False, "train.r", helped=True) == (settings, "")
    assert extended(settings, 14, 40, False, "train.r", helped=False)[1] == "train.r 18"


def test_what_it_came_to_is_used_as_long_as_the_configuration_says_the_same(tmp_path: Path) -> None:
    config, runs = tmp_path / "part.yaml", tmp_path / "runs"
    config.write_text(settings_of(CONTENT, "a test").dump(defaults=False), encoding="utf-8")
    assert current(config) == config and passed_over(config) == ""
    more, _ = extended(load_settings(config), 10, 40, poor_fit=False, last="", helped=True)
    place = write_enriched(config, more)
    assert place == tmp_path / "part.enriched.yaml" == current(config)
    assert load_settings(place) == more
    config.write_text(f"# a comment\n{config.read_text('utf-8')}", encoding="utf-8")
    assert current(config) == place and passed_over(config) == ""
    settings = load_settings(config)
    config.write_text(settings.replace(train=settings.train.replace(r=7)).dump(defaults=False), encoding="utf-8")
    assert current(config) == config
    words = "note: part.enriched.yaml is of what part.yaml said before it was changed, and is not used"
    assert passed_over(config) == words and planned(config, runs, None, None) == f"{words}\n"
    place.write_bytes(b"\xff\n")
    assert current(config) == config
    config.unlink()
    assert current(config) == config
    assert current(tmp_path) == tmp_path


def test_rounds_are_read_as_they_were_written(tmp_path: Path) -> None:
    assert read_rounds(tmp_path) == []
    found = rounds(Made([math.inf, 0.2, 0.01]), 0.05)
    write_rounds(tmp_path, found)
    assert read_rounds(tmp_path) == found


def test_errors_are_told_pull_by_pull_and_a_lost_one_is_infinite() -> None:
    drags = tuple(Drag(start, np.zeros(3), np.zeros((2, 3)), 0.1, 1.0) for start in (0, 4, 8))
    moved, distance = np.full(12, 2.0), np.repeat([0.2, 0.4, np.nan], 4)
    np.testing.assert_allclose(by_pull(Motion("a", 12, drags), distance, moved), [0.1, 0.2, np.inf])
    np.testing.assert_allclose(by_pull(Motion("still", 12), distance[:8].repeat(2)[:12], moved), [0.4 / 3])


class MadeRun:
    """A run whose model misses poses kept back by 1 %."""

    missed = 0.01

    def __init__(self, folder: Path, experiment: str) -> None:
        self.folder = folder
        self.basis = SimpleNamespace(k=40)
        self.scene = SimpleNamespace(free=range(900), mesh=SimpleNamespace(n_vertices=10_001))
        self.model = SimpleNamespace(loss=np.array([[0.1, self.missed]]), decoder=SimpleNamespace(r=10))

    def path(self, kind: str) -> Path:
        return self.folder / f"{kind}.h5"

    def __enter__(self) -> MadeRun:
        return self

    def __exit__(self, *_: object) -> None:
        pass


def test_stages_run_on_what_rounds_came_to_and_the_table_lies_beside_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, told = enriched(tmp_path, monkeypatch, [0.3, 0.02])
    assert made == ["part.yaml", "part.enriched.yaml"]
    assert load_settings(current(tmp_path / "part.yaml")).train.hidden == (64, 128)
    run = tmp_path / "runs" / "part"
    assert [each.error for each in read_rounds(run)] == [0.3, 0.02]
    assert told[0].startswith(
        "round 1: off by up to 30 % on 2 pulls kept aside (so few must be below 4 % for 5 % on many)"
    )
    assert [each.name for each in sorted(run.iterdir())] == ["model.h5", "model.partial", "rounds.json"]


def test_layers_that_were_left_out_become_wider_than_those_of_the_solid(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(CONTENT, "train", {})
    _, told = enriched(tmp_path, monkeypatch, [0.3, 0.02])
    assert told[0].endswith("next: train.hidden [128, 128, 128, 128]")  # twice 80, as far as that goes


def test_what_comes_before_rounds_counts_in_the_time_and_not_as_a_round(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    instants = iter([100.0, 120.0])
    monkeypatch.setattr("ldsim.settings.enrich.time", SimpleNamespace(monotonic=lambda: next(instants)))
    made, _ = enriched(tmp_path, monkeypatch, [0.3, 0.2, 0.1], minutes=1.0, seconds=15.0)
    assert len(made) == 2  # of 15 s each within 40 s
    assert [each.seconds for each in read_rounds(tmp_path / "runs" / "part")] == [15.0, 15.0]


def test_few_pulls_have_to_hold_the_error_with_a_margin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """For the many that are stated are worse than the worst of a few."""
    assert len(enriched(tmp_path, monkeypatch, [0.045, 0.039])[0]) == 2


def test_where_wider_layers_did_not_help_it_learns_from_more_of_its_own_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, told = enriched(tmp_path, monkeypatch, [0.3, 0.28, 0.02])
    assert [line.partition("next: ")[2] for line in told] == ["train.hidden [64, 128]", "train.condensed.rounds 3", ""]


def test_the_round_that_was_least_off_is_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made, _ = enriched(tmp_path, monkeypatch, [0.3, 0.045, 0.1], minutes=1.0, seconds=19.0)
    assert len(made) == 3
    assert (tmp_path / "runs" / "part" / "model.h5").read_text("utf-8") == "128 wide, 1 rounds"
    assert load_settings(current(tmp_path / "part.yaml")).train.hidden == (64, 128)


def test_a_call_again_goes_on_where_the_last_one_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What did not help from the round that was taken is not tried again, and what was relaxed is still there."""
    enriched(tmp_path, monkeypatch, [0.3, 0.1, 0.2], minutes=1.0, seconds=19.0)
    run = tmp_path / "runs" / "part"
    assert (run / "model.partial").is_dir()
    _, told = enriched(tmp_path, monkeypatch, [0.1, 0.12, 0.03])
    assert told[0].startswith("round 4: off by up to 10 %")
    assert [line.partition("next: ")[2] for line in told] == ["train.r 14", "train.r 18", ""]
    assert [each.error for each in read_rounds(run)] == [0.3, 0.1, 0.2, 0.1, 0.12, 0.03]


def test_coordinates_that_did_not_help_are_not_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    enriched(tmp_path, monkeypatch, [0.1, 0.2, 0.3, 0.4], minutes=1.0, seconds=14.0)
    assert [each.changed for each in read_rounds(tmp_path / "runs" / "part")][-2:] == ["train.r 14", ""]
    _, told = enriched(tmp_path, monkeypatch, [0.1, 0.03])
    assert told[0].endswith("next: train.r 18")


def test_a_call_again_does_more_of_what_had_helped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    enriched(tmp_path, monkeypatch, [0.3, 0.1], minutes=1.0, seconds=29.0)
    _, told = enriched(tmp_path, monkeypatch, [0.1, 0.03])
    assert [line.partition("next: ")[2] for line in told] == ["train.condensed.rounds 3", ""]
    assert [(each.error, each.seconds) for each in read_rounds(tmp_path / "runs" / "part")] == [
        (0.3, 29.0),
        (0.1, 29.0),
        (0.03, 0.0),
    ]


def test_a_call_again_begins_no_round_for_which_there_is_no_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its first evaluation makes nothing; what the round before it took tells whether there is time for another."""
    for minutes, more in ((1.0, ["part.yaml"]), (0.5, []), (0.7, ["part.enriched.yaml"])):
        made, _ = enriched(tmp_path, monkeypatch, [0.3, 0.2], minutes=minutes, seconds=40.0)
        assert made == more
    found = read_rounds(tmp_path / "runs" / "part")
    assert [(each.error, each.seconds) for each in found] == [(0.3, 40.0), (0.2, 40.0)]


def test_rounds_of_another_solid_are_forgotten(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Though the configuration is the same, and whether an error is asked for or not."""
    enriched(tmp_path, monkeypatch, [0.3, 0.1], minutes=1.0, seconds=29.0)
    another = {"mesh": "part.stl changed", "train": "mesh comes before it"}
    enriched(tmp_path, monkeypatch, [0.2], minutes=0.0, seconds=5.0, stale=another)
    assert [each.error for each in read_rounds(tmp_path / "runs" / "part")] == [0.2]
    assert enrich(tmp_path / "part.yaml", tmp_path / "runs", None, None, print) == {}
    assert read_rounds(tmp_path / "runs" / "part") == []


def test_a_disk_that_is_only_read_is_no_matter_where_nothing_is_to_forget(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Linux refuses to remove what is not there either."""
    enriched(tmp_path, monkeypatch, [0.3, 0.1], minutes=1.0, seconds=29.0)

    def refused(path: Path, missing_ok: bool = False) -> None:
        raise OSError(errno.EROFS, "Read-only file system", str(path))

    another = {"mesh": "part.stl changed", "train": "mesh comes before it"}
    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink", refused)
        with pytest.raises(ArtefactError, match="cannot write .*rounds.json: Read-only file system"):
            enriched(tmp_path, monkeypatch, [0.2], stale=another)
    (tmp_path / "runs" / "part" / "rounds.json").unlink()
    monkeypatch.setattr(Path, "unlink", refused)
    assert enrich(tmp_path / "part.yaml", tmp_path / "runs", None, None, print) == {}


def test_wider_layers_that_did_not_help_are_not_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(MadeRun, "missed", 0.1)
    _, first = enriched(tmp_path, monkeypatch, [0.1, 0.2], minutes=1.0, seconds=29.0)
    _, told = enriched(tmp_path, monkeypatch, [0.1, 0.03])
    assert "train.hidden" in first[0] and told[0].endswith("next: train.condensed.rounds 3")


def test_a_call_after_an_interrupted_one_knows_what_its_round_was_compared_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    enriched(tmp_path, monkeypatch, [0.3, 0.1], minutes=1.0, seconds=29.0)
    write_rounds(
        tmp_path / "runs" / "part", [Round(error=0.3, pulls=2, seconds=1.0, changed="train.condensed.rounds 3")]
    )
    _, told = enriched(tmp_path, monkeypatch, [0.29, 0.03])
    assert told[0].startswith("round 2: off by up to 29 %") and told[0].endswith("next: train.r 14")


def test_where_all_rounds_are_lost_the_last_one_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    enriched(tmp_path, monkeypatch, [math.inf, math.inf], minutes=1.0, seconds=29.0)
    run = tmp_path / "runs" / "part"
    assert [each.error for each in read_rounds(run)] == [None, None]
    assert (run / "model.h5").read_text("utf-8") == "128 wide, 1 rounds"


class Interrupted(Exception):
    """What ends a call in the middle of a round."""


def test_what_an_interrupted_call_had_come_to_is_taken_where_nothing_after_it_is_better(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(Interrupted):
        enriched(tmp_path, monkeypatch, [0.3, 0.08, Interrupted()])
    enriched(tmp_path, monkeypatch, [0.2], minutes=0.0, seconds=1.0)
    run = tmp_path / "runs" / "part"
    assert (run / "model.h5").read_text("utf-8") == "128 wide, 1 rounds"
    assert load_settings(current(tmp_path / "part.yaml")).train.hidden == (64, 128)
    assert not list(run.glob("model.best.*"))


def test_a_stage_that_fails_in_a_later_round_costs_no_round_before_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, told = enriched(tmp_path, monkeypatch, [0.3, 0.1, StageFailed("train", 1)])
    assert told[-1] == "round 3: train ended with status 1; the best round before it is taken"
    run = tmp_path / "runs" / "part"
    assert (run / "model.h5").read_text("utf-8") == "128 wide, 1 rounds"
    assert load_settings(current(tmp_path / "part.yaml")).train.hidden == (64, 128)
    assert [each.error for each in read_rounds(run)] == [0.3, 0.1, None]
    _, told = enriched(tmp_path, monkeypatch, [0.1, 0.03])
    assert told[0].endswith("next: train.r 14")


def test_a_stage_that_fails_in_the_first_round_is_told_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(StageFailed):
        enriched(tmp_path, monkeypatch, [StageFailed("train", 1)])


def test_rounds_of_another_configuration_are_forgotten(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    enriched(tmp_path, monkeypatch, [0.3, 0.1, 0.2], minutes=1.0, seconds=19.0)
    (tmp_path / "part.enriched.yaml").unlink()
    _, told = enriched(tmp_path, monkeypatch, [0.1, 0.03])
    assert told[0].startswith("round 1:") and told[0].endswith("next: train.hidden [64, 128]")


def enriched(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    errors: Sequence[float | Exception],
    minutes: float | None = None,
    seconds: float = 0,
    stale: Mapping[str, str] | None = None,
) -> tuple[list[str], list[str]]:
    """Rounds with these errors, each of so many seconds: the configurations that stages ran on, and what was said.

    A round that has an exception for its error ends by it, before its model is written. What is stale is by default the
    model, where it is not that of the configuration.
    """
    config, run, made, told = folder / "part.yaml", folder / "runs" / "part", list[str](), list[str]()
    config.write_text(settings_of(CONTENT, "a test").dump(defaults=False), encoding="utf-8")
    (run / "model.partial").mkdir(parents=True, exist_ok=True)

    def make(file: Path, runs: Path, until: str, say: object, flags: object = None) -> dict[str, str]:
        if until == "pca":
            return {}
        assert until == "train" and flags == {"train": ["--keep"]}
        if not stale_now(load_settings(file)):
            return {}
        made.append(file.name)
        if isinstance(left[0], Exception):
            raise left[0]
        (run / "model.h5").write_text(model(load_settings(file)), encoding="utf-8")
        return {"train": "train.r changed"}

    def model(settings: Settings) -> str:
        train = settings.train
        coordinates = f", r {train.r}" if train.r else ""
        return f"{train.layers[1]} wide, {train.condensed.rounds} rounds{coordinates}"

    def stale_now(settings: Settings) -> Mapping[str, str]:
        path = run / "model.h5"
        same = path.exists() and path.read_text("utf-8") == model(settings)
        return stale if stale is not None else {} if same else {"train": "train.r changed"}

    def staleness(_: MadeRun, settings: Settings, base: Path) -> SimpleNamespace:
        return SimpleNamespace(stale=lambda until: stale_now(settings))

    left = list(errors)
    monkeypatch.setattr("ldsim.settings.enrich.make", make)
    monkeypatch.setattr("ldsim.settings.enrich.Staleness", staleness)
    monkeypatch.setattr("ldsim.settings.enrich.Run", MadeRun)
    monkeypatch.setattr("ldsim.settings.enrich.pull_errors", lambda run: np.array([0.01, left.pop(0)]))
    clock = SimpleNamespace(monotonic=lambda: seconds * len(made))
    monkeypatch.setattr(
        "ldsim.settings.enrich.improved",
        lambda made, asked, most, known: improved(made, asked, most, clock.monotonic, known),
    )
    enrich(config, folder / "runs", 5.0, minutes, told.append)
    return made, told


def test_what_rounds_have_made_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    enriched(tmp_path, monkeypatch, [0.02, 0.02, 0.02])
    call = tmp_path / "part.yaml", tmp_path / "runs", 5.0, None, print
    assert enrich(*call) == {}  # it is looked at again, and nothing is made
    (tmp_path / "runs" / "part" / "model.h5").unlink()
    assert list(enrich(*call)) == ["train"]


def test_what_would_be_learned_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    enriched(tmp_path, monkeypatch, [0.3, 0.045], minutes=1.0, seconds=29.0)
    call = tmp_path / "part.yaml", tmp_path / "runs"
    assert planned(*call, 5.0, 20.0) == (
        "train: more rounds of learning, until 4 % is held on the pulls kept aside, "
        "none that would end after 20 minutes\n"
    )
    assert planned(*call, 6.0, 20.0) == planned(*call, None, 20.0) == ""


def test_a_call_that_asks_for_no_error_takes_the_best_round_of_an_interrupted_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(Interrupted):
        enriched(tmp_path, monkeypatch, [0.3, 0.08, 0.2, Interrupted()], seconds=70.0)
    enrich(tmp_path / "part.yaml", tmp_path / "runs", None, None, print)
    run = tmp_path / "runs" / "part"
    assert (run / "model.h5").read_text("utf-8") == "128 wide, 1 rounds"
    settings = load_settings(current(tmp_path / "part.yaml"))
    assert (settings.train.hidden, settings.train.condensed.rounds, settings.train.r) == ((64, 128), 1, None)
    assert not list(run.glob("model.best.*"))
    made, _ = enriched(tmp_path, monkeypatch, [0.08, 0.02], minutes=1.0, seconds=70.0)
    assert not made  # the round that it has took longer than a minute


def test_nothing_runs_where_no_motion_judges(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    content = settings_of(CONTENT, "a test")
    snapshot = content.snapshot.replace(motions=content.snapshot.motions[:1])
    config = tmp_path / "part.yaml"
    config.write_text(content.replace(snapshot=snapshot).dump(defaults=False), encoding="utf-8")
    monkeypatch.setattr("ldsim.settings.enrich.make", lambda *_: pytest.fail("a stage ran"))
    with pytest.raises(SettingsError, match="role validation"):
        enrich(config, tmp_path / "runs", 5.0, None, print)


def test_a_round_that_was_trained_but_not_judged_still_took_its_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    enriched(tmp_path, monkeypatch, [0.3, 0.2], minutes=2.0, seconds=50.0)
    run = tmp_path / "runs" / "part"
    write_rounds(run, [read_rounds(run)[0]])  # interrupted while the pulls of the second were run
    made, told = enriched(tmp_path, monkeypatch, [0.2, 0.03], minutes=0.5, seconds=50.0)
    assert not made and told[0].startswith("round 2: off by up to 20 %") and "50 s" in told[0]

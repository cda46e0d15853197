"""Several runs side by side: what is read, which numbers stand for a run, and the page that shows them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from ldsim.errors import ArtefactError, ExportError
from ldsim.report.compare import Reported, compare, comparison, comparison_page, read_runs, record
from ldsim.report.compare_figures import comparison_figures
from ldsim.report.schema import RunNumbers
from tests.report.example_report import example_report
from tests.report.test_page import LOADING_ATTRIBUTES, Outline, numbers_of

WHEN = "2030-04-05T06:07:08Z"


def run_of(name: str, **changes: Any) -> Reported:
    report = RunNumbers.model_validate(example_report() | {"experiment": name} | changes)
    return Reported(name, Path("runs", name), report)


def compared(*runs: Reported) -> dict[str, Any]:
    return comparison(runs, WHEN, Path("pages"))


def page_of(*runs: Reported) -> str:
    return comparison_page(runs, compared(*runs))


def with_run(space: str, **changes: Any) -> dict[str, Any]:
    """The simulations of the example with one more run of a space, on another test motion."""
    simulate = example_report()["simulate"]
    like = next(run for run in simulate[space] if run["role"] == "test")
    return simulate | {space: [*simulate[space], like | {"motion": "x_3"} | changes]}


def error(relative: float) -> dict[str, float]:
    return {"relative": relative, "windowed": relative / 2, "max_mm": 1.0, "mean_mm": 0.5}


def test_a_record_holds_the_report_s_own_numbers():
    found = record(run_of("x"))
    assert (found["k"], found["r"], found["kp"], found["cells"]) == (60, 10, 37, 29687)
    assert found["points"] == {"linear": 366, "latent": 32}
    assert found["cubature_error"]["latent"] == {"fitted": 0.0497, "kept_back": 0.1123}
    assert found["motion"] == "x_2" and found["step_ms"] == {"full": 131.9, "linear": 4.09, "latent": 0.243}
    assert found["online"]["train"]["latent"]["relative"] == 0.0826
    assert found["online"]["test"]["linear"]["relative"] == 0.2104
    assert found["online"]["train"]["linear"] is None
    assert found["paper"]["latent_ms"] == 4.6 and record(run_of("torus"))["paper"] is None


@pytest.mark.parametrize(("relative", "motion"), [(0.9, "x_3"), (0.1, "x_2")])
def test_the_worst_motion_of_a_role_stands_for_it(relative, motion):
    found = record(run_of("x", simulate=with_run("latent", online_error=error(relative))))
    assert found["online"]["test"]["latent"]["motion"] == motion


def test_no_error_is_worse_than_a_run_that_diverged():
    simulate = with_run("latent", online_error=None, diverged=True)
    found = record(run_of("x", simulate=simulate))["online"]["test"]["latent"]
    assert (found["motion"], found["diverged"], found["relative"]) == ("x_3", True, None)
    assert page_of(run_of("x", simulate=simulate)).count('class="bad"') == 2


def test_a_motion_without_a_full_space_run_does_not_stand_for_the_others():
    found = record(run_of("x", simulate=with_run("latent", online_error=None)))
    assert found["online"]["test"]["latent"]["motion"] == "x_2"


def test_novelty_is_that_of_the_worst_run():
    novelty = {"median": 1.0, "threshold": 2.0, "share_above": 0.25, "rank_correlation": 0.1}
    novelty |= {"rank_correlation_remembered": 0.61, "rank_correlation_time": 0.3}
    simulate = with_run("latent", online_error=error(0.8), novelty=novelty)
    found = record(run_of("x", simulate=simulate))["online"]["test"]["latent"]
    assert (found["share_above"], found["rank_correlation_remembered"]) == (0.25, 0.61)


def test_each_warning_names_its_run_and_stands_before_every_table():
    runs = (run_of("x"), run_of("beam", warnings=["the solid has left the building"]))
    assert compared(*runs)["warnings"] == [
        "x: On motion x_2 the latent run is far away.",
        "beam: the solid has left the building",
    ]
    page = page_of(*runs)
    assert page.index("left the building") < min(page.index("<table"), page.index('<div class="plot">'))
    assert "No warnings" in page_of(run_of("x", warnings=[]))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"cpu": "another"}, "different processors, so their step times do not compare: a processor, 3 cores (x)"),
        ({"cores": 64}, "a processor, 64 cores (beam)"),
        ({"versions": {"ldsim": "0.2.0"}}, "different versions of ldsim: 0.1.0 (x); 0.2.0 (beam)"),
    ],
)
def test_runs_that_hardly_compare_come_with_a_warning(change, words):
    machine = example_report()["machine"]
    assert words in compared(run_of("x"), run_of("beam", machine=machine | change))["warnings"][0]
    assert not any("different" in text for text in compared(run_of("x"), run_of("beam"))["warnings"])


def test_the_page_is_whole_and_loads_nothing():
    outline = Outline(page_of(run_of("x"), run_of("torus")))
    loaded = [value for tag, name, value in outline.attributes if name in LOADING_ATTRIBUTES and tag != "a"]
    assert all(value.startswith("#") for value in loaded)
    assert not any(tag in ("link", "iframe", "img") for tag, _, _ in outline.attributes)
    ids = [value for _, name, value in outline.attributes if name == "id"]
    assert ids and len(ids) == len(set(ids))


def test_every_run_links_to_its_report():
    links = Outline(page_of(run_of("x"), run_of("torus"))).values("a", "href")
    assert set(links) == {"../runs/x/report/report.html", "../runs/torus/report/report.html"}


def test_every_number_of_the_comparison_is_on_the_page():
    run = run_of("torus")
    shown = set(map(float, Outline(page_of(run)).values("data", "value")))
    (numbers,) = compared(run)["runs"]
    for space in ("linear", "latent"):  # shown for test motions only
        (numbers["online"]["train"][space] or {}).pop("windowed", None)
    assert set(numbers_of(numbers)) <= shown


def test_the_paper_s_row_follows_the_run_of_the_same_object():
    heads = [text for text in Outline(page_of(run_of("torus"), run_of("beam"))).texts if "(paper)" in text]
    assert heads == ["beam (paper)"]


def test_hostile_names_are_shown_and_not_run():
    hostile = "<script>alert('x')</script>\"&"
    page = page_of(run_of(hostile, warnings=[hostile]))
    assert page.count("<script") == page_of(run_of("x")).count("<script") and hostile in "".join(Outline(page).texts)


def test_each_figure_has_a_mark_for_every_value_and_every_entry_of_its_legend():
    drawn = comparison_figures(compared(run_of("x"), run_of("beam"))["runs"])
    marks = {name: [one for one in figure.series if one.kind == "marks"] for name, figure in drawn.items()}
    assert {name: [len(one.x) for one in found] for name, found in marks.items()} == dict.fromkeys(drawn, [2, 2, 2])
    assert set(drawn) == {"error_against_time", "online_errors", "step_times"}
    for found in marks.values():
        assert all(one.name.startswith(one.colour) for one in found) and len({one.name for one in found}) == 3
    hollow = {name: [one.name for one in found if one.dashed] for name, found in marks.items()}
    assert hollow == {**dict.fromkeys(drawn, ["latent, training"]), "step_times": []}


def test_marks_stand_at_the_numbers_of_their_run():
    fast = with_run("latent", online_error=error(0.8))
    drawn = comparison_figures(compared(run_of("x"), run_of("beam", simulate=fast))["runs"])
    tests = next(one for one in drawn["error_against_time"].series if one.name == "latent, test")
    assert tests.x == (0.243, 0.243) and tests.y == pytest.approx((33.13, 80.0))
    assert tests.labels == ("x", "beam") and drawn["online_errors"].y.names == ("x", "beam")
    links = [one for one in drawn["error_against_time"].series if one.kind == "link"]
    assert [(one.x, one.y) for one in links] == [
        ((4.09, 0.243), (pytest.approx(21.04), pytest.approx(end))) for end in (33.13, 80.0)
    ]


def test_runs_that_simulated_nothing_have_a_page_without_figures():
    nothing = {"simulate": {"full": [], "linear": [], "latent": []}, "cubature": {"latent": None, "linear": None}}
    page = page_of(run_of("x", **nothing, stages={}), run_of("torus", **nothing, stages={}))
    assert Outline(page) and 'class="plot"' not in page


# Reading


def write(folder: Path, content: str | None = None, **changes: Any) -> Path:
    (folder / "report").mkdir(parents=True)
    text = json.dumps(example_report() | changes) if content is None else content
    (folder / "report" / "report.json").write_text(text, encoding="utf-8")
    return folder


def test_runs_of_one_experiment_are_told_apart_by_their_folders(tmp_path):
    a, b, c = write(tmp_path / "a"), write(tmp_path / "b"), write(tmp_path / "c", experiment="beam")
    assert [run.name for run in read_runs([a, b, c])] == [str(a), str(b), "beam"]


def test_bad_runs_are_named_with_what_to_do(tmp_path):
    good, bare = write(tmp_path / "good"), tmp_path / "bare"
    bare.mkdir()
    file = tmp_path / "file"
    file.touch()
    old = example_report()
    del old["warnings"], old["dims"]["kp"]
    for folder, words in (
        (tmp_path / "none", "none does not exist or is no folder; expected one such as runs/demo"),
        (file, "file does not exist or is no folder"),
        (bare, "report.json does not exist; run `ldsim report CONFIG`"),
        (write(tmp_path / "cut", '{"experiment": "x"'), "report.json cannot be read"),
        (write(tmp_path / "old", json.dumps(old)), "dims.kp is missing (and 1 more); run `ldsim report CONFIG`"),
        (write(tmp_path / "list", "[]"), "is not what this version of ldsim writes"),
        (write(tmp_path / "deep", 10**5 * "["), "report.json cannot be read"),
        (tmp_path / "good" / ".." / "good", "is given 2 times; give each run once"),
    ):
        with pytest.raises(ArtefactError) as caught:
            read_runs([good, folder])
        assert words in str(caught.value)


@pytest.mark.parametrize("content", ['{"warnings": []}', "[]", "{", "[" * 10**5])
def test_a_comparison_replaces_no_other_json(tmp_path, content):
    (tmp_path / "a.json").write_text(content, encoding="utf-8")
    with pytest.raises(ExportError, match=r"a\.json, which its numbers would replace, is no comparison; give another"):
        compare([write(tmp_path / "run")], tmp_path / "a.html")
    assert (tmp_path / "a.json").read_text("utf-8") == content and not (tmp_path / "a.html").exists()


def test_a_comparison_replaces_an_earlier_one_and_not_the_numbers_of_a_run(tmp_path):
    a, b = write(tmp_path / "a"), write(tmp_path / "b", experiment="beam")
    for runs in ([a], [a, b]):
        compare(runs, tmp_path / "a.html")
        assert len(json.loads((tmp_path / "a.json").read_text("utf-8"))["runs"]) == len(runs)
    with pytest.raises(ExportError, match=r"report\.json, which its numbers would replace"):
        compare([a, b], a / "report" / "report.html")
    assert read_runs([a])[0].report == run_of("x").report

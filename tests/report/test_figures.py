"""Figures hold the run's own numbers; as files they are small, valid SVG whose words are text."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from xml.etree import ElementTree

import matplotlib
import numpy as np
import pytest
from scipy.stats import spearmanr

from ldsim.report.figure import MAX_POINTS, Axis, Figure, Guide, Series, curve, thinned
from ldsim.report.figures import draw_figures, training_history
from ldsim.report.numbers import collect, pooled_seconds
from ldsim.report.options import ReportOptions
from ldsim.report.svg import INK, PALETTE, drawn
from ldsim.report.wording import plain_number
from ldsim.space.novelty import Novelty
from tests.report.small_run import FRAMES, K, R, changed

SVG = "{http://www.w3.org/2000/svg}"
LONG = np.arange(1.0, 20001.0)
NOISE = np.exp(np.random.default_rng(3).normal(size=LONG.shape))


def every_kind() -> dict[str, tuple[Figure, tuple[str, ...]]]:
    """Name → a figure of long noisy data, and words that must stand in it."""
    log = Axis("number of modes", log=True)
    rows = Axis(names=("full", "latent"))
    marks = Series("median", "latent", (0.25, 138.0), (1, 0), "marks", "circle", labels=("0.25", "138"))
    link = Series("", "ink", (0.25, 138.0), (1, 1), "link")
    noise = curve("loss", "latent", LONG, NOISE)
    return {
        "curves": (
            Figure(
                "Curves", log, Axis("loss", log=True), (noise, curve("held-out", "linear", LONG, NOISE, dashed=True))
            ),
            ("number of modes", "loss", "held-out"),
        ),
        "guides": (
            Figure(
                "Guides",
                Axis("epoch"),
                Axis("error"),
                (noise,),
                guides=(Guide(3.0, "tolerance 3", at_start=True), Guide(10, "r = k = 10", "x"), Guide(2, "usual")),
            ),
            ("tolerance 3", "r = k = 10", "usual"),
        ),
        "right": (
            Figure(
                "Right",
                Axis("time, s"),
                Axis("error, mm", zero=True),
                (noise, curve("score", "second", LONG, NOISE, right=True, faint=True)),
                right=Axis("distance", zero=True),
                guides=(Guide(1, "warned of above 1", "right"),),
                shades={"grabbed": ((10.0, 900.0), (1000.0, 2000.0))},
            ),
            ("distance", "score (right)", "grabbed", "warned of above 1"),
        ),
        "rows": (Figure("Rows", log, rows, (marks, link)), ("full", "latent", "138", "0.25", "median")),
    }


FIGURES = every_kind()
DRAWN = {name: drawn(figure) for name, (figure, _) in FIGURES.items()}


def path_points(svg: str) -> list[int]:
    """Number of points of each path."""
    return [len(re.findall(r"[ML] ", path.get("d", ""))) for path in ElementTree.fromstring(svg).iter(f"{SVG}path")]


@pytest.mark.parametrize("name", FIGURES)
def test_a_file_is_a_small_valid_svg_with_a_title(name):
    root = ElementTree.fromstring(DRAWN[name])
    assert root.tag == f"{SVG}svg" and root.find(f"{SVG}title").text == FIGURES[name][0].title
    assert len(DRAWN[name]) < 100_000
    assert max(path_points(DRAWN[name])) <= MAX_POINTS


@pytest.mark.parametrize("name", FIGURES)
def test_words_are_text_in_the_pages_font(name):
    texts = {"".join(node.itertext()).strip() for node in ElementTree.fromstring(DRAWN[name]).iter(f"{SVG}text")}
    assert set(FIGURES[name][1]) <= texts
    assert "DejaVu" not in DRAWN[name]


@pytest.mark.parametrize("name", FIGURES)
def test_ink_follows_light_and_dark(name):
    assert "currentColor" in DRAWN[name] and INK not in DRAWN[name] and "prefers-color-scheme:dark" in DRAWN[name]


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_is_the_same_every_time(name):
    assert drawn(every_kind()[name][0]) == DRAWN[name]


def test_drawing_leaves_matplotlibs_settings_alone():
    before = dict(matplotlib.rcParams)
    drawn(FIGURES["right"][0])
    assert dict(matplotlib.rcParams) == before


def test_files_have_the_colours_of_the_pages():
    assert set(PALETTE) > {"full", "linear", "latent", "second", "ink"}
    assert len({PALETTE[space] for space in ("full", "linear", "latent", "second")}) == 4
    assert PALETTE["linear"] in DRAWN["curves"] and PALETTE["latent"] in DRAWN["curves"]


def test_a_legend_names_each_name_once():
    twice = replace(FIGURES["rows"][0], series=2 * FIGURES["rows"][0].series)
    assert drawn(twice).count(">median<") == drawn(FIGURES["rows"][0]).count(">median<") == 1


# The figures of a run


def test_every_number_of_a_figure_survives_json(run):
    for figure in draw_figures(run, 0.06).values():
        assert json.loads(json.dumps(figure.record(), allow_nan=False))["title"] == figure.title


def test_the_errors_against_k_are_those_of_the_basis_and_the_autoencoder(run):
    figure = draw_figures(run, 0.06)["error_against_k"]
    series = {one.name: one.y for one in figure.series}
    np.testing.assert_allclose(series["max, training"], 1000 * run.pca.max_error, rtol=1e-6)
    np.testing.assert_allclose(series["mean, validation"], 1000 * run.pca.validation_mean_error, rtol=1e-6)
    level = [guide for guide in figure.guides if guide.axis == "y"]
    np.testing.assert_allclose([guide.at for guide in level], 1000 * run.model.errors[0])
    assert [guide.text.split()[:2] for guide in level] == [["autoencoder", "max"], ["autoencoder", "mean"]]


def test_dimensions_that_coincide_share_a_line(run):
    guides = [guide for guide in draw_figures(run, 0.06)["singular_values"].guides if guide.axis == "x"]
    dimensions = {"r": R, "kp": run.model.kp, "k": K}
    assert {guide.at for guide in guides} == set(dimensions.values())
    assert all(
        set(guide.text.split(" = ")[:-1]) == {n for n, at in dimensions.items() if at == guide.at} for guide in guides
    )


def test_step_times_are_median_and_95th_percentile(run):
    figure = draw_figures(run, 0.06)["step_times"]
    times = {(figure.y.names[int(one.y[0])], one.name): one.x[0] for one in figure.series if one.kind == "marks"}
    for space in ("full", "linear", "latent"):
        seconds = pooled_seconds(run, space)
        assert times[(space, "median")] == pytest.approx(1000 * np.median(seconds))
        assert times[(space, "95th percentile")] == pytest.approx(1000 * np.percentile(seconds, 95))


def test_the_error_over_time_is_that_of_the_run_and_grabs_are_shaded(run):
    figure, h = draw_figures(run, 0.06)["online_error_push"], run.scene.time_step
    latent = next(one for one in figure.series if one.name == "latent")
    np.testing.assert_allclose(latent.x, h * np.arange(1, FRAMES["push"] + 1), rtol=1e-6)
    np.testing.assert_allclose(latent.y, 1000 * run.simulation["latent"]["push"].mean_error, rtol=1e-6)
    assert figure.shades == {"grabbed": ((pytest.approx(2 * h), pytest.approx(6 * h)),)}


def test_the_novelty_stands_beside_the_true_error(run):
    score = np.linspace(1.5, 0.5, FRAMES["push"])
    latent = run.simulation["latent"] | {"push": replace(run.simulation["latent"]["push"], novelty=score)}
    assert "novelty_push" not in draw_figures(run, 0.06)
    changed(run, "simulation", run.simulation | {"latent": latent})
    changed(run, "model", replace(run.model, novelty=Novelty(np.zeros((1, R)), 1.0, 1.25)))
    figures = draw_figures(run, 0.06)
    numbers = collect(run, ReportOptions(), {"seconds": 0.0, "peak_memory_mb": 0.0}).simulate.latent[1].novelty
    assert [name for name in figures if name.startswith("novelty")] == ["novelty_push"]
    figure = figures["novelty_push"]
    series = {one.name: one for one in figure.series}
    np.testing.assert_allclose(series["novelty score"].y, score, rtol=1e-6)
    assert series["novelty score"].right and not series["true error"].right
    assert [(guide.at, guide.axis, guide.text) for guide in figure.guides] == [(1.25, "right", "warned of above 1.25")]
    # the score falls, and its memory, which begins at zero, grows in so short a motion nevertheless, as time does
    clock = spearmanr(np.arange(FRAMES["push"]), run.simulation["latent"]["push"].mean_error).statistic
    assert f"(rank correlation: memory {clock:.2f}, time alone {clock:.2f})" in figure.x.label
    assert numbers.rank_correlation_remembered == numbers.rank_correlation_time == pytest.approx(clock)
    assert numbers.rank_correlation == pytest.approx(-clock)


def test_the_fit_of_a_condensed_space_is_not_told_in_epochs_and_its_second_curve_is_the_force_error(run):
    assert [one.name for one in training_history(run).series] == ["training", "validation"]
    columns = np.zeros((3 * run.scene.mesh.n_vertices, K))
    figure = training_history(changed(run, "model", replace(run.model, columns=columns)))
    assert figure.x.label == "share of the steps, %" and "force error" in figure.y.label
    fit, force = figure.series
    assert force.name == "force, poses kept back"
    np.testing.assert_allclose(fit.x, 100 * np.arange(1, 9) / 8)
    np.testing.assert_allclose([fit.y, force.y], run.model.loss.T, rtol=1e-6)


def test_a_figure_in_which_nothing_can_be_drawn_is_left_out(run):
    whole = draw_figures(run, 0.06)
    figures = draw_figures(changed(run, "model", replace(run.model, loss=np.zeros((8, 2)))), 0.06)
    assert set(figures) == set(whole) - {"training"}


@pytest.mark.parametrize(
    ("x", "y", "right", "shown"),
    [
        (Axis(), Axis(), None, True),
        (Axis(log=True), Axis(), None, False),
        (Axis(), Axis(log=True), None, False),
        (Axis(), Axis(), Axis(log=True), False),
        (Axis(), Axis(log=True), Axis(), True),
    ],
)
def test_a_logarithm_shows_no_zero_on_whichever_axis(x, y, right, shown):
    zero = Series("zero", "latent", (0.0,), (0.0,), right=right is not None)
    figure = Figure("Zero", x, y, (zero,), right=right)
    assert figure.shows_something == shown
    assert replace(figure, series=(zero, replace(zero, x=(1.0,), y=(1.0,)))).shows_something
    assert not replace(figure, series=()).shows_something


def test_a_run_that_diverged_ends_its_curve_and_not_the_figure():
    ended = curve("latent", "latent", np.arange(4.0), np.array([1.0, 2.0, np.inf, np.nan]))
    assert ended.x == (0, 1) and ended.y == (1, 2)
    svg = drawn(Figure("Ended", Axis("time, s"), Axis("error"), (ended,)))
    assert "nan" not in svg.lower() and "inf" not in re.sub("<title>.*?</title>", "", svg).lower()


def test_thinning_keeps_the_peaks_and_the_order():
    y = np.zeros(10_000)
    y[[17, 5003, 9998]] = [3.0, -7.0, 5.0]
    x, thin = thinned(np.arange(10_000.0), y)
    assert len(x) <= MAX_POINTS and np.all(np.diff(x) > 0)
    assert {3.0, -7.0, 5.0} <= set(thin)


def test_a_short_curve_is_not_thinned():
    x, y = thinned(np.arange(5.0), np.array([1.0, np.nan, 2.0, np.inf, 3.0]))
    assert x.tolist() == [0, 2, 4] and y.tolist() == [1, 2, 3]


def test_a_curve_of_unequal_lengths_is_refused():
    with pytest.raises(ValueError, match="expected twice the same"):
        thinned(np.arange(3.0), np.arange(4.0))
    with pytest.raises(ValueError, match="2 values of x, 1 of y and 0 labels"):
        Series("marks", "latent", (1.0, 2.0), (1.0,))


@pytest.mark.parametrize(
    ("value", "expected"),
    [(0.05, "0.05"), (2.0, "2"), (1000.0, "1\u2009000"), (1e-6, "10⁻⁶"), (2e-5, "2·10⁻⁵"), (0, "0")],
)
def test_tick_labels_are_short(value, expected):
    assert plain_number(value) == expected

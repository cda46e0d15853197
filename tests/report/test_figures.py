"""Figures are small, valid SVG whose words are text and whose curves keep their peaks."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import matplotlib
import numpy as np
import pytest

from ldsim.report.errors import ErrorSummary
from ldsim.report.figures import (
    CubatureCurve,
    ErrorCurve,
    StepTime,
    cubature_error,
    error_against_k,
    online_error_over_time,
    singular_values,
    step_times,
    training_history,
)
from ldsim.report.plotting import INK, LATENT, LINEAR, MAX_POINTS, plain_number, thinned

SVG = "{http://www.w3.org/2000/svg}"
LONG = np.arange(1.0, 20001.0)
NOISE = np.exp(np.random.default_rng(3).normal(size=LONG.shape))


def every_figure() -> dict[str, tuple[str, tuple[str, ...]]]:
    """Name → the figure of long noisy data, and words that must stand in it."""
    modes = np.arange(1.0, 101.0)
    curve = ErrorCurve(60 * np.exp(-modes / 14), 5 * np.exp(-modes / 14))
    ladder = np.array([8.0, 16.0, 64.0, 256.0])
    cubature = [CubatureCurve("latent", ladder, 1 / ladder, 2 / ladder), CubatureCurve("linear", ladder, 3 / ladder)]
    times = {"full": StepTime(138.0, 190.0), "linear": StepTime(4.12, 6.3), "latent": StepTime(0.241, 0.31)}
    marks = {"r": 10, "kp": 37, "k": 60}
    return {
        "error_against_k": (
            error_against_k(modes, curve, curve, marks, ErrorSummary(4.25, 0.147)),
            ("kp = 37", "autoencoder max 4.25 mm", "max, held-out", "number of PCA modes"),
        ),
        "singular_values": (singular_values(1 / LONG, {"r": 10, "k": 10}), ("r = k = 10", "mode")),
        "training": (training_history(LONG, NOISE, NOISE, 1 / LONG), ("training", "validation", "epoch")),
        "cubature": (cubature_error(cubature, 0.05), ("tolerance 0.05", "latent, held-out", "cubature points")),
        "step_times": (step_times(times), ("138", "4.12", "0.241", "full", "linear", "latent")),
        "online_error": (
            online_error_over_time(LONG, {"linear": NOISE, "latent": NOISE}, [(10.0, 900.0)]),
            ("grabbed", "linear", "latent", "time, s"),
        ),
    }


FIGURES = every_figure()


def path_points(svg: str) -> list[int]:
    """Number of points of each path."""
    return [len(re.findall(r"[ML] ", path.get("d", ""))) for path in ElementTree.fromstring(svg).iter(f"{SVG}path")]


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_is_a_small_valid_svg_with_a_title(name):
    svg, _ = FIGURES[name]
    root = ElementTree.fromstring(svg)
    assert root.tag == f"{SVG}svg" and root.find(f"{SVG}title").text
    assert len(svg) < 100_000
    assert max(path_points(svg)) <= MAX_POINTS


@pytest.mark.parametrize("name", FIGURES)
def test_words_are_text_in_the_pages_font(name):
    svg, words = FIGURES[name]
    texts = {"".join(node.itertext()).strip() for node in ElementTree.fromstring(svg).iter(f"{SVG}text")}
    assert set(words) <= texts
    assert "DejaVu" not in svg


@pytest.mark.parametrize("name", FIGURES)
def test_ink_follows_light_and_dark(name):
    svg, _ = FIGURES[name]
    assert "currentColor" in svg and INK not in svg and "prefers-color-scheme:dark" in svg


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_is_the_same_every_time(name):
    assert every_figure()[name] == FIGURES[name]


def test_drawing_leaves_matplotlibs_settings_alone():
    before = dict(matplotlib.rcParams)
    every_figure()
    assert dict(matplotlib.rcParams) == before


def test_spaces_keep_their_colours():
    svg, _ = FIGURES["step_times"]
    assert LINEAR in svg and LATENT in svg


def test_a_run_that_diverged_ends_its_curve_and_not_the_figure():
    curve = np.array([1.0, 2.0, np.inf, np.nan])
    svg = online_error_over_time(np.arange(4.0), {"latent": curve})
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


@pytest.mark.parametrize(
    ("value", "expected"),
    [(0.05, "0.05"), (2.0, "2"), (1000.0, "1\u2009000"), (1e-6, "10⁻⁶"), (2e-5, "2·10⁻⁵"), (0, "0")],
)
def test_tick_labels_are_short(value, expected):
    assert plain_number(value) == expected

"""Options of training: what is left out follows from kind and solid, and some say nothing to a kind."""

from __future__ import annotations

from typing import Any

import pytest

from ldsim.learn.options import CondensedOptions, TrainOptions

TOLD: dict[str, tuple[dict[str, Any], str]] = {
    "nothing given": ({}, ""),
    "a condensed space": ({"kind": "condensed", "r": 8, "hidden": (8,), "seed": 3, "condensed": {"rounds": 1}}, ""),
    "a default": ({"kind": "condensed", "epochs": TrainOptions().epochs}, ""),
    "epochs": (
        {"kind": "condensed", "epochs": 20},
        "note: train.epochs has no effect: train.kind is condensed",
    ),
    "no kind, which is condensed": ({"epochs": 20}, "note: train.epochs has no effect: train.kind is condensed"),
    "several": (
        {"kind": "condensed", "batch": 20, "epochs": 20, "equilibrium": {"weight": 1.0}},
        "note: train.equilibrium, train.epochs, train.batch have no effect: train.kind is condensed",
    ),
    "an autoencoder": ({"kind": "autoencoder", "epochs": 20, "r": 8}, ""),
    "poses to relax": (
        {"kind": "autoencoder", "condensed": {"poses": 20}},
        "note: train.condensed has no effect: train.kind is autoencoder",
    ),
}


@pytest.mark.parametrize(("given", "told"), TOLD.values(), ids=TOLD)
def test_what_was_given_to_no_effect_is_told(given: dict[str, Any], told: str) -> None:
    assert TrainOptions(**given).without_effect() == told


@pytest.mark.parametrize(("unknowns", "poses"), [(300, (400, 300)), (6000, (300, 225)), (90_000, (200, 150))])
def test_a_small_solid_is_shown_more_poses_up_to_twice_as_many(unknowns: int, poses: tuple[int, int]) -> None:
    condensed = TrainOptions().of_solid(2000, unknowns).condensed
    assert (condensed.poses, condensed.explored) == poses == CondensedOptions().relaxed(unknowns)


@pytest.mark.parametrize(("vertices", "width"), [(300, 48), (10_000, 48), (12_680, 80)])
def test_a_mesh_of_many_vertices_has_a_wider_decoder(vertices: int, width: int) -> None:
    found = TrainOptions().of_solid(vertices, 17_577)
    assert found.hidden == found.layers == (width, width, width, width)
    assert found.activation == found.nonlinearity == "tanh"


def test_an_autoencoder_is_the_same_of_every_solid() -> None:
    small, large = (TrainOptions(kind="autoencoder").of_solid(vertices, 3 * vertices) for vertices in (300, 30_000))
    assert small == large and (small.hidden, small.activation) == ((100, 100), "elu")
    assert small.condensed == CondensedOptions()


@pytest.mark.parametrize("kind", ["autoencoder", "condensed"])
def test_what_was_given_stays(kind: str) -> None:
    given = {"poses": 20, "explored": 7, "rounds": 1}
    options = TrainOptions.model_validate({"kind": kind, "hidden": [5], "activation": "relu", "condensed": given})
    found = options.of_solid(30_000, 90_000)
    assert found == options and (found.layers, found.nonlinearity) == ((5,), "relu")
    assert options.condensed.relaxed(300) == (20, 7)


def test_what_follows_from_a_solid_is_what_is_left_out_of_the_text() -> None:
    """Else a model would be stale as soon as what follows is written down, and not where the solid has changed."""
    assert TrainOptions.of_dump(TrainOptions().dump()) == TrainOptions()
    assert TrainOptions.of_dump(TrainOptions().of_solid(100, 300).dump()) != TrainOptions()

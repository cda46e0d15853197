"""Artefacts that are damaged, or made on purpose to mislead: each is refused in one line, before a loop reads it."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from ldsim.artefacts.sealed_file import datasets
from ldsim.artefacts.training import TrainingStore
from ldsim.errors import ArtefactError, LdsimError, SettingsError
from ldsim.learn.options import TrainOptions
from ldsim.run import Run
from ldsim.settings.make import _changed_files, changed_settings
from reproduction.faults import mutations
from tests.artefacts.examples import EXAMPLES
from tests.artefacts.test_artefacts import header, refusal
from tests.helpers import changed
from tests.simulator.playable import KP, K, R

FLIPS = 60
every_kind = pytest.mark.parametrize("kind", EXAMPLES)


@pytest.fixture
def artefact(kind: str, tmp_path: Path) -> Path:
    path = tmp_path / "run" / f"{kind}.h5"
    EXAMPLES[kind].write(path, header(kind))
    return path


@every_kind
def test_no_flipped_bit_goes_unnoticed(kind: str, artefact: Path) -> None:
    whole = artefact.read_bytes()
    rng = np.random.default_rng(len(kind))
    for place in rng.integers(0, 8 * len(whole), FLIPS):
        spoilt = bytearray(whole)
        spoilt[place // 8] ^= 1 << int(place % 8)
        artefact.write_bytes(spoilt)
        message = refusal(EXAMPLES[kind], artefact)
        assert "does not fit its checksum" in message or "is not a" in message


# Layouts that we never write: of each dataset of each kind, made so that the checksum fits.


NOT_OURS = "is external, virtual or filtered"
LAYOUTS = {
    "external": (mutations.external, f"{NOT_OURS}|there are 0"),
    "virtual": (mutations.virtual, NOT_OURS),
    "filtered": (mutations.filtered, NOT_OURS),
    "a link to another file": (mutations.linked_out, "is a link"),
    "a link to itself": (mutations.linked, "is a link"),
    "an object with two names": (mutations.doubled, "is a second name"),
    "a group that holds itself": (mutations.in_a_circle, "is a second name"),
    "a size that is only declared": (mutations.declared_only, "bytes, there are 0|expected"),
}


@every_kind
@pytest.mark.parametrize("case", LAYOUTS)
def test_a_layout_that_is_not_ours_is_refused_at_once(kind: str, case: str, artefact: Path) -> None:
    os.mkfifo(artefact.parent / "fifo.h5")
    change, words = LAYOUTS[case]
    with h5py.File(artefact) as file:
        name = next(iter(datasets(file)))
    with changed(artefact) as file:
        change(file, name)
    started = time.monotonic()
    message = refusal(EXAMPLES[kind], artefact)
    assert any(word in message for word in words.split("|")), message
    assert time.monotonic() - started < 10


# Attributes

ATTRIBUTES: dict[str, tuple[str, str, Any]] = {
    "inputs that are no JSON": ("*", "inputs", "{"),
    "inputs that are a list": ("*", "inputs", "[1]"),
    "inputs that are numbers": ("*", "inputs", '{"scene": 1}'),
    "a kind of bytes that are no text": ("*", "kind", np.void(b"\xff\xfe")),
    "an array for a number": ("*", "seed", np.arange(3)),
    "a text for a number": ("*", "seed", "one"),
    "a reference": ("*", "seconds", h5py.Reference()),
    "what a terminal obeys": ("*", "experiment", "\x1b]0;owned\x07"),
    "seconds that are no number": ("*", "seconds", np.nan),
    "seconds that are a text": ("*", "seconds", "text"),
    "an unknown inner product": ("basis", "inner_product", "other"),
    "no inner product": ("basis", "inner_product", None),
    "an unknown activation": ("model", "activation", "magic"),
    "no activation": ("model", "activation", None),
    "an unknown role": ("snapshots", "motions/a:role", "judge"),
    "a role that is a list": ("snapshots", "motions/a:role", np.arange(2)),
    "no place among the motions": ("snapshots", "motions/b:order", None),
    "frames that are not there": ("snapshots", "motions/a:frames", 10**9),
    "frames that are no number": ("snapshots", "motions/a:frames", "many"),
}


@pytest.mark.parametrize(
    ("kind", "case"),
    [(kind, case) for case, (which, _, _) in ATTRIBUTES.items() for kind in EXAMPLES if which in ("*", kind)],
)
def test_an_attribute_that_is_not_what_it_should_be_is_refused(kind: str, case: str, artefact: Path) -> None:
    _, name, value = ATTRIBUTES[case]
    with changed(artefact) as file:
        place, _, attribute = name.rpartition(":")
        attributes = file[place or "/"].attrs
        del attributes[attribute]
        if value is not None:
            attributes[attribute] = value
    assert artefact.name in refusal(EXAMPLES[kind], artefact)


# Sizes and numbers that do not fit, of a run that is otherwise whole


def put(name: str, change: Callable[[Any], Any]) -> Callable[[h5py.File], None]:
    """Replace a dataset by what is made of its values; add it, made of None, where there is none."""

    def spoil(file: h5py.File) -> None:
        values = file[name][()] if name in file else None
        if values is not None:
            del file[name]
        file[name] = change(values)

    return spoil


def set_in(name: str, value: float) -> Callable[[h5py.File], None]:
    def spoil(file: h5py.File) -> None:
        data = file[name]
        data[(0,) * data.ndim] = value

    return spoil


MISFITS: dict[str, tuple[str, Callable[[h5py.File], None]]] = {
    "biases cut short": ("model", put("decoder/biases_0", lambda b: b[:-1])),
    "weights that do not chain": ("model", put("decoder/weights_1", lambda w: w[:-1])),
    "a decoder of another k": ("model", lambda file: [put(f"decoder/{n}_1", lambda v: v[..., :-1])(file) for n in ("weights", "biases")]),  # noqa: E501
    "an encoder of another k": ("model", put("encoder/weights_0", lambda w: w[:-1])),
    "a skip of another r": ("model", put("skip", lambda _: np.zeros((R + 1, K)))),
    "landmarks of another r": ("model", lambda file: file.update(_novelty(R + 1))),
    "a reach of zero": ("model", lambda file: file.update(_novelty(R) | {"novelty/reach": 0.0})),
    "no threshold": ("model", lambda file: file.update(_novelty(R) | {"novelty/threshold": np.nan})),
    "kp of zero": ("model", put("kp", lambda _: np.int64(0))),
    "kp below zero": ("model", put("kp", lambda _: np.int64(-1))),
    "kp above k": ("model", put("kp", lambda _: np.int64(K + 1))),
    "a weight that is not a number": ("model", set_in("decoder/weights_0", np.nan)),
    "a layer more": ("model", put("decoder/weights_2", lambda _: np.eye(K))),
    "a layer under another number": ("model", lambda file: file.move("decoder/weights_1", "decoder/weights_7")),
    "U of another mesh": ("basis", put("U", lambda U: U[:-3])),
    "U with an infinite entry": ("basis", set_in("U", np.inf)),
    "a point out of range": ("cubature", set_in("latent/path_points", 10**6)),
    "a negative point": ("cubature", set_in("linear/path_points", -1)),
    "a virtual point out of range": ("cubature", set_in("latent/virtual_points", 10**6)),
    "a virtual point below zero": ("cubature", set_in("latent/virtual_points", -5)),
    "maps of another k": ("cubature", put("latent/virtual_maps", lambda maps: maps[:, :, :-1])),
    "a map that is not a number": ("cubature", set_in("latent/virtual_maps", np.nan)),
    "a weight of nothing": ("cubature", set_in("latent/path_weights", 0.0)),
    "a chosen rule that is not there": ("cubature", put("latent/chosen", lambda _: np.int64(9))),
    "a chosen rule below zero": ("cubature", put("linear/chosen", lambda _: np.int64(-1))),
    "sizes that do not add up": ("cubature", set_in("latent/path_sizes", 1)),
    "a negative size": ("cubature", set_in("latent/path_sizes", -1)),
    "only one space": ("cubature", lambda file: file.pop("linear")),
    "a cell of a vertex that is not there": ("scene", set_in("mesh/cells", 10**6)),
    "a negative vertex": ("scene", set_in("mesh/cells", -1)),
    "a vertex at infinity": ("scene", set_in("mesh/vertices", np.inf)),
    "a material that is not there": ("scene", set_in("material/kind", 99)),
    "lam that is not a number": ("scene", set_in("material/lam", np.nan)),
    "infinite gravity": ("scene", set_in("gravity", np.inf)),
    "an infinite time step": ("scene", put("time_step", lambda _: np.inf)),
    "a load that is not a number": ("scene", put("load", lambda _: np.full((20, 3), np.nan))),
    "cells of five vertices": ("scene", put("mesh/cells", lambda cells: np.hstack([cells, cells[:, :1]]))),
    "no pin": ("scene", put("pinned", np.zeros_like)),
    "nothing but pins": ("scene", put("pinned", np.ones_like)),
}  # fmt: skip


def _novelty(r: int) -> dict[str, Any]:
    return {"novelty/landmarks": np.zeros((2, r)), "novelty/reach": 1.0, "novelty/threshold": 2.0}


@pytest.mark.parametrize("case", MISFITS)
def test_what_does_not_fit_is_refused_before_a_space_is_made(own_run: Path, case: str) -> None:
    kind, change = MISFITS[case]
    with changed(own_run / f"{kind}.h5") as file:
        change(file)
    run = Run(own_run, "playable")
    with pytest.raises(ArtefactError) as caught:
        for space in ("linear", "latent"):
            run.space(space)
    assert f"{kind}.h5" in str(caught.value)
    assert "stale" not in str(caught.value)


def test_the_run_that_they_are_made_of_is_whole(playable: Path) -> None:
    run = Run(playable, "playable")
    assert (run.space("latent").r, run.space("linear").r) == (R, KP)


@pytest.mark.parametrize("what", ["columns", "decoder", "rule", "maps", "landmarks"])
def test_a_space_of_parts_that_do_not_belong_together_cannot_be_made(playable: Path, what: str) -> None:
    from dataclasses import replace

    from ldsim.cubature.rule import CubatureRule
    from ldsim.space.decoder import Decoder
    from ldsim.space.novelty import Novelty

    space = Run(playable, "playable").space("latent")
    ones = np.ones(1)
    changes: dict[str, dict[str, Any]] = {
        "decoder": {"decoder": Decoder.identity(K - 1)},
        "rule": {"rule": CubatureRule(np.array([10**6]), ones, 0.0)},
        "maps": {"rule": CubatureRule(np.array([0]), ones, 0.0, np.ones((1, 9, K + 1)))},
        "landmarks": {"novelty": Novelty(np.zeros((1, R + 2)), 1.0, 1.0)},
    }
    with pytest.raises(LdsimError):
        if what == "columns":
            space.reduced_basis.columns(K + 1)
        replace(space, **changes[what])


@pytest.mark.parametrize(
    "change", [lambda file: file.pop("mean"), put("mean", lambda m: m[1:]), put("more", lambda _: 1.0)]
)
def test_a_checkpoint_that_lacks_something_is_none(tmp_path: Path, change: Callable[[h5py.File], object]) -> None:
    """Found by the campaign: it fitted its checksum, and `ldsim train` ended with a KeyError."""
    store, arrays = TrainingStore(tmp_path, "r3", "this one"), {"mean": np.arange(3.0), "best": np.float64(2.0)}
    store.save(arrays)
    kept = store.load()
    assert kept is not None and {name: values.tolist() for name, values in kept.items()} == {
        "mean": [0, 1, 2],
        "best": 2,
    }
    with changed(tmp_path / "r3.checkpoint.h5") as file:
        change(file)
    assert store.load() is None


OF_HEADERS = {
    "a key that is none": "condensed: {pkses: 300}",
    "no YAML": "k: [",
    "a date that does not exist": "date: 2026-02-30",
    "a list": "[1, 2]",
    "an alias of itself": "a: &a [*a]",
}


@pytest.mark.parametrize("case", OF_HEADERS)
def test_settings_of_a_header_that_are_none_are_refused(case: str) -> None:
    """Found by the campaign: `ldsim report` ended with a ValidationError."""
    with pytest.raises(SettingsError) as caught:
        TrainOptions.of_dump(OF_HEADERS[case])
    assert "\n" not in str(caught.value)
    assert changed_settings(OF_HEADERS[case], TrainOptions())


def test_files_of_a_header_that_are_none_have_changed() -> None:
    for text in ("{", "[1]", "1", '{"a": '):
        assert _changed_files(text, "{}") == ["files"]


def test_a_damaged_simulation_is_not_taken_for_none(own_run: Path) -> None:
    """Found by the campaign: `ldsim export` took another space than simulate had chosen, without a word."""
    assert Run(own_run, "playable").chosen == "latent"
    (own_run / "simulation.h5").write_bytes(b"damaged")
    with pytest.raises(ArtefactError, match="simulation.h5"):
        _ = Run(own_run, "playable").chosen

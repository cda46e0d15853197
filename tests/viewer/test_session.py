"""The session: a space that is turned on goes on where the others are, and beside the full one it is judged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ldsim.simulator import Simulator, load
from ldsim.viewer import protocol
from ldsim.viewer.session import Session, rounded_up
from ldsim.viewer.state import Audience, Errors


def session_of(playable: Path, said: list[str]) -> Session:
    session = Session(lambda space: load(playable, space), ["latent", "linear", "full"], [load(playable, "linear")])
    session._audience = Audience(lambda _: None, lambda _, __: None, lambda _: None, said.append)
    return session


def pull(session: Session, simulator: Simulator) -> None:
    tip = simulator.surface.rest[simulator.surface.rest[:, 0].argmax()]
    to = tip + [0.0, 0.05, 0.0]
    session.tell(1, protocol.GrabMessage(id=5, point=tuple(tip.tolist()), target=tuple(to.tolist())))
    session.obey()


def test_a_space_that_is_turned_on_takes_over_pose_pulls_and_time(playable: Path) -> None:
    session = session_of(playable, [])
    (linear,) = session._shown
    pull(session, linear)
    for _ in range(6):
        session.step()
    before = linear.displacement()
    session.tell(1, protocol.SpacesMessage(value=("linear", "full")))
    session.obey()
    full = session._shown[1]
    assert session._shown[0] is linear and np.abs(before).max() > 1e-3
    np.testing.assert_array_equal(linear.displacement(), before)
    np.testing.assert_allclose(full.displacement(), before, atol=1e-9)
    np.testing.assert_allclose(full.velocity(), linear.velocity(), atol=1e-6)
    assert session._simulated == pytest.approx(6 * linear.scene.time_step) and full.time == linear.time
    (held,) = session._held.values()
    assert [handle.grab.target.tolist() for handle in held.handles] == [held.target.tolist()] * 2
    session.tell(1, protocol.ReleaseMessage(id=5))
    session.obey()
    assert not linear.grabs and not full.grabs


def test_beside_the_full_space_the_error_is_told_now_and_so_far(playable: Path) -> None:
    linear, full = load(playable, "linear"), load(playable, "full")
    errors, off, moved = Errors(), [], []
    assert np.isnan(errors.of("linear")).all()
    for _ in range(4):
        linear.step()
        full.step()
        errors.add([linear, full])
        off.append(np.linalg.norm(linear.displacement() - full.displacement(), axis=1).mean())
        moved.append(np.linalg.norm(full.displacement(), axis=1).mean())
    assert errors.of("linear") == (pytest.approx(off[-1]), pytest.approx(sum(off) / sum(moved)))
    assert np.isnan(errors.of("full")).all()
    errors.add([linear])
    assert np.isnan(errors.of("linear")).all()


def test_a_pull_at_a_pinned_place_is_told(playable: Path) -> None:
    said: list[str] = []
    session = session_of(playable, said)
    scene = session._shown[0].scene
    point = tuple(scene.mesh.vertices[scene.pinned][0].tolist())
    session.tell(1, protocol.GrabMessage(id=1, point=point, target=point))
    session.obey()
    assert len(said) == 1 and "pinned" in said[0]


@pytest.mark.parametrize(("value", "expected"), [(0.0, 0.0), (1.0, 1.0), (1.01, 2.0), (420.0, 500.0), (0.0051, 0.01)])
def test_the_scale_of_colours_grows_by_round_steps(value: float, expected: float) -> None:
    assert rounded_up(value) == pytest.approx(expected)

"""Motions and solvers that `ldsim snapshot` and the stages after it refuse in one line."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.cli.experiments import TINY, Experiment, refusal

RECORDING = """# spring_stiffness_n_per_m: 30
# grab_radius_m: 0.03
is_dragging,target_x,target_y,target_z,grabbed_x,grabbed_y,grabbed_z
{rows}
"""
MISS = "\n".join(["0,0,0,0,0,0,0", "1,9,0,0,9,0,0", "1,9,0,0,9,0,0"])


def recording(content: str | None) -> Callable[[Experiment], None]:
    def spoil(experiment: Experiment) -> None:
        if content is not None:
            (experiment.folder / "a.csv").write_text(content, encoding="utf-8")
        experiment.change("snapshot.motions", [{"name": "a", "recording": "a.csv"}])

    return spoil


MOTIONS: dict[str, tuple[Callable[[Experiment], None], str]] = {
    "missing": (recording(None), "a.csv does not exist"),
    "empty": (recording(""), "holds no frames"),
    "without a column": (recording("is_dragging,target_x\n1,2\n"), "lacks the column 'target_y'"),
    "without a stiffness": (recording(RECORDING.format(rows=MISS).split("\n", 1)[1]), "needs a line '# spring_stiff"),
    "not numbers": (recording(RECORDING.format(rows="1,a,b,c,d,e,f")), "does not hold seven numbers"),
    "not finite": (recording(RECORDING.format(rows="1,nan,0,0,0,0,0")), "not finite"),
    "a grab that hits no vertex": (recording(RECORDING.format(rows=MISS)), "hits no vertex"),
    "a grab of pinned vertices": (recording(RECORDING.format(rows="1,0,-1,0,0.09,-0.075,0")), "only pinned vertices"),
}


@pytest.mark.parametrize("case", MOTIONS)
def test_a_bad_motion(experiment: Experiment, case: str) -> None:
    spoil, words = MOTIONS[case]
    spoil(experiment)
    if case == "a grab of pinned vertices":
        text = experiment.folder / "a.csv"
        text.write_text(text.read_text().replace("grab_radius_m: 0.03", "grab_radius_m: 0.001"))
    assert words in refusal(experiment, "snapshot")


def test_a_motion_to_simulate_that_no_one_ran(experiment: Experiment) -> None:
    motions = [*TINY["snapshot"]["motions"], TINY["snapshot"]["motions"][1] | {"name": "z"}]
    experiment.configure(TINY | {"snapshot": TINY["snapshot"] | {"motions": motions}, "simulate": {"motions": ["z"]}})
    assert "simulate.motions names 'z'; the snapshots hold a, b" in refusal(experiment, "simulate")


# The solver of the full space


def test_a_factor_larger_than_the_memory(experiment: Experiment, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ldsim.dynamics.full.linear_choice.physical_memory", lambda: 1000.0)
    experiment.configure(TINY | {"snapshot": TINY["snapshot"] | {"linear_solver": "direct"}})
    message = refusal(experiment, "snapshot")
    assert "snapshot.linear_solver is direct" in message and "use multigrid or fewer workers" in message

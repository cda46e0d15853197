"""`ldsim cubature`: what it tells, what its exit status means, and which of its sets `simulate` takes."""

from __future__ import annotations

import pytest

from ldsim.artefacts.records import read_cubature
from ldsim.artefacts.simulation import read_simulation
from ldsim.cli.cubature import MISSED
from ldsim.errors import ArtefactError
from tests.cli.experiments import TINY, Experiment
from tests.helpers import changed

CUBATURE = TINY["cubature"]


def test_it_tells_and_stores_the_errors_on_fitted_held_out_and_perturbed_poses(experiment: Experiment) -> None:
    result = experiment.invoke("cubature")
    spaces, _ = read_cubature(experiment.run / "cubature.h5")
    for space, stored in spaces.items():
        errors = stored.best.training_error, stored.best.heldout_error, stored.best.perturbed_error
        words = "{:.3f}, kept back {:.3f}, perturbed {:.3f}".format(*errors)
        assert f"{space}: {len(stored.best.points)} points, relative error {words}" in result.stdout
    found = spaces["latent"].virtual
    assert found is not None
    errors = found.rule.training_error, found.rule.heldout_error, found.rule.perturbed_error
    words = "{:.3f}, kept back {:.3f}, perturbed {:.3f}".format(*errors)
    assert f"; {len(found.rule.points)} virtual points, relative error {words}" in result.stdout
    assert spaces["linear"].virtual is None


def test_a_missed_tolerance_is_told_by_the_status_and_costs_no_artefact(experiment: Experiment) -> None:
    experiment.configure(TINY | {"cubature": CUBATURE | {"tolerance": 1e-6, "max_points": 3}})
    result = experiment.invoke("cubature")
    assert result.exit_code == MISSED
    assert "warning: the latent cubature reached a relative error of" in result.stderr
    assert "with 3 points, asked were 1e-06 with at most 3; it was written all the same" in result.stderr
    spaces, _ = read_cubature(experiment.run / "cubature.h5")
    assert len(spaces["latent"].best.points) == 3
    assert experiment.invoke("simulate").exit_code == 0


@pytest.mark.parametrize(
    "options", [{"method": "ecsw"}, {"project": "linear"}, {"terms": {"closure": 0.2}, "norm": "force"}]
)
def test_other_options_give_other_points(experiment: Experiment, options: dict[str, object]) -> None:
    before, _ = read_cubature(experiment.run / "cubature.h5")
    experiment.configure(TINY | {"cubature": CUBATURE | options})
    assert experiment.invoke("cubature").exit_code in (0, MISSED)
    after, _ = read_cubature(experiment.run / "cubature.h5")
    assert after["latent"].best.weights.tolist() != before["latent"].best.weights.tolist()


def test_simulate_takes_the_set_of_so_many_points(experiment: Experiment) -> None:
    def coordinates(**settings: int) -> list[float]:
        experiment.configure(TINY | {"simulate": TINY["simulate"] | settings})
        assert experiment.invoke("simulate").exit_code == 0
        runs, _ = read_simulation(experiment.run / "simulation.h5")
        found = runs["latent"]["a"].coordinates
        assert found is not None
        return found[-1].round(9).tolist()

    stored = read_cubature(experiment.run / "cubature.h5")[0]["latent"]
    most, virtual = len(stored.best.points), coordinates()
    on_mesh = coordinates(points=most)
    assert coordinates(points=1) != pytest.approx(on_mesh, abs=1e-6)
    assert on_mesh != pytest.approx(virtual, abs=1e-6)
    experiment.configure(TINY | {"cubature": CUBATURE | {"virtual": {"points": 0}}})
    assert experiment.invoke("cubature").exit_code == 0
    assert read_cubature(experiment.run / "cubature.h5")[0]["latent"].virtual is None
    assert coordinates() == pytest.approx(on_mesh, abs=1e-6)


def test_a_chosen_rule_that_is_not_on_the_path_is_refused(experiment: Experiment) -> None:
    path = experiment.run / "cubature.h5"
    with changed(path) as file:
        sizes = len(file["latent/path_sizes"])
        file["latent/chosen"][...] = sizes
    with pytest.raises(ArtefactError, match=rf"dataset 'latent/chosen': found {sizes}, expected 0 … {sizes - 1}"):
        read_cubature(path)


def test_another_material_is_stepped_with_points_of_the_mesh(experiment: Experiment) -> None:
    def coordinates(cubature: dict[str, object], **settings: object) -> list[float]:
        experiment.configure(TINY | {"cubature": CUBATURE | cubature, "simulate": TINY["simulate"] | settings})
        assert experiment.invoke("cubature").exit_code == 0
        assert experiment.invoke("simulate").exit_code == 0
        found = read_simulation(experiment.run / "simulation.h5")[0]["latent"]["a"].coordinates
        assert found is not None
        return found[-1].round(9).tolist()

    softer = {"material": {"youngs_modulus": 3.0e4}}
    assert coordinates({}, **softer) == pytest.approx(coordinates({"virtual": {"points": 0}}, **softer), abs=1e-6)

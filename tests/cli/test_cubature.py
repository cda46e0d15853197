"""`ldsim cubature`: what it tells, what its exit status means, and which of its sets `simulate` takes."""

from __future__ import annotations

import pytest

from ldsim import Run, load
from ldsim.artefacts.records import read_cubature, read_simulation
from ldsim.cli.cubature import MISSED
from ldsim.errors import ArtefactError
from tests.cli.experiments import TINY, Experiment, refusal
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


def test_linear_spaces_get_what_the_latent_one_gets(experiment: Experiment) -> None:
    """Rules of every size and virtual points with every closure judged, for kp columns and for each other size."""
    with Run.open(experiment.run) as run:
        kp = run.model.kp
    sizes = [k for k in (2, 5) if k != kp]
    experiment.configure(TINY | {"cubature": CUBATURE | {"linear_sizes": sizes}})
    result = experiment.invoke("cubature")
    assert result.exit_code in (0, MISSED)
    with Run.open(experiment.run) as run:
        assert set(run.cubature) == {"latent", "linear", *(f"linear_{k}" for k in sizes)}
        for name, stored in run.cubature.items():
            space = run.space(name)
            assert space.name == name and space.rule.points.tolist() == stored.stepped().points.tolist()
            assert space.decoder.k == (run.basis.k if name == "latent" else kp if name == "linear" else int(name[7:]))
            judged = stored.virtual is None or stored.virtual.judged[1:, 0].tolist() == [0.0, 1.0]
            refused = f"no virtual points for the {name} space" in result.stderr
            assert judged and refused is (stored.virtual is None)


def test_linear_spaces_can_have_no_more_points_than_the_latent_one(experiment: Experiment) -> None:
    few = {"method": "an", "max_points": 4, "virtual": {"points": 0}, "equal_points": True}
    experiment.configure(TINY | {"cubature": CUBATURE | few})
    assert experiment.invoke("cubature").exit_code in (0, MISSED)
    spaces, _ = read_cubature(experiment.run / "cubature.h5")
    assert max(len(stored.best.points) for stored in spaces.values()) == len(spaces["latent"].best.points)


def test_a_size_beyond_the_basis_is_refused(experiment: Experiment) -> None:
    experiment.configure(TINY | {"cubature": CUBATURE | {"linear_sizes": [7]}})
    assert "cubature.linear_sizes has 7; the basis has 6 columns" in refusal(experiment, "cubature")


def test_simulate_chooses_a_space_that_load_then_takes(experiment: Experiment) -> None:
    with Run.open(experiment.run) as run:
        chosen = run.chosen
        assert chosen in run.simulation and load(experiment.run).space.name == chosen
    experiment.configure(TINY | {"simulate": TINY["simulate"] | {"space": "latent"}})
    assert experiment.invoke("simulate").exit_code == 0
    assert load(experiment.run).space.name == "latent"
    (experiment.run / "simulation.h5").unlink()
    assert load(experiment.run).space.name == "latent"


def test_a_missed_tolerance_is_told_by_the_status_and_costs_no_artefact(experiment: Experiment) -> None:
    experiment.configure(TINY | {"cubature": CUBATURE | {"tolerance": 1e-6, "max_points": 3}})
    result = experiment.invoke("cubature")
    assert result.exit_code == MISSED
    assert "warning: the latent cubature has a relative error of" in result.stderr
    assert "with 3 points; asked were 1e-06 with at most 3; it was written all the same" in result.stderr
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
    assert experiment.invoke("cubature").exit_code in (0, MISSED)
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
        assert experiment.invoke("cubature").exit_code in (0, MISSED)
        assert experiment.invoke("simulate").exit_code == 0
        found = read_simulation(experiment.run / "simulation.h5")[0]["latent"]["a"].coordinates
        assert found is not None
        return found[-1].round(9).tolist()

    softer = {"material": {"youngs_modulus": 3.0e4}}
    assert coordinates({}, **softer) == pytest.approx(coordinates({"virtual": {"points": 0}}, **softer), abs=1e-6)

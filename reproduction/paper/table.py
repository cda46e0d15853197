"""The experiments of the paper. To add one, write a function that takes a `Harness` and list it here."""

from __future__ import annotations

from reproduction.paper.behaviour import (
    cubature_against_every_element,
    local_pull,
    material_after_training,
    one_cubature_point,
)
from reproduction.paper.convergence import convergence
from reproduction.paper.experiment import Experiment
from reproduction.paper.pendulum import larger_bends, one_coordinate_is_enough
from reproduction.paper.sizes import depth, latent_and_outer_size
from reproduction.paper.timing import armadillo_speed, profile, table_one
from reproduction.paper.training_modes import training_modes

EXPERIMENTS: dict[str, Experiment] = {
    "table1": Experiment("dimensions and step times, latent against linear", table_one),
    "fig2": Experiment("one latent coordinate holds the arc that takes two linear ones", one_coordinate_is_enough),
    "fig3": Experiment("at equal degrees of freedom the autoencoder follows larger bends", larger_bends),
    "fig5": Experiment("four ways to train the autoencoder and its outer layers", training_modes),
    "fig6": Experiment("depth of the network against error and step time", depth),
    "fig7": Experiment("error against latent and outer dimension", latent_and_outer_size),
    "fig9": Experiment("quasi-static convergence in the latent, the linear and the full space", convergence),
    "fig10": Experiment("the catapult with a single cubature point", one_cubature_point),
    "fig11": Experiment("the dragon against full space, with and without cubature", cubature_against_every_element),
    "fig12": Experiment("evaluations a step and the cost of one", profile),
    "fig13": Experiment("the armadillo, r = 20 against PCA of equal error", armadillo_speed),
    "fig14": Experiment("a bar against full space, and its material changed after training", material_after_training),
    "fig15": Experiment("a local pull that a reduced space answers globally", local_pull),
}

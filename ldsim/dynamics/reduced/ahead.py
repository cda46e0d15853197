"""Compile the reduced step before it is needed: `python -m ldsim.dynamics.reduced.ahead`, beside stages without one.

It takes a minute, once, on one core, in which the stages mesh and snapshot of `ldsim make` leave one idle.
"""

from __future__ import annotations

import numpy as np

from ldsim.dynamics.reduced.stepper import ReducedStepper
from ldsim.mechanics.loads import Loads
from ldsim.mechanics.properties import Properties
from ldsim.mechanics.scene import make_scene
from ldsim.mesh.mesh import Mesh
from ldsim.space.basis import Basis
from ldsim.space.space import Space


def compile_step() -> None:
    """Step a single tetrahedron once: what is compiled is the same for every solid and space, and is kept."""
    mesh = Mesh(np.eye(4, 3), np.array([[3, 0, 1, 2]]), "tet4")
    one = np.ones(1)
    properties = Properties(np.zeros(1, dtype=np.int8), 1e4 * one, 0.3 * one, 1e3 * one)
    scene = make_scene(mesh, np.array([True, True, True, False]), properties, (0.0, 0.0, -9.8), 0.005)
    fields = np.eye(12)[:, 9:]  # of the vertex that is free
    space = Space.linear(scene, Basis.of(fields, scene.mass), 3)
    stepper = ReducedStepper(space)
    stepper.step(stepper.rest(), Loads())


if __name__ == "__main__":
    compile_step()

"""What each kind of artefact holds: every dataset with its type and shape, for checks and for the reference page.

A shape is a tuple of numbers and symbols; the same symbol has the same value throughout a file. `*` in a path stands
for a name, and symbols inside such a group are its own, but for those of `SHARED`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ldsim.mechanics.materials import MATERIALS
from ldsim.optimise.solution import Reason

SCHEMA_VERSION = 4
# Vertices: of one mesh throughout a run.
SHARED = ("n",)


@dataclass(frozen=True)
class Allowed:
    """Which numbers a dataset may hold.

    Attributes:
        words: for messages and for the reference page.
        least: the smallest. below: what all are smaller than, a number or the symbol of a size.
        finite: whether NaN and infinity are refused.
    """

    words: str
    least: float = -math.inf
    below: float | str = math.inf
    finite: bool = True


def index(below: str | int) -> Allowed:
    """Numbers from 0 up to a size, which is left out."""
    return Allowed(f"0 … {f'{below} − 1' if isinstance(below, str) else below - 1}", 0, below)


FINITE = Allowed("finite")
POSITIVE = Allowed("> 0", math.ulp(0.0))
COUNT = Allowed("≥ 0", 0)
MEASURED = Allowed("≥ 0, or NaN or infinite", 0, finite=False)
ANY = Allowed("", finite=False)


@dataclass(frozen=True)
class Dataset:
    """One dataset: path, numpy type code, shape in symbols, unit and meaning."""

    path: str
    dtype: str
    shape: tuple[int | str, ...]
    unit: str
    meaning: str
    optional: bool = False

    @property
    def allowed(self) -> Allowed:
        """Which numbers it may hold."""
        return next((allowed for allowed, paths in VALUES.items() if self.path in paths.split()), FINITE)


_RULES = (
    Dataset("*/chosen", "i8", (), "", "number of the rule that the fit was for, from 0, among those of the path"),
    Dataset("*/path_sizes", "i8", ("l",), "", "points of each rule of the path"),
    Dataset("*/path_errors", "f8", ("l", 2), "", "their relative error on fitted poses and those kept back"),
    Dataset("*/path_perturbed_errors", "f8", ("l",), "", "their relative error on perturbed poses"),
    Dataset("*/path_points", "i8", ("a",), "", "the points of all rules, indices of quadrature points, rule by rule"),
    Dataset("*/path_weights", "f8", ("a",), "m³", "their weights, > 0"),
    Dataset("*/virtual_points", "i8", ("v",), "", "quadrature points whose materials the virtual points have", True),
    Dataset("*/virtual_weights", "f8", ("v",), "m³", "their weights, > 0", True),
    Dataset("*/virtual_maps", "f8", ("v", 9, "k"), "1/m", "their strain maps ∂F/∂q, F row by row", True),
    Dataset("*/virtual_material", "i8", (), "", "number of the material of all of them, where not their points'", True),
    Dataset("*/virtual_errors", "f8", (3,), "", "their error on fitted, kept-back and perturbed poses", True),
    Dataset("*/virtual_closure", "f8", (), "", "share of the true poses' forces that they were fitted to", True),
    Dataset(
        "*/virtual_judged",
        "f8",
        ("t", 2),
        "",
        "closures tried and their windowed online errors; NaN: the chosen rule on the mesh",
        True,
    ),
)

_MOTION = (
    Dataset("motions/*/displacements", "f4", ("N", "n", 3), "m", "displacement of every vertex after each frame"),
    Dataset("motions/*/drag_start", "i8", ("D",), "frame", "first frame of each drag"),
    Dataset("motions/*/drag_frames", "i8", ("D",), "", "number of frames of each drag"),
    Dataset("motions/*/drag_point", "f8", ("D", 3), "m", "where the drag takes hold"),
    Dataset("motions/*/drag_radius", "f8", ("D",), "m", "vertices within it are held"),
    Dataset("motions/*/drag_stiffness", "f8", ("D",), "N/m", "of the spring on their centroid"),
    Dataset("motions/*/drag_at_rest", "?", ("D",), "", "whether the point is on the rest shape"),
    Dataset("motions/*/targets", "f8", ("T", 3), "m", "pointer in each frame of each drag, one drag after another"),
    Dataset("motions/*/held", "i8", ("H",), "", "held vertices, one drag after another"),
    Dataset("motions/*/held_count", "i8", ("D",), "", "number of held vertices of each drag"),
    Dataset("motions/*/gravity", "f8", ("N", 3), "m/s²", "in each frame; absent where it is the scene's own", True),
    Dataset(
        "motions/*/support_maps", "f8", ("S", "N", 3, 4), "", "x = A X + b of moving pins as (A | b); b in m", True
    ),
    Dataset("motions/*/support_vertices", "i8", ("V",), "", "moving pins, one support after another", True),
    Dataset("motions/*/support_count", "i8", ("S",), "", "number of vertices of each support", True),
    Dataset("motions/*/iterations", "i8", ("N",), "", "of the solver in each frame"),
    Dataset("motions/*/evaluations", "i8", ("N",), "", "of the potential in each frame"),
    Dataset("motions/*/reason", "i8", ("N",), "", "why the solver stopped (0 converged)"),
    Dataset("motions/*/seconds", "f8", ("N",), "s", "wall time of each frame; motions may have run side by side"),
)

_RUN = (
    Dataset("runs/*/*/coordinates", "f8", ("N", "k"), "", "q after each frame; absent for the full space", True),
    Dataset("runs/*/*/latent", "f8", ("N", "r"), "", "z after each frame, latent space only", True),
    Dataset("runs/*/*/iterations", "i8", ("N",), "", "of the minimiser in each frame"),
    Dataset("runs/*/*/evaluations", "i8", ("N",), "", "of the potential in each frame"),
    Dataset("runs/*/*/reason", "i8", ("N",), "", "why the minimiser stopped (0 converged)"),
    Dataset("runs/*/*/seconds", "f8", ("N",), "s", "of each step, alone on the machine"),
    Dataset("runs/*/*/mean_error", "f8", ("N",), "m", "mean vertex distance to the full space", True),
    Dataset("runs/*/*/max_error", "f8", ("N",), "m", "largest vertex distance to the full space", True),
    Dataset("runs/*/*/windowed_mean_error", "f8", ("N",), "m", "the same, restarted every window", True),
    Dataset("runs/*/*/novelty", "f8", ("N",), "", "distance to the training codes, latent space only", True),
    Dataset("runs/*/*/mean_displacement", "f8", ("N",), "m", "mean displacement of the full space", True),
)

_FRESH = (Dataset("fresh/*", "f8", ("F",), "", "online error of each fresh motion, infinite where it was lost", True),)

SCHEMAS: dict[str, tuple[Dataset, ...]] = {
    "scene": (
        Dataset("mesh/vertices", "f8", ("n", 3), "m", "rest positions"),
        Dataset("mesh/cells", "i4", ("m", "a"), "", "vertices of each cell, VTK's order"),
        Dataset("quadrature/nodes", "i4", ("s", "a"), "", "vertices of each quadrature point"),
        Dataset("quadrature/gradients", "f8", ("s", "a", 3), "1/m", "shape-function gradients"),
        Dataset("quadrature/weights", "f8", ("s",), "m³", "volume of each point"),
        Dataset("quadrature/cells", "i4", ("s",), "", "cell of each point"),
        Dataset("material/kind", "i1", ("m",), "", "number of the material of each cell"),
        Dataset("material/mu", "f8", ("m",), "Pa", "shear modulus of each cell"),
        Dataset("material/lam", "f8", ("m",), "Pa", "Lamé's first parameter of each cell"),
        Dataset("material/density", "f8", ("m",), "kg/m³", "density of each cell"),
        Dataset("pinned", "?", ("n",), "", "vertices that do not move"),
        Dataset("gravity", "f8", (3,), "m/s²", "acceleration"),
        Dataset("time_step", "f8", (), "s", "h"),
        Dataset("load", "f8", ("n", 3), "N", "dead load on each vertex besides its weight", True),
        Dataset("groups/*/vertices", "i8", ("v",), "", "vertices of a group of the mesh file", True),
        Dataset("groups/*/cells", "i8", ("c",), "", "its cells; none where it is of faces, edges or points", True),
    ),
    "snapshots": _MOTION,
    "tests": _MOTION,
    "basis": (
        Dataset("U", "f8", ("d", "k"), "", "columns orthonormal in the inner product, d = 3n"),
        Dataset("singular_values", "f8", ("N",), "", "of the training snapshots"),
        Dataset("max_error", "f8", ("e",), "m", "largest vertex error with 0 … k columns, training"),
        Dataset("mean_error", "f8", ("e",), "m", "mean vertex error with 0 … k columns, training"),
        Dataset("validation_max_error", "f8", ("e",), "m", "the same on validation motions", True),
        Dataset("validation_mean_error", "f8", ("e",), "m", "the same on validation motions", True),
        Dataset("synthetic", "f4", ("f", "k"), "kg^½ m", "coordinates of synthetic motions, learned from too", True),
    ),
    "model": (
        Dataset("decoder/weights_*", "f8", ("i", "o"), "", "of each layer, inputs by outputs"),
        Dataset("decoder/biases_*", "f8", ("o",), "", "of each layer"),
        Dataset("skip", "f8", ("r", "k"), "", "Aᵀ of the decoder's linear skip", True),
        Dataset("encoder/weights_*", "f8", ("i", "o"), "", "of each layer, inputs by outputs"),
        Dataset("encoder/biases_*", "f8", ("o",), "", "of each layer"),
        Dataset("columns", "f8", ("d", "k"), "", "basis of a condensed space, d = 3n: V, features, slaved part", True),
        Dataset("squares", "f8", ("w",), "1/s²", "ω² of the last columns, modes that swing beside z", True),
        Dataset("turns", "?", (), "", "whether what these have of a dent turns with the place that is held", True),
        Dataset("potential/points", "i8", ("v",), "", "quadrature points whose moduli the virtual points have", True),
        Dataset("potential/weights", "f8", ("v",), "m³", "of the virtual points of V_eff, > 0", True),
        Dataset("potential/maps", "f8", ("v", 9, "k"), "1/m", "their strain maps ∂F/∂q, F row by row", True),
        Dataset("potential/material", "i8", (), "", "number of their material", True),
        Dataset("potential/errors", "f8", (2,), "", "their error on fitted poses and on those kept back", True),
        Dataset(
            "loss",
            "f8",
            ("epochs", 2),
            "",
            "training and validation loss after each epoch, kg m²; of a condensed space the loss of the fit and its "
            "relative force error on poses kept back, at some fifty of its steps",
        ),
        Dataset("search", "f8", ("tried", 3), "", "r, largest and mean training error in mm of each size tried"),
        Dataset("search_own", "?", ("tried",), "", "whether it was a training of that size, or leading codes", True),
        Dataset("novelty/landmarks", "f8", ("L", "r"), "", "training codes", True),
        Dataset("novelty/reach", "f8", (), "", "distance to a landmark that 99 % of training codes stay within", True),
        Dataset("novelty/threshold", "f8", (), "", "score from which on a frame is far from what was learned", True),
        Dataset("errors", "f8", (2, 2), "m", "largest and mean vertex error, training and validation frames"),
        Dataset(
            "kp",
            "i8",
            (),
            "",
            "PCA dimension with the autoencoder's largest training error; all of a condensed space's basis",
        ),
        Dataset("best_epoch", "i8", (), "", "row of loss whose weights were kept, from 0"),
    ),
    "cubature": _RULES,
    "simulation": (*_RUN, *_FRESH),
}

# All others are finite. Displacements are too large to be looked at before they are used.
VALUES = {
    ANY: "motions/*/displacements runs/*/*/coordinates runs/*/*/latent",
    MEASURED: "*/path_errors */path_perturbed_errors */virtual_errors */virtual_judged potential/errors loss search "
    "errors runs/*/*/seconds runs/*/*/mean_error runs/*/*/max_error runs/*/*/windowed_mean_error runs/*/*/novelty "
    "runs/*/*/mean_displacement fresh/*",
    POSITIVE: "*/path_weights */virtual_weights potential/weights squares motions/*/drag_stiffness quadrature/weights "
    "material/mu material/density time_step novelty/reach novelty/threshold",
    COUNT: "*/path_sizes */virtual_closure motions/*/drag_start motions/*/drag_frames motions/*/drag_radius "
    "motions/*/held_count motions/*/support_count motions/*/iterations motions/*/evaluations motions/*/seconds "
    "runs/*/*/iterations runs/*/*/evaluations groups/*/cells singular_values max_error mean_error "
    "validation_max_error validation_mean_error best_epoch potential/points",
    index("n"): "mesh/cells quadrature/nodes motions/*/held motions/*/support_vertices groups/*/vertices",
    index("m"): "quadrature/cells",
    index("s"): "*/path_points */virtual_points",
    index("l"): "*/chosen",
    index(len(MATERIALS)): "material/kind potential/material */virtual_material",
    index(len(Reason)): "motions/*/reason runs/*/*/reason",
    Allowed("1 … k", 1): "kp",
}

"""`ldsim pca`: find the linear basis."""

from __future__ import annotations

from ldsim.cli.stage import Call, stage_command
from ldsim.pipeline.pca import pca


@stage_command("pca", "Find the linear basis: of a given k, or the smallest that meets an error.")
def command(call: Call) -> None:
    found = pca(call.run, call.settings.pca, call.progress)
    call.done(
        "basis",
        f"k = {found.basis.k}, vertex error of the training frames {1e3 * found.max_error[-1]:.3g} mm at most, "
        f"{1e3 * found.mean_error[-1]:.2g} mm on average",
    )

"""`ldsim pca`: find the linear basis."""

from __future__ import annotations

from dataclasses import replace

from ldsim.artefacts.records import read_scene, write_basis
from ldsim.artefacts.snapshots import Snapshots
from ldsim.cli.stage import Run, progress_bar, stage_command
from ldsim.space.basis import inner_product
from ldsim.space.lifting import Lifting
from ldsim.space.pca import Chunks, Rule, errors_against_k, fit_basis


@stage_command("pca", "Find the linear basis by the max-vertex-error rule or for a given k.")
def command(run: Run) -> None:
    settings = run.settings.pca
    scene, _ = read_scene(run.path("scene"))
    metric = inner_product(scene.mass, settings.inner_product)
    with Snapshots(run.path("snapshots")) as snapshots, progress_bar(2, "pca", "pass") as bar:
        run.check("snapshots", snapshots.header, "scene")
        motions = {name: snapshots.recorded(name).motion for name in snapshots.names}
        lifting = Lifting.of(scene, motions.values())
        train, heldout = snapshots.with_role("train"), snapshots.with_role("heldout")
        tolerance = settings.energy if settings.criterion == "energy" else settings.tolerance_mm / 1e3
        rule = Rule(settings.k, settings.criterion, tolerance, settings.max_k)

        def chunks(names: list[str]) -> Chunks:
            return lifting.taken_off(lambda: snapshots.chunks(names), [motions[name] for name in names])

        found = fit_basis(chunks(train), metric, rule)
        bar.update()
        errors = errors_against_k(chunks(heldout), found.basis) if heldout else (None, None)
        bar.update()
    header = run.header("basis", "pca", ("scene", "snapshots"))
    write_basis(run.path("basis"), header, replace(found, heldout_max_error=errors[0], heldout_mean_error=errors[1]))
    run.done(
        "basis",
        f"k = {found.basis.k}, vertex error of the training frames {1e3 * found.max_error[-1]:.3g} mm at most, "
        f"{1e3 * found.mean_error[-1]:.2g} mm on average",
    )

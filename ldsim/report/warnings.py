"""What a reader of a report must know before the numbers."""

from __future__ import annotations

from ldsim.dynamics.trajectory import LARGE_ONLINE_ERROR
from ldsim.optimise.solution import failures
from ldsim.pipeline.simulate import novel_frames
from ldsim.report.runs import runs
from ldsim.report.schema import MM_PER_M, ROLE_NAMES, ROLES, Reconstruction, RunNumbers
from ldsim.report.wording import readable
from ldsim.run import REDUCED, SPACES, Run

UNSEEN_GAP = 3.0


def warnings_of_numbers(report: RunNumbers, cubature_tolerance: float) -> list[str]:
    """Warnings that report.json alone can tell, the gravest first.

    Args:
        cubature_tolerance: relative error that was asked of cubature.

    Returns:
        Sentences: diverged runs, test and validation motions missed by more than 10 %, latent steps slower than linear
        ones of equal error, cubature worse than asked for, and spaces that reconstruct test or validation frames three
        times worse than those they were trained on.
    """
    return [
        *_diverged(report),
        *_large_online_errors(report),
        *_slower_than_linear(report),
        *_cubature_misses(report, cubature_tolerance),
        *_reconstruction_gaps(report),
    ]


def warnings_of_run(run: Run, training_tolerance_mm: float) -> list[str]:
    """Warnings that only the artefacts can tell: a missed tolerance, steps that stopped early or far from what was
    learned, a changed material."""
    return [
        *_missed_training_tolerance(run, training_tolerance_mm),
        *_unconverged_steps(run),
        *_novel_frames(run),
        *_changed_material(run),
    ]


def _diverged(report: RunNumbers) -> list[str]:
    return [
        f"The {space} run of motion {run.motion} diverged; its times end where it did, and it has no errors."
        for space in SPACES
        for run in report.simulate[space]
        if run.diverged
    ]


def _large_online_errors(report: RunNumbers) -> list[str]:
    found = []
    for space in REDUCED:
        for run in report.simulate[space]:
            error = run.online_error and run.online_error.relative
            if run.role != "train" and error is not None and error > LARGE_ONLINE_ERROR:
                found.append(
                    f"On {ROLE_NAMES[run.role]} motion {run.motion}, which nothing was fitted to, the {space} run is "
                    f"{readable(100 * error)} % of the mean displacement away from full space."
                )
    return found


def _slower_than_linear(report: RunNumbers) -> list[str]:
    speedup = report.speedup
    faster = speedup.latent_over_linear_equal_error
    if faster is None or faster >= 1:
        return []
    return [
        f"A latent step takes {readable(1 / faster)} times as long as one in the space {speedup.linear_space}, which "
        f"is at least as good on the {ROLE_NAMES[speedup.judged_on or 'train']} motions."
    ]


def _cubature_misses(report: RunNumbers, tolerance: float) -> list[str]:
    found = []
    for space in REDUCED:
        rule = report.cubature[space]
        errors = rule and rule.relative_error
        for reached, where in (
            ((errors.kept_back, "poses kept back"), (errors.fitted, "fitted poses")) if errors else ()
        ):
            if reached is not None and reached > tolerance:
                found.append(
                    f"Cubature of the {space} space has a relative error of {readable(reached)} on {where}; "
                    f"{tolerance:g} was asked for."
                )
                break
    return found


def _reconstruction_gaps(report: RunNumbers) -> list[str]:
    found = report.reconstruction
    errors = {role: _decoded_max(found[role]) for role in ROLES}
    seen = errors["train"]
    return [
        f"The {report.kind} model misses {ROLE_NAMES[role]} frames by up to {readable(unseen)} mm, against "
        f"{readable(seen)} mm on the frames it was trained on."
        for role, unseen in errors.items()
        if seen is not None and unseen is not None and unseen > UNSEEN_GAP * seen
    ]


def _decoded_max(role: Reconstruction | None) -> float | None:
    return role.autoencoder.max_mm if role and role.autoencoder else None


def _missed_training_tolerance(run: Run, tolerance_mm: float) -> list[str]:
    if int(run.header("model").notes.get("met", 1)):
        return []
    reached = MM_PER_M * float(run.model.errors[0, 0])
    return [
        f"The model misses training frames by up to {readable(reached)} mm; "
        f"{tolerance_mm:g} mm were asked for (train.tolerance_mm)."
    ]


def _changed_material(run: Run) -> list[str]:
    if not int(run.header("simulation").notes.get("material_changed", 0)):
        return []
    return [
        "The motions were simulated with another material than the snapshots have (simulate.material), so there is no "
        "full-space run to judge them by; basis, model and cubature are those of the old material."
    ]


def _unconverged_steps(run: Run) -> list[str]:
    """One sentence for each run with steps that stopped early; a run that diverged has its own warning."""
    found = {
        f"snapshots (full space) of motion {name}": failures(recorded.reason) for name, recorded in run.motions.items()
    }
    for space in SPACES:
        for name, trajectory in runs(run, space).items():
            if not trajectory.diverged:
                found[f"{space} run of motion {name}"] = failures(trajectory.reason)
    return [f"In the {what}, {words}." for what, words in found.items() if words]


def _novel_frames(run: Run) -> list[str]:
    found = novel_frames(runs(run, "latent"), run.model.novelty)
    return [f"In the latent run of motion {name}, {words}." for name, words in found.items()]

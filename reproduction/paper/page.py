"""docs/paper.md: every table and figure of the paper beside what `make paper` found."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ldsim.report.paper import paper_row
from ldsim.report.wording import plain_number
from reproduction.harness import PICTURES, RESULTS
from reproduction.pages import staleness
from reproduction.paper.experiment import Experiment
from reproduction.paper.table import EXPERIMENTS

INTRODUCTION = """# The paper, figure by figure

Fulton, Modi, Duvenaud, Levin and Jacobson, *Latent-space Dynamics for Reduced Deformable Simulation*, Eurographics
2019, made again at the paper's own settings (`configs/paper/`): Adam at a fixed rate, 100 × 100 ELU, An's cubature with
as many points for both spaces, L-BFGS with Eq. 15 made in every step. `make paper` makes all of it from the authors'
meshes and recordings, `make paper NAME=fig9` one, `QUICK=yes` a small version. Where a figure asks for errors alone,
`ldsim`'s own minimiser takes the steps to 10⁻⁸ N, where all minimisers end. Milliseconds do not carry over between
machines; ratios, counts and errors do. What does not hold is shown as it is. What `ldsim` does beyond the paper is in
[the guide](guide/reduced_space.md), and is measured elsewhere.

"""


def paper_page(results: Path = RESULTS / "paper") -> str:
    """The page; experiments that were not made yet are named at its end."""
    made = {name: results / f"{name}.json" for name in EXPERIMENTS if (results / f"{name}.json").is_file()}
    contents = {name: json.loads(path.read_text(encoding="utf-8")) for name, path in made.items()}
    text = (
        INTRODUCTION
        + "".join(_summary(contents))
        + "".join(part for name, content in contents.items() for part in _section(name, EXPERIMENTS[name], content))
    )
    missing = [title(name) for name in EXPERIMENTS if name not in contents]
    return text + (f"Not made yet: {', '.join(missing)}.\n" if missing else "")


def title(name: str) -> str:
    """table1 → Table 1."""
    told = re.fullmatch(r"(table|fig)(\d+)", name)
    return {"table": "Table ", "fig": "Figure "}[told[1]] + told[2] if told else name.capitalize()


def _summary(contents: Mapping[str, Any]) -> Iterator[str]:
    yield "| | shows | holds |\n|---|---|---|\n"
    for name, content in contents.items():
        held = sum(relation["holds"] for relation in content["relations"])
        link = title(name).lower().replace(" ", "-")
        yield f"| [{title(name)}](#{link}) | {EXPERIMENTS[name].shows} | {held} of {len(content['relations'])} |\n"
    yield "\n"


def _section(name: str, experiment: Experiment, content: Mapping[str, Any]) -> Iterator[str]:
    yield f"## {title(name)}\n\n**Paper.** {experiment.paper}\n\n"
    for suffix in ("svg", "webp"):
        if (PICTURES / f"paper_{name}.{suffix}").is_file():
            yield f"![{title(name)}: {experiment.shows}](pictures/paper_{name}.{suffix})\n\n"
    if name == "table1":
        yield from _table_one(content["numbers"]["rows"])
    yield "| relation | paper | here | expected | |\n|---|---|---|---|---|\n"
    for relation in content["relations"]:
        paper, here = (_number(relation.get(key)) for key in ("paper", "value"))
        verdict = "holds" if relation["holds"] else "**fails**"
        yield f"| {relation['claim']} | {paper} | {here} | {relation['goal']} | {verdict} |\n"
    if experiment.found:
        yield f"\n**Here.** {experiment.found}\n"
    machine = content["machine"]
    yield (
        f"\nMade by `{content['command']}` on {machine['cpu']}, {machine['cores']} cores, {content['created'][:10]}, "
        f"commit {content['commit']} (`reproduction/results/paper/{name}.json`).{staleness(content)}\n\n"
    )


def _table_one(rows: Mapping[str, Any]) -> Iterator[str]:
    """A line of ours and one of the paper for each model."""
    yield (
        "| | tets | AE, s | PCA, s | cubature, s | points | kp | r (k) | linear, ms | latent, ms | linear / latent |\n"
        "|---|---|---|---|---|---|---|---|---|---|---|\n"
    )
    for name, found in rows.items():
        linear, latent = found["linear"], found["latent"]
        points = (
            f"{linear['points']}" if linear["points"] == latent["points"] else f"{linear['points']}, {latent['points']}"
        )
        yield _line(
            f"{name}, here", found["cells"], found["train_s"], found["pca_s"], found["cubature_s"], points,
            linear["dimension"], f"{latent['dimension']} ({found['k']})", linear["step_ms"], latent["step_ms"],
            linear["step_ms"] / latent["step_ms"],
        )  # fmt: skip
        if (row := paper_row(name)) is not None:
            yield _line(
                f"{name}, paper", row.tets, row.autoencoder_s, row.pca_s, row.cubature_s, row.points, row.kp,
                f"{row.r} ({row.k})", row.linear_ms, row.latent_ms, row.speedup,
            )  # fmt: skip
    notes = (f"{name}: {row.note}" for name in rows if (row := paper_row(name)) is not None and row.note)
    yield "".join(f"\n{note}\n" for note in notes)
    yield "\nOnline error on the training motion, which the paper does not print:\n\n"
    yield "| | linear | latent |\n|---|---|---|\n"
    for name, found in rows.items():
        yield _line(name, *(_percent(found[space]["online_error"]) for space in ("linear", "latent")))
    yield "\n"


def _line(*cells: object) -> str:
    return "| " + " | ".join(cell if isinstance(cell, str) else _number(cell) for cell in cells) + " |\n"


def _percent(value: float | None) -> str:
    return "lost" if value is None else f"{100 * value:.3g} %"


def _number(value: Any) -> str:
    return "–" if value is None else f"{value:,}" if isinstance(value, int) else plain_number(value)

"""`ldsim report`: write report.json, report.html, figures and pictures."""

from __future__ import annotations

import click

from ldsim.cli.stage import Call, stage_command
from ldsim.report.overview import read_first
from ldsim.report.report import report


@stage_command("report", "Write report.json, report.html and figures.")
def command(call: Call) -> None:
    folder = call.run.folder / "report"
    made = report(call.run, call.settings.report, call.progress)
    call.say(folder, f"{made.numbers.verdict.word}; {len(made.figures)} figures")
    statement = made.numbers.statement
    for line in [*([statement.sentence] if statement else []), *read_first(made.numbers)]:
        click.echo(line)
    click.echo(str((folder / "report.html").resolve()))

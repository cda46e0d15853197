"""The command `ldsim`; each subcommand's module is imported when it is called, so that help is instant."""

from __future__ import annotations

import errno
import importlib
import re
import sys
from typing import Never

import click

from ldsim import __version__
from ldsim.errors import INTERRUPTED, LdsimError, SettingsError, StageInterrupted

COMMANDS = {
    "new": "Look at a solid and write settings that fit it.",
    "make": "Run what is missing or stale, up to the report.",
    "mesh": "Read or make the mesh and write the scene.",
    "snapshot": "Run the motions in the full space.",
    "pca": "Find the linear basis.",
    "train": "Train the latent space.",
    "cubature": "Choose the cubature points.",
    "simulate": "Run the motions in the reduced spaces and compare.",
    "report": "Write report.json, report.html and figures.",
    "list": "Say how far each run has come, and how good it is.",
    "open": "Open the report of a run in the browser.",
    "compare": "Put several finished runs side by side on one page.",
    "play": "Pull a finished run in the browser.",
    "record": "Pull a coarse mesh in the browser and record a motion.",
    "export": "Write a run's motion or model for other programs.",
    "info": "Say what a run came to, or what an artefact holds.",
    "settings": "Check a configuration and print it with defaults.",
}

# Of a path that is only looked at: a folder that may not be searched, a name that is too long.
NOT_TO_BE_HAD = (errno.EACCES, errno.ENAMETOOLONG)
OUT_OF_MEMORY = re.compile("can't allocate memory|out of memory")


class LazyGroup(click.Group):
    """A group whose commands are imported by name, and whose errors are one line."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        if name not in COMMANDS:
            return None
        command: click.Command = importlib.import_module(f"ldsim.cli.{name}").command
        command.params += [own for own in self.params if own not in command.params]  # --version
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))

    def invoke(self, ctx: click.Context) -> object:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as error:
            if not isinstance(error, StageInterrupted):
                click.echo("interrupted; what was finished is kept, and the same command goes on from there", err=True)
            sys.exit(INTERRUPTED)
        except SettingsError as error:  # several faults, a line each
            _end_with(*str(error).splitlines())
        except LdsimError as error:
            _end_with(str(error))
        except ModuleNotFoundError as error:
            if error.name != "torch":
                raise
            _end_with("this command needs PyTorch, which is missing; run pip install 'ldsim[train]'")
        except OSError as error:
            if error.errno not in NOT_TO_BE_HAD or error.filename is None:
                raise
            _end_with(f"{error.filename} cannot be read: {error.strerror}; give a path that can be read")
        except (MemoryError, RuntimeError) as error:
            # PyTorch says so by a RuntimeError: "can't allocate memory" on the CPU, "CUDA out of memory" on a GPU.
            if not isinstance(error, MemoryError) and not OUT_OF_MEMORY.search(str(error)):
                raise
            _end_with(
                f"ldsim {ctx.invoked_subcommand} ran out of memory ({str(error) or 'allocation failed'}); what was "
                "finished is kept — use a coarser mesh, fewer snapshot.workers or a machine with more memory"
            )


def printable(text: str) -> str:
    """A text of a file for the terminal, which does not obey what is in it."""
    return "".join(letter if letter.isprintable() or letter == "\n" else ascii(letter)[1:-1] for letter in text)


def _end_with(message: str, *more: str) -> Never:
    """Say what is wrong in one line, and in one for each thing more, and leave with status 1."""
    click.echo(f"error: {printable(' '.join(message.split()))}", err=True)
    for fault in more:
        click.echo(f"  {printable(' '.join(fault.split()))}", err=True)
    sys.exit(1)


@click.group(
    cls=LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="`ldsim new` and `ldsim make` are all it takes; `make` runs the stages mesh to report in the order listed.",
)
@click.version_option(__version__, "--version", prog_name="ldsim")
def main() -> None:
    """Turn an elastic solid and examples of how it deforms into a model of about ten numbers."""

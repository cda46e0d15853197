"""Where long work tells how far it is: nowhere, unless the caller gives something better."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class Bar:
    """The progress of one piece of work; this one shows nothing."""

    def update(self, steps: int = 1) -> None:
        """So many more steps are done."""

    def reach(self, steps: int) -> None:
        """So many steps are done in all."""

    def say(self, text: str) -> None:
        """What is being done just now, or how good it is."""


class Progress:
    """What a stage of the pipeline tells while it works; this one is silent. The command line draws bars."""

    @contextmanager
    def bar(self, description: str, total: int | None, unit: str) -> Iterator[Bar]:
        """A bar for one piece of work: its title, how many steps it has (None: not known), and what a step is."""
        yield Bar()

    def tell(self, text: str) -> None:
        """A note or a warning, one line."""


SILENT = Progress()

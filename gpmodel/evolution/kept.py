"""Finished runs of a search, found again by their numbers."""

from typing import Protocol

from gpmodel.evolution.search import Evolution

Number = tuple[int, int]
"""Number of a run: its round, or the place of its representation, and which of the runs there it is."""


class KeptRuns(Protocol):
    """Where finished runs go at once, so that an interrupted search repeats only what was under way."""

    def run(self, number: Number) -> Evolution | None:
        """The run of that number, None where it has yet to be done."""

    def keep_run(self, number: Number, found: Evolution) -> None:
        """Keep it. Raises WriteError where it cannot be written."""


class NothingKept:
    """Keeps no runs."""

    def run(self, number: Number) -> Evolution | None:
        """None."""
        return None

    def keep_run(self, number: Number, found: Evolution) -> None:
        """Keeps nothing."""

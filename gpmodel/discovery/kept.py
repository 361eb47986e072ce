"""Finished GP runs of a discovery, found again by round and number."""

from typing import Protocol

from gpmodel.evolution.search import Evolution


class KeptRuns(Protocol):
    """Where finished runs go at once, so that an interrupted round repeats only what was under way."""

    def run(self, number: tuple[int, int]) -> Evolution | None:
        """The run of that round and number, None where it has yet to be done."""
        ...

    def keep_run(self, number: tuple[int, int], found: Evolution) -> None:
        """Keep it. Raises WriteError where it cannot be written."""
        ...

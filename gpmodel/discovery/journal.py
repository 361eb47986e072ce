"""What keeps the finished parts of a discovery, so that an interrupted one goes on to the same numbers."""

from collections.abc import Sequence
from typing import Protocol

from gpmodel.discovery.result import Finding, Round
from gpmodel.evolution.runs import KeptRuns, NothingKept


class Journal(KeptRuns, Protocol):
    """Where a discovery notes what it has finished."""

    def begin(self) -> tuple[list[Finding], list[Round]]:
        """What is finished already. Called once, before the first line of progress."""

    def keep(self, findings: Sequence[Finding], rounds: Sequence[Round]) -> None:
        """Called after every round with all that is finished. Raises WriteError where it cannot be written."""


class NullJournal(NothingKept):
    """A journal that keeps nothing."""

    def begin(self) -> tuple[list[Finding], list[Round]]:
        """Nothing."""
        return [], []

    def keep(self, findings: Sequence[Finding], rounds: Sequence[Round]) -> None:
        """Keeps nothing."""

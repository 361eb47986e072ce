"""Searches of the machines of a fleet that are finished, found again by the machine's place."""

from dataclasses import dataclass
from typing import Protocol

from gpmodel.families.candidate import Candidate
from gpmodel.records.unfinished import Unfinished


class KeptMachines(Protocol):
    """Where what was found on a machine goes at once, so that an interrupted fleet repeats only what was under way."""

    def machine(self, place: int) -> tuple[Candidate, ...] | None:
        """What was found on the machine at that place, None where it has yet to be searched."""

    def keep_machine(self, place: int, found: tuple[Candidate, ...]) -> None:
        """Keep it. Raises WriteError where it cannot be written."""


class NoMachinesKept:
    """Keeps nothing."""

    def machine(self, place: int) -> tuple[Candidate, ...] | None:
        """None."""
        return None

    def keep_machine(self, place: int, found: tuple[Candidate, ...]) -> None:
        """Keeps nothing."""


@dataclass(frozen=True)
class MachineFiles:
    """A file each machine."""

    files: Unfinished

    def machine(self, place: int) -> tuple[Candidate, ...] | None:
        """As it was found."""
        content = self.files.read(_name(place))
        return None if content is None else content["found"]

    def keep_machine(self, place: int, found: tuple[Candidate, ...]) -> None:
        """Write it."""
        self.files.write(_name(place), {"found": found})


def _name(place: int) -> str:
    return f"machine-{place + 1:04d}"

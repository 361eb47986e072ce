"""Searches of the machines of a fleet that are finished, found again by the machine's place."""

from dataclasses import dataclass

from gpmodel.families.candidate import Candidate
from gpmodel.records.unfinished import Unfinished


@dataclass(frozen=True)
class KeptMachines:
    """Where what was found on a machine goes at once, a file each, so that an interrupted fleet repeats only what was
    under way; nowhere without files."""

    files: Unfinished | None = None

    def machine(self, place: int) -> tuple[Candidate, ...] | None:
        """What was found on the machine at that place, None where it has yet to be searched."""
        content = self.files.read(_name(place)) if self.files else None
        return None if content is None else content["found"]

    def keep_machine(self, place: int, found: tuple[Candidate, ...]) -> None:
        """Keep it. Raises WriteError where it cannot be written."""
        if self.files:
            self.files.write(_name(place), {"found": found})


def _name(place: int) -> str:
    return f"machine-{place + 1:04d}"

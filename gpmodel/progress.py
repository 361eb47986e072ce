"""Progress messages of a long call."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Progress:
    """One line of progress. passing: True if the next line overwrites the line, as for a counter of runs."""

    text: str
    passing: bool = False

    def __str__(self) -> str:
        return self.text


Say = Callable[[Progress], None]


def silent(progress: Progress) -> None:
    """Ignore a progress message of a long call."""


@dataclass(frozen=True)
class Reporter:
    """Function that sends a text as a progress message. heading: beginning of every line."""

    send: Say = silent
    heading: str = ""

    def __call__(self, text: str, passing: bool = False) -> None:
        self.send(Progress(f"{self.heading}{text}", passing))

"""Progress messages of a long call."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Progress:
    """One line on what is being tried. passing: the next line takes its place, as in a count of runs."""

    text: str
    passing: bool = False

    def __str__(self) -> str:
        return self.text


Say = Callable[[Progress], None]


def silent(progress: Progress) -> None:
    """Says nothing."""


@dataclass(frozen=True)
class Teller:
    """Turns text into Progress; every line opens with `heading`."""

    say: Say = silent
    heading: str = ""

    def __call__(self, text: str, passing: bool = False) -> None:
        self.say(Progress(f"{self.heading}{text}", passing))

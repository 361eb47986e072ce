"""The choices of one run: a representation, a selection, and how much work is put into it."""

from dataclasses import dataclass, field

from gpmodel.evolution.linear import Linear
from gpmodel.evolution.representation import Representation, check_ranges
from gpmodel.evolution.selection import SelectionScheme, Tournament, Truncation


@dataclass(frozen=True)
class Budget:
    """How long one run goes on, and what it does besides breeding.

    population; generations and seconds: whichever ends first. target: stop once a program reaches this gain.
    polish_every: own constants of the best are fitted every so many generations (0: never). restart_after:
    generations without progress before a fresh population (0: never). climb: the best programs of a slot
    search, so many, are finished by single edits (0: none). threads: 0 for all cores; never changes a result.
    Raises InputError for a choice out of range.
    """

    population: int = 1024
    generations: int = 1_000_000
    seconds: float = 5.0
    target: float = 1.0
    polish_every: int = 10
    restart_after: int = 60
    climb: int = 0
    threads: int = 0

    def __post_init__(self) -> None:
        check_ranges(self, population=(4, 2**24), generations=(0, 10**9), seconds=(0.0, 1e9))


@dataclass(frozen=True)
class Settings:
    """One run; the defaults search a slot's shape. Raises InputError for a population too small to select from."""

    representation: Representation = field(default_factory=Linear)
    selection: SelectionScheme = field(default_factory=Tournament)
    budget: Budget = field(default_factory=Budget)

    def __post_init__(self) -> None:
        self.selection.eligible(self.budget.population)


def thesis_settings(representation: Representation, population: int = 65536, generations: int = 100) -> Settings:
    """Section 5.2.2: the best 5 % have children, nothing is fitted or restarted."""
    budget = Budget(population, generations, seconds=1e9, polish_every=0, restart_after=0)
    return Settings(representation, Truncation(0.05), budget)

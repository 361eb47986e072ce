"""Settings of one run of evolution: selection of parents and survivors, and budget."""

from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from gpmodel.errors import InputError
from gpmodel.evolution.code import Scores
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.representation import Representation, check_ranges

Rows = NDArray[np.intp]


@runtime_checkable
class SelectionScheme(Protocol):
    """Selection of parents and of survivors among programs; scores are minimised."""

    def eligible(self, population: int) -> int:
        """Return the number of best programs that can have children or survive; the other programs need no score.
        Raises InputError if the population is too small."""

    def parents(self, scores: Scores, rng: np.random.Generator) -> NDArray[np.intp]:
        """Return the row numbers (2, population) of the mothers and fathers of the next generation."""

    def survivors(self, scores: Scores, population: int) -> Rows | None:
        """Return the row numbers of the survivors among parents and children; None if children replace all parents."""


@dataclass(frozen=True)
class Truncation:
    """Parents are drawn from the best ``share`` of programs (Robertson 2003: 5 %); children replace the population."""

    share: float = 0.05

    def __post_init__(self) -> None:
        check_ranges(self, share=(1e-6, 1.0))

    def eligible(self, population: int) -> int:
        if population * self.share < 2:
            raise InputError(
                f"{population} is too small to select {self.share:.1%} from, expected at least {2 / self.share:.0f}",
                "population",
            )
        return int(self.share * population)

    def parents(self, scores: Scores, rng: np.random.Generator) -> Rows:
        few = self.eligible(len(scores.score))
        able = np.flatnonzero(scores.score <= np.sort(scores.score)[few - 1])
        best = able[np.argsort(scores.score[able], kind="stable")[:few]]
        return best[rng.integers(0, few, (2, len(scores.score)))]

    def survivors(self, scores: Scores, population: int) -> None:
        return None


@dataclass(frozen=True)
class Tournament:
    """Each parent is the best of ``size`` programs drawn at random; the best of parents and children survive, first
    programs with a score unlike that of any better one."""

    size: int = 4

    def __post_init__(self) -> None:
        check_ranges(self, size=(1, 1000))

    def eligible(self, population: int) -> int:
        return population

    def parents(self, scores: Scores, rng: np.random.Generator) -> Rows:
        count = len(scores.score)
        entrants = rng.integers(0, count, (2, count, self.size))
        best = scores.score[entrants].argmin(axis=2)
        return np.take_along_axis(entrants, best[..., None], axis=2)[..., 0]

    def survivors(self, scores: Scores, population: int) -> Rows:
        order = np.argsort(scores.score, kind="stable")
        behaviour = np.round(scores.score[order], 9)
        fresh = np.concatenate([[True], (behaviour[1:] != behaviour[:-1])])
        return np.concatenate([order[fresh], order[~fresh]])[:population]


@dataclass(frozen=True)
class Budget:
    """Budget of one run of evolution, and its steps in addition to breeding.

    population: number of programs of a generation.
    generations, seconds: limits of the run, whichever is reached first.
    target: share of the residual removed by a program at which the run ends.
    restart_after: generations without progress before a new random population (0: never).
    climb: number of best programs from which formulas are bred at the end of a search at sites (0: none).
    Raises InputError for a value out of range.
    """

    population: int = 1024
    generations: int = 1_000_000
    seconds: float = 5.0
    target: float = 1.0
    restart_after: int = 60
    climb: int = 0

    def __post_init__(self) -> None:
        check_ranges(self, population=(4, 2**24), generations=(0, 10**9), seconds=(0.0, 1e9))


@dataclass(frozen=True)
class Settings:
    """Settings of one run; the defaults search a basis function of an effect. Raises InputError if the population is
    too small for the selection."""

    representation: Representation = field(default_factory=Linear)
    selection: SelectionScheme = field(default_factory=Tournament)
    budget: Budget = field(default_factory=Budget)

    def __post_init__(self) -> None:
        self.selection.eligible(self.budget.population)


def thesis_settings(representation: Representation, population: int = 65536, generations: int = 100) -> Settings:
    """Return the settings of Robertson (2003), 5.2.2: the best 5 % have children, no restart."""
    budget = Budget(population, generations, seconds=1e9, restart_after=0)
    return Settings(representation, Truncation(0.05), budget)

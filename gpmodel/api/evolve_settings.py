"""Default settings of evolution: the thesis' settings in Cartesian space, smaller ones at a slot."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from gpmodel.api.arguments import listed, shown
from gpmodel.errors import InputError
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.representation import Representation, label
from gpmodel.evolution.settings import Budget, SelectionScheme, Settings, thesis_settings
from gpmodel.evolution.tree import Tree

Space = Literal["cartesian", "slot"]
POPULATIONS = {"cartesian": {"linear": 65536, "tree": 8192}, "slot": {"linear": 1024, "tree": 512}}
"""Population sizes.

Compensators use the thesis' size (section 5.2.2), and an eighth as many trees, which take as long. At a slot, where
one formula of one input is sought, smaller populations suffice.
"""
GENERATIONS = 100
"""The thesis names none; after a hundred its populations are of one kind."""
UNLIMITED, NO_END = 1_000_000, 1e9
"""Generations of a run that only the clock ends, and seconds of one that only its generations end."""


@dataclass(frozen=True)
class Effort:
    """Requested effort of a run and its selection scheme; None for the defaults."""

    population: int | None = None
    generations: int | None = None
    seconds: float | None = None
    selection: SelectionScheme | None = None


def evolved(value: object) -> tuple[Representation, ...]:
    """Representations of programs, each of another name. Raises InputError naming `strategies`."""
    chosen: list[Representation] = []
    for strategy in listed(value, "strategies", "(gp.Linear(), gp.Tree())"):
        if isinstance(strategy, type) or not isinstance(strategy, Representation):
            raise InputError(f"{shown(strategy)}, expected gpmodel.Linear(...) or gpmodel.Tree(...)", "strategies")
        chosen.append(strategy)
    if not chosen:
        raise InputError("(), expected gpmodel.Linear(), gpmodel.Tree() or both", "strategies")
    for name, count in Counter(map(label, chosen)).items():
        if count > 1:
            raise InputError(f"{count} are called '{name}', expected each name once", "strategies")
    return tuple(chosen)


def selecting(value: object, argument: str) -> SelectionScheme:
    """Who breeds and lives on. Raises InputError naming the argument."""
    if isinstance(value, type) or not isinstance(value, SelectionScheme):
        raise InputError(f"{shown(value)}, expected gpmodel.Truncation(...) or gpmodel.Tournament(...)", argument)
    return value


def default_strategies(space: Space) -> tuple[Linear | Tree, ...]:
    """The thesis' own in Cartesian space, those that search a slot's shape else."""
    return (Linear.thesis(), Tree.thesis()) if space == "cartesian" else (Linear(), Tree())


def settings_for(space: Space, strategies: Sequence[Representation], effort: Effort) -> dict[str, Settings]:
    """Settings by the strategies' names: the thesis' in Cartesian space, the defaults at a slot; one thread a run, for
    the runs themselves go side by side.

    Raises InputError for a population too small to select from.
    """
    generations = effort.generations
    if generations is None:
        generations = GENERATIONS if effort.seconds is None else UNLIMITED
    seconds = NO_END if effort.seconds is None else effort.seconds
    chosen: dict[str, Settings] = {}
    for strategy in strategies:
        name = label(strategy)
        size = effort.population or POPULATIONS[space].get(name, min(POPULATIONS[space].values()))
        settings = (
            thesis_settings(strategy, size, generations)
            if space == "cartesian"
            else Settings(strategy, budget=Budget(size, generations))
        )
        budget = replace(settings.budget, seconds=seconds, threads=1)
        chosen[name] = replace(settings, budget=budget, selection=effort.selection or settings.selection)
    return chosen

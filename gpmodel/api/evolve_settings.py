"""What evolves where: the thesis' settings in Cartesian space, the defaults at a slot."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

from gpmodel.errors import InputError
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.representation import Representation, label
from gpmodel.evolution.settings import Budget, Settings, thesis_settings
from gpmodel.evolution.tree import Tree

Space = Literal["cartesian", "slot"]
POPULATIONS = {"cartesian": {"linear": 65536, "tree": 4096}, "slot": {"linear": 1024, "tree": 512}}
GENERATIONS = 100
UNLIMITED = 1_000_000


def default_strategies(space: Space) -> tuple[Representation, ...]:
    """The thesis' own in Cartesian space, those that search a slot's shape else."""
    return (Linear.thesis(), Tree.thesis()) if space == "cartesian" else (Linear(), Tree())


def settings_for(
    space: Space, strategies: Sequence[Representation], population: int | None, budget: Mapping[str, Any]
) -> dict[str, Settings]:
    """Settings by the strategies' names: the thesis' in Cartesian space, the defaults at a slot.

    budget: fields of Budget that were asked for. Raises InputError for a population too small to select from.
    """
    if space not in POPULATIONS:
        raise InputError(f"{space!r}, expected {' or '.join(POPULATIONS)}", "space")
    chosen = {}
    for strategy in strategies:
        name = label(strategy)
        size = population or POPULATIONS[space].get(name, min(POPULATIONS[space].values()))
        settings = (
            thesis_settings(strategy, size, GENERATIONS)
            if space == "cartesian"
            else Settings(strategy, budget=Budget(size, GENERATIONS, seconds=1e9))
        )
        if "seconds" in budget and "generations" not in budget:
            settings = settings.with_budget(generations=UNLIMITED)
        chosen[name] = replace(settings, budget=replace(settings.budget, **budget))
    return chosen

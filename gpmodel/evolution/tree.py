"""Settings of programs that are binary trees (Robertson 2003, section 5.2.2)."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gpmodel.errors import InputError
from gpmodel.evolution.machine import Layout
from gpmodel.evolution.problems import Inputs
from gpmodel.evolution.representation import Population, Rows, check_ranges
from gpmodel.formula.operators import TABLE_CONSTANTS, operator_set

if TYPE_CHECKING:
    from gpmodel.evolution.tree_breeding import Trees


@dataclass(frozen=True)
class Tree:
    """Settings of programs as ``outputs`` trees no deeper than ``depth``; the defaults search a basis function of an
    effect.

    operators, constants, own_constants: as for ``linear.Linear``.
    style: "koza" (subtree exchange, grown subtrees, node replacement) or "thesis" (the depth-first crossover and the
    two mutations of section 5.2.2).
    crossover: share of children by crossover; the other children are mutated.
    Raises InputError for a value out of range.
    """

    depth: int = 5
    outputs: int = 3
    operators: str | tuple[str, ...] = "slot"
    constants: tuple[float, ...] = (1.0, 2.0)
    own_constants: int = 4
    style: str = "koza"
    crossover: float = 0.03

    def __post_init__(self) -> None:
        check_ranges(self, depth=(1, 40), outputs=(1, 8), own_constants=(0, 64), crossover=(0.0, 0.999))
        if self.style not in ("koza", "thesis"):
            raise InputError(f"{self.style!r}, expected 'koza' or 'thesis'", "style")
        operator_set(self.operators)

    @staticmethod
    def thesis() -> "Tree":
        """Return the settings of Robertson (2003), 5.2.2: depth 10 to 15, the operators and constants of Table 5.1."""
        return Tree(12, 3, "thesis", TABLE_CONSTANTS, own_constants=0, style="thesis", crossover=0.8)

    def layout(self, inputs: Inputs, start: tuple[str, ...]) -> Layout:
        return Layout(
            inputs.names, operator_set(self.operators), self.constants, (None,) * self.outputs, self.outputs,
            self.own_constants, kinds=inputs.kinds,
        )  # fmt: skip

    def initial(self, layout: Layout, population: int, rng: np.random.Generator) -> "Trees":
        from gpmodel.evolution.tree_breeding import random_trees

        return random_trees(layout, self.depth, population, rng)

    def offspring(
        self, layout: Layout, parents: Population, mothers: Rows, fathers: Rows, rng: np.random.Generator
    ) -> "Trees":
        from gpmodel.evolution.tree_breeding import Trees, children

        assert isinstance(parents, Trees), "trees are bred from trees"
        pairs = [[parents.individuals[row] for row in pair] for pair in zip(mothers, fathers, strict=True)]
        return children(layout, pairs, self.depth, self.style, self.crossover, rng)

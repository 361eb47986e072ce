"""The terms of a law under a link as a hill: single edits of all of them, tried at once."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpmodel.arrays import Array
from gpmodel.evolution.building_blocks import Vocabulary
from gpmodel.evolution.description_length import fit_nats, ranked
from gpmodel.evolution.hill_climb import climbed
from gpmodel.evolution.linked_problem import PRICE, LinkedProblem
from gpmodel.evolution.links import LinkTerm
from gpmodel.evolution.problems import Inputs
from gpmodel.evolution.rows import unit_rows
from gpmodel.formula.program import Builder


@dataclass(frozen=True)
class Terms:
    """Terms as the outputs of one program, to climb from; outputs that join them go above the bar.

    below: how many of the first outputs stand below it.
    """

    problem: LinkedProblem
    below: int

    @property
    def inputs(self) -> Inputs:
        """The columns that a program may read."""
        return self.problem.inputs

    def nats(self, gain: Array | float, size: Array | float) -> Array:
        """Description length saved."""
        return ranked(fit_nats(gain, self.problem.targets.components) - PRICE * np.asarray(size))

    def set_gain(self, values: Array, site: int) -> float:
        """Gain of terms (m, N)."""
        if self.below or self.problem.link.weighted:
            return float(self.set_gains([row[None] for row in values], site)[0])
        return self.problem.targets.set_gain(values, site)[0]

    def set_gains(self, values: Sequence[Array], site: int) -> Array:
        """Gains (P,) of many sets of terms; those of quotients and products are of the response itself.

        values: (P, N) of each term, or (1, N) of one that all sets share.
        """
        if not self.below and not self.problem.link.weighted:
            return self.problem.targets.set_gains(values, site)
        table = np.stack(np.broadcast_arrays(*values), axis=1)
        programs, count, points = table.shape
        above = (1 << count) - (1 << self.below)
        chosen = np.full(programs, above | ((1 << self.below) - 1) << count)
        if self.problem.link.quotient:
            table = unit_rows(table.reshape(-1, points)).reshape(table.shape)
        left = np.ones(programs)
        added = self.problem.share_left(table, chosen, left)
        return 1.0 - left * np.exp(2.0 * PRICE * added / self.problem.targets.components)


def climbed_terms(problem: LinkedProblem, terms: list[LinkTerm], words: Vocabulary) -> list[LinkTerm]:
    """The terms at the top of the hill of single edits of all of them; one more than there are may join them."""
    builder = Builder()
    ordered = sorted(terms, key=lambda term: not term.below)
    whole = builder.program([builder.copy(term.program)[term.program.outputs[0]] for term in ordered])
    below = sum(term.below for term in terms)
    top = climbed(whole, Terms(problem, below), 0, words, len(terms) + 1)
    return [LinkTerm(top.select([k]), k < below) for k in range(len(top.outputs))]

"""A response under a link, as a problem of the generations of a search."""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.evolution.description_length import fit_nats, ranked
from gpmodel.evolution.engine import Code, values
from gpmodel.evolution.linked_solution import solved
from gpmodel.evolution.links import BROKEN_POWER, FITS, LARGEST_POWER, POWER, Link, LinkTerm
from gpmodel.evolution.problems import Inputs
from gpmodel.evolution.projection import ROUNDING_SHARE, Targets
from gpmodel.evolution.scoring import Scores, projected_scores
from gpmodel.formula.program import Builder, Program

Chosen = IntArray

PRICE = 3.0
"""Nats of a node or coefficient (description length; a node is one of some twenty operators and inputs)."""

PASSES = 2
"""Solutions of a quotient, each weighted by the denominator before: a third changes hardly any."""


@dataclass(frozen=True)
class LinkedProblem:
    """A response (N,) under a link, as a problem of ``gpmodel.evolution.generations``."""

    inputs: Inputs
    response: Array
    link: Link
    slice: ClassVar[int] = 256
    start: ClassVar[tuple[str, ...]] = ()
    can_drop_the_hopeless: ClassVar[bool] = False

    @cached_property
    def always(self) -> list[LinkTerm]:
        """Terms of every sum."""
        return self.link.always(self.inputs.mapping())

    @cached_property
    def factors(self) -> Array:
        """Values (a, N) of these terms."""
        columns = self.inputs.mapping()
        return np.stack([term.column(columns, self.response) for term in self.always])

    @cached_property
    def root(self) -> Array:
        """Roots of the points' weights (N,)."""
        return self.link.root_weights(self.response)

    @cached_property
    def targets(self) -> Targets:
        """What is left of the linked response without these terms."""
        there = self.root * self.link.forward(self.response)
        table = (self.root * self.factors).T
        orthonormal, triangle = np.linalg.qr(table)
        diagonal = np.abs(np.diag(triangle))
        orthonormal = orthonormal[:, diagonal > 1e-9 * diagonal.max()]
        rest = there - orthonormal @ (orthonormal.T @ there)
        rest = rest - orthonormal @ (orthonormal.T @ rest)
        ones = np.ones((1, len(there)))
        energy = max(float(rest @ rest), 1e-300)
        return Targets(ones, orthonormal.T[None], rest[None], energy, (self.link.name,), len(there), ROUNDING_SHARE)

    def scores(self, code: Code, fixed: Array, hopeless: float = np.inf) -> Scores:
        """Description length and gain of decoded programs, what the link makes of their outputs offered as well."""
        outputs = values(code, fixed)
        offered = np.concatenate([outputs, self.link.companions(outputs, self.response)], axis=1)
        scaled = offered * self.root if self.link.weighted else offered
        scores = projected_scores(scaled, code, len(fixed), self.targets, PRICE)
        if self.link.quotient:
            self._score_anew(scores, np.ascontiguousarray(scaled[:, : scaled.shape[1] // 2]))
        elif self.link.weighted:
            self._score_anew(scores, offered)
        return scores

    def share_left(self, columns: Array, chosen: Chosen, left: Array) -> Chosen:
        """What quotients or products of chosen columns (P, k, N) leave of the response, and nodes that they add (P,).

        left (P,) is overwritten; it stays where nothing is chosen below the bar of a quotient, or for a product.
        """
        from gpmodel.evolution.kernels.products import share_left_by_products
        from gpmodel.evolution.kernels.quotients import share_left_by_quotients

        written = np.zeros((len(columns), 2), np.int64)
        if self.link.quotient:
            share_left_by_quotients(columns, chosen, self.response, PASSES, left)
        else:
            share_left_by_products(
                columns, chosen, self.factors, self.response, FITS, PRICE * BROKEN_POWER, LARGEST_POWER, left, written
            )
        return np.asarray(written @ np.array([BROKEN_POWER, POWER]))

    def _score_anew(self, scores: Scores, columns: Array) -> None:
        """Scores by what is left of the response itself: a denominator shrinks any error, a logarithm spreads small."""
        left = 1.0 - scores.gain
        scores.complexity[:] += self.share_left(columns, scores.chosen, left)
        size = scores.complexity + np.bitwise_count(scores.chosen)
        scores.score[:] = ranked(PRICE * size - fit_nats(1.0 - left, self.targets.components))
        worthless = ~(scores.score < 0)
        scores.gain[:] = 1.0 - left
        for found in (scores.score, scores.gain, scores.complexity, scores.chosen):
            found[worthless] = 0

    def terms(self, program: Program, chosen: int) -> list[LinkTerm]:
        """The columns of a program in the bit set ``chosen`` as terms."""
        count = len(program.outputs)
        columns = [(k, half) for k in range(count) for half in (0, count) if chosen >> (k + half) & 1]
        return [self._term(program.select([k]), half > 0) for k, half in columns]

    def law(self, terms: list[LinkTerm]) -> Program | None:
        """The law of some terms beside those of every sum, coefficients solved."""
        return solved([*self.always, *terms], self.link, self.inputs.mapping(), self.response, PRICE)

    def _term(self, program: Program, companion: bool) -> LinkTerm:
        if companion and self.link.logarithms:
            builder = Builder()
            copies = builder.copy(program)
            return LinkTerm(builder.program([builder.apply("log", copies[program.outputs[0]])]))
        return LinkTerm(program, companion)

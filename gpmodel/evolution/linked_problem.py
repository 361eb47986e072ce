"""A response under a link, as a problem of the generations of a search."""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from gpmodel.evolution.description_length import fit_nats, ranked
from gpmodel.evolution.engine import Code, values
from gpmodel.evolution.linked_solution import solved
from gpmodel.evolution.links import Link, LinkTerm
from gpmodel.evolution.problems import Inputs
from gpmodel.evolution.projection import ROUNDING_SHARE, Targets
from gpmodel.evolution.scoring import Scores, projected_scores
from gpmodel.formula.program import Builder, Program

Array = NDArray[np.float64]

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
    def root(self) -> Array:
        """Roots of the points' weights (N,)."""
        return self.link.root_weights(self.response)

    @cached_property
    def targets(self) -> Targets:
        """What is left of the linked response without these terms."""
        there = self.root * self.link.forward(self.response)
        columns = self.inputs.mapping()
        table = np.stack([self.root * term.column(columns, self.response) for term in self.always], axis=1)
        orthonormal, triangle = np.linalg.qr(table)
        diagonal = np.abs(np.diag(triangle))
        orthonormal = orthonormal[:, diagonal > 1e-9 * diagonal.max()]
        rest = there - orthonormal @ (orthonormal.T @ there)
        rest = rest - orthonormal @ (orthonormal.T @ rest)
        ones = np.ones((1, len(there)))
        energy = max(float(rest @ rest), 1e-300)
        return Targets(ones, orthonormal.T[None], rest[None], energy, (self.link.name,), len(there), ROUNDING_SHARE)

    @cached_property
    def share(self) -> float:
        """Share of the linked response's variance that these terms leave."""
        there = self.link.forward(self.response)
        rest = there - np.average(there, weights=self.root**2)
        return self.targets.energy / float(np.sum(np.square(self.root * rest)))

    def offered(self, outputs: Array) -> Array:
        """Columns (P, k m, N) of the linear problem that outputs (P, m, N) of programs offer."""
        columns = np.concatenate([outputs, self.link.companions(outputs, self.response)], axis=1)
        return columns * self.root if self.link.weighted else columns

    def scores(self, code: Code, fixed: Array, hopeless: float = np.inf) -> Scores:
        """Description length and gain of decoded programs, what the link makes of their outputs offered as well."""
        offered = self.offered(values(code, fixed))
        scores = projected_scores(offered, code, len(fixed), self.targets, PRICE)
        if self.link.quotient:
            self._score_quotients(scores, np.ascontiguousarray(offered[:, : offered.shape[1] // 2]))
        return scores

    def _score_quotients(self, scores: Scores, outputs: Array) -> None:
        """Scores anew by what quotients of outputs (P, m, N) leave of the response: a denominator shrinks any error."""
        from gpmodel.evolution.kernels.quotients import share_left_by_quotients

        left = 1.0 - scores.gain
        share_left_by_quotients(outputs, scores.chosen, self.response, PASSES, left)
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

"""A response under a link, as a problem of the generations of a search."""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from gpmodel.evolution.engine import Code, values
from gpmodel.evolution.links import Link, LinkTerm, solved
from gpmodel.evolution.problems import Inputs
from gpmodel.evolution.projection import ROUNDING_SHARE, Targets
from gpmodel.evolution.scoring import Scores, projected_scores
from gpmodel.formula.program import Builder, Program

Array = NDArray[np.float64]

PRICE = 3.0
"""Nats of a node or coefficient (description length; a node is one of some twenty operators and inputs)."""


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
    def targets(self) -> Targets:
        """What is left of the linked response without these terms."""
        there = self.link.forward(self.response)
        columns = self.inputs.mapping()
        table = np.stack([term.column(columns, self.response) for term in self.always], axis=1)
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
        return self.targets.energy / float(np.sum(np.square(there - there.mean())))

    def scores(self, code: Code, fixed: Array, hopeless: float = np.inf) -> Scores:
        """Description length and gain of decoded programs, what the link makes of their outputs offered as well."""
        outputs = values(code, fixed)
        offered = np.concatenate([outputs, self.link.companions(outputs, self.response)], axis=1)
        return projected_scores(offered, code, len(fixed), self.targets, PRICE)

    def law(self, program: Program, chosen: int) -> Program | None:
        """The law of the columns of a program in the bit set ``chosen``."""
        count = len(program.outputs)
        terms = list(self.always)
        for k in range(count):
            for column in (k, k + count):
                if chosen >> column & 1:
                    terms.append(self._term(program.select([k]), column >= count))
        return solved(terms, self.link, self.inputs.mapping(), self.response, PRICE)

    def _term(self, program: Program, companion: bool) -> LinkTerm:
        if companion and self.link.logarithms:
            builder = Builder()
            copies = builder.copy(program)
            return LinkTerm(builder.program([builder.apply("log", copies[program.outputs[0]])]))
        return LinkTerm(program, companion)

"""Histogram of the inputs that evolved programs reference (Robertson 2003, Figs 5.9, 5.12, 5.13), over many runs,
compared with runs on permuted residuals."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import comb

import numpy as np

from gpmodel.arrays import Count, Share
from gpmodel.errors import InputError
from gpmodel.evolution.chance import chance_of
from gpmodel.formula.program import Program


@dataclass(frozen=True)
class RunRecord:
    """Record of the best program of one evolution run.

    representation: name of the representation of programs, `linear` or `tree`.
    shuffled: whether the residual was permuted over the poses.
    strength: gain in nats (effect at a site) or -log(1 - gain) (compensator); larger is better.
    """

    representation: str
    shuffled: bool
    program: Program
    strength: float


@dataclass(frozen=True)
class Histogram:
    """Number of runs whose best program references each input, on the residual and on permuted residuals.

    counts, shuffled: {representation: number of runs per input}, on the residual and on permuted residuals.
    operators: {representation: number of runs that use each operator}.
    runs, shuffled_runs: {representation: number of runs}, on the residual and on permuted residuals.
    count_p, strength_p: the two p-values of each input that ``histogram`` computes.
    significance: limit of both p-values of a significant input.
    """

    inputs: tuple[str, ...]
    counts: Mapping[str, tuple[Count, ...]]
    shuffled: Mapping[str, tuple[Count, ...]]
    operators: Mapping[str, Mapping[str, Count]]
    runs: Mapping[str, Count]
    shuffled_runs: Mapping[str, Count]
    count_p: tuple[Share, ...]
    strength_p: tuple[Share, ...]
    significance: Share

    @property
    def p_values(self) -> tuple[float, ...]:
        """Larger of two p-values of each input: by the number of programs with the input, and by their largest gain."""
        return tuple(map(max, self.count_p, self.strength_p))

    @property
    def significant(self) -> tuple[str, ...]:
        """Names of the inputs whose p-values are both below ``significance``."""
        return tuple(name for name, p in zip(self.inputs, self.p_values, strict=True) if p < self.significance)

    @property
    def referring(self) -> tuple[int, ...]:
        """Number of runs, in all representations, whose best program references an input, for each input."""
        return self._summed(self.counts)

    @property
    def referring_by_chance(self) -> tuple[int, ...]:
        """Number of runs on permuted residuals, in all representations, whose best program references an input, for
        each input."""
        return self._summed(self.shuffled)

    def _summed(self, counts: Mapping[str, tuple[int, ...]]) -> tuple[int, ...]:
        return tuple(map(sum, zip(*counts.values(), strict=True))) or (0,) * len(self.inputs)


def histogram(records: Sequence[RunRecord], inputs: Sequence[str], significance: float) -> Histogram:
    """Count the inputs and operators of the best programs of runs, and test each input.

    Both p-values of an input are corrected for the number of inputs:
    * count: Fisher's exact test of the runs that reference the input against runs on permuted residuals, times the
    number of inputs (Bonferroni);
    * strength: the probability that a run on permuted residuals, with any inputs, is as strong as the input's best run
    (``gpmodel.evolution.chance``). A maximum over all inputs needs no further correction (Westfall, Young 1993).
    Runs on one residual agree even if the residual is noise. Counts alone would therefore make noise significant.
    Raises InputError if there is no run.
    """
    if not records:
        raise InputError("histogram: no run to count")
    names = tuple(inputs)
    kinds = tuple(dict.fromkeys(record.representation for record in records))
    real, null = ([r for r in records if r.shuffled == side] for side in (False, True))
    of_kind = {kind: [r for r in real if r.representation == kind] for kind in kinds}
    by_chance = {kind: [r for r in null if r.representation == kind] for kind in kinds}
    return Histogram(
        names,
        {kind: referencing(runs, names) for kind, runs in of_kind.items()},
        {kind: referencing(runs, names) for kind, runs in by_chance.items()},
        {kind: _using(runs) for kind, runs in of_kind.items()},
        {kind: len(runs) for kind, runs in of_kind.items()},
        {kind: len(runs) for kind, runs in by_chance.items()},
        _by_count(real, null, names),
        _by_strength(real, null, names),
        significance,
    )


def input_prices(histograms: Sequence[Histogram]) -> dict[str, float]:
    """Return the penalty -ln(n p), nats, of using each of n inputs, from the references of evolved programs.

    Probability p of an input: proportional to its Bayes factor (k + 1) / (N + 2) over (k' + 1) / (N' + 2). k of N
    programs evolved on residuals reference the input, k' of N' on permuted residuals. Without runs all penalties are 0.
    """
    references: dict[str, list[int]] = {}
    runs = sum(sum(h.runs.values()) for h in histograms)
    null_runs = sum(sum(h.shuffled_runs.values()) for h in histograms)
    for h in histograms:
        for name, found, null in zip(h.inputs, h.referring, h.referring_by_chance, strict=True):
            both = references.setdefault(name, [0, 0])
            both[0], both[1] = both[0] + found, both[1] + null
    if not runs or not null_runs:
        return {}
    factor = {n: (k + 1) / (runs + 2) * (null_runs + 2) / (null + 1) for n, (k, null) in references.items()}
    mean = sum(factor.values()) / len(factor)
    return {name: math.log(mean / value) for name, value in factor.items()}


def without_runs(inputs: Sequence[str], significance: float) -> Histogram:
    """Return the histogram of a search without runs: every count is zero and every p-value one."""
    certain = (1.0,) * len(inputs)
    return Histogram(tuple(inputs), {}, {}, {}, {}, {}, certain, certain, significance)


def referencing(records: Sequence[RunRecord], inputs: Sequence[str]) -> tuple[int, ...]:
    """Return for each input the number of runs whose program references the input."""
    return tuple(sum(name in record.program.inputs for record in records) for name in inputs)


def _using(records: Sequence[RunRecord]) -> dict[str, int]:
    used = sorted({name for record in records for name in record.program.operator_counts})
    return {name: sum(name in record.program.operator_counts for record in records) for name in used}


def _by_count(real: Sequence[RunRecord], null: Sequence[RunRecord], inputs: Sequence[str]) -> tuple[float, ...]:
    pairs = zip(referencing(real, inputs), referencing(null, inputs), strict=True)
    chances = (_at_least(here, here + there, len(real), len(real) + len(null)) for here, there in pairs)
    return tuple(min(1.0, p * len(inputs)) for p in chances)


def _at_least(count: int, marked: int, drawn: int, total: int) -> float:
    """Return the probability of at least ``count`` marked items among the drawn items (hypergeometric tail)."""
    ways = sum(comb(marked, k) * comb(total - marked, drawn - k) for k in range(count, min(marked, drawn) + 1))
    return ways / comb(total, drawn)


def _by_strength(real: Sequence[RunRecord], null: Sequence[RunRecord], inputs: Sequence[str]) -> tuple[float, ...]:
    strongest = {name: max((r.strength for r in real if name in r.program.inputs), default=-np.inf) for name in inputs}
    by_chance = np.array([record.strength for record in null])
    return tuple(chance_of(strongest[name], by_chance).p for name in inputs)

"""The histogram of referenced inputs (thesis Figs 5.9, 5.12, 5.13) over many runs, against what chance refers to."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import comb

import numpy as np

from gpmodel.arrays import Count, Share
from gpmodel.errors import InputError
from gpmodel.evolution.chance import chance
from gpmodel.formula.program import Program


@dataclass(frozen=True)
class RunRecord:
    """The best program of one run: of which representation, on the residual or on a shuffled one.

    ``strength`` is what it explains, larger is better: the nats saved (slot) or -log(1 - gain) (compensator).
    """

    representation: str
    shuffled: bool
    program: Program
    strength: float


@dataclass(frozen=True)
class Histogram:
    """Runs whose best program references each input in effective code, on the residual and on shuffled ones.

    ``counts`` and ``shuffled`` map a representation to (inputs,) runs, ``operators`` to the runs that use each
    operator; ``runs`` and ``shuffled_runs`` say how many there were. ``count_p`` and ``strength_p`` (inputs,) are the
    two chances of ``p_values``; an input is significant below ``significance``.
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
        """The larger of the two chances (inputs,): an input has to stand out both in number and in what it explains."""
        return tuple(map(max, self.count_p, self.strength_p))

    @property
    def significant(self) -> tuple[str, ...]:
        """Inputs whose p-value is below ``significance``."""
        return tuple(name for name, p in zip(self.inputs, self.p_values, strict=True) if p < self.significance)

    @property
    def referring(self) -> tuple[int, ...]:
        """Runs (inputs,) of all representations that reference each input."""
        return self._summed(self.counts)

    @property
    def referring_by_chance(self) -> tuple[int, ...]:
        """Shuffled runs (inputs,) of all representations that reference each input."""
        return self._summed(self.shuffled)

    def _summed(self, counts: Mapping[str, tuple[int, ...]]) -> tuple[int, ...]:
        return tuple(map(sum, zip(*counts.values(), strict=True))) or (0,) * len(self.inputs)


def histogram(records: Sequence[RunRecord], inputs: Sequence[str], significance: float) -> Histogram:
    """Count, over runs of any representations, the inputs and operators of their best programs.

    Both chances of an input are corrected for the number of inputs, each once:

    * count: Fisher's exact test of the runs that reference it against the shuffled runs that do, times the number of
      inputs (Bonferroni);
    * strength: the chance that a shuffled run explains as much, by whatever inputs, as the best run that references
      this one (``gpmodel.evolution.chance``). A maximum over inputs needs no further correction (Westfall, Young 1993).

    Runs on one residual agree even where there is only noise, so that counting alone would call chance an effect.
    Raises InputError where there is no run at all.
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
    """-ln(n p) of each of n inputs, nats: the price of reading it, from what evolved programs refer to.

    p is in proportion to the Bayes factor of a reference, (k + 1) / (N + 2) over (k' + 1) / (N' + 2): k of N programs
    evolved on residuals refer to the input, k' of N' on permuted ones. Without runs every input costs nothing.
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
    """The histogram of a search that was not made: every count is zero and every chance one."""
    certain = (1.0,) * len(inputs)
    return Histogram(tuple(inputs), {}, {}, {}, {}, {}, certain, certain, significance)


def referencing(records: Sequence[RunRecord], inputs: Sequence[str]) -> tuple[int, ...]:
    """Runs (inputs,) whose program references each input."""
    return tuple(sum(name in record.program.inputs for record in records) for name in inputs)


def _using(records: Sequence[RunRecord]) -> dict[str, int]:
    used = sorted({name for record in records for name in record.program.operator_counts})
    return {name: sum(name in record.program.operator_counts for record in records) for name in used}


def _by_count(real: Sequence[RunRecord], null: Sequence[RunRecord], inputs: Sequence[str]) -> tuple[float, ...]:
    pairs = zip(referencing(real, inputs), referencing(null, inputs), strict=True)
    chances = (_at_least(here, here + there, len(real), len(real) + len(null)) for here, there in pairs)
    return tuple(min(1.0, p * len(inputs)) for p in chances)


def _at_least(count: int, marked: int, drawn: int, total: int) -> float:
    """Chance of at least so many marked ones among those drawn: the upper tail of the hypergeometric distribution."""
    ways = sum(comb(marked, k) * comb(total - marked, drawn - k) for k in range(count, min(marked, drawn) + 1))
    return ways / comb(total, drawn)


def _by_strength(real: Sequence[RunRecord], null: Sequence[RunRecord], inputs: Sequence[str]) -> tuple[float, ...]:
    strongest = {name: max((r.strength for r in real if name in r.program.inputs), default=-np.inf) for name in inputs}
    by_chance = np.array([record.strength for record in null])
    return tuple(chance(strongest[name], by_chance).p for name in inputs)

"""The histogram of referenced inputs (thesis Figs 5.9, 5.12, 5.13) over many runs, against what chance refers to."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpmodel.errors import InputError
from gpmodel.evolution.chance import chance
from gpmodel.formula.program import Program

Array = NDArray[np.float64]

SIGNIFICANCE = 0.05


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
    """Runs whose best program references each input in effective code.

    ``counts`` and ``shuffled`` map a representation to (inputs,) runs, ``operators`` to runs that use each
    operator; ``runs`` and ``shuffled_runs`` are how many there were. ``p_values`` (inputs,) are corrected for
    the number of inputs: an input has to stand out of the shuffled runs both by how often it is referenced and by
    what the best program that references it explains.
    """

    inputs: tuple[str, ...]
    counts: dict[str, NDArray[np.int64]]
    shuffled: dict[str, NDArray[np.int64]]
    operators: dict[str, dict[str, int]]
    runs: dict[str, int]
    shuffled_runs: dict[str, int]
    p_values: Array

    @property
    def significant(self) -> tuple[str, ...]:
        """Inputs whose corrected p-value is below 0.05."""
        return tuple(name for name, p in zip(self.inputs, self.p_values, strict=True) if p < SIGNIFICANCE)


def histogram(records: Sequence[RunRecord], inputs: Sequence[str]) -> Histogram:
    """Count, over runs of any representations, the inputs and operators of their best programs.

    Raises InputError where there is no run at all.
    """
    if not records:
        raise InputError("histogram: no run to count")
    names = tuple(inputs)
    kinds = tuple(dict.fromkeys(record.representation for record in records))
    real = {kind: [r for r in records if r.representation == kind and not r.shuffled] for kind in kinds}
    null = {kind: [r for r in records if r.representation == kind and r.shuffled] for kind in kinds}
    operators = {
        kind: {
            name: sum(name in record.program.operator_counts for record in real[kind])
            for name in sorted({name for record in real[kind] for name in record.program.operator_counts})
        }
        for kind in kinds
    }
    everything, chance = ([r for group in side.values() for r in group] for side in (real, null))
    return Histogram(
        names,
        {kind: referencing(real[kind], names) for kind in kinds},
        {kind: referencing(null[kind], names) for kind in kinds},
        operators,
        {kind: len(real[kind]) for kind in kinds},
        {kind: len(null[kind]) for kind in kinds},
        corrected_p_values(everything, chance, names),
    )


def referencing(records: Sequence[RunRecord], inputs: Sequence[str]) -> NDArray[np.int64]:
    """Runs (inputs,) whose program references each input."""
    return np.array([sum(name in r.program.inputs for r in records) for name in inputs], dtype=np.int64)


def corrected_p_values(real: Sequence[RunRecord], null: Sequence[RunRecord], inputs: Sequence[str]) -> Array:
    """The larger of two p-values an input: of its count and of what its best program explains.

    Count: Fisher's exact test of runs that reference it against shuffled runs that do, times the number of
    inputs. Strength: the chance that the best shuffled program, whatever it references, reaches the best that
    references this input (``gpmodel.evolution.chance``); being a maximum over inputs it needs no further correction.
    """
    if not real:
        return np.ones(len(inputs))
    from scipy.stats import hypergeom

    by_chance = np.array([record.strength for record in null])
    total = len(real) + len(null)
    found = []
    for name, here, there in zip(inputs, referencing(real, inputs), referencing(null, inputs), strict=True):
        count = float(hypergeom.sf(here - 1, total, here + there, len(real)))
        best = max((r.strength for r in real if name in r.program.inputs), default=-np.inf)
        found.append(min(1.0, max(count * len(inputs), chance(best, by_chance).p)))
    return np.array(found)

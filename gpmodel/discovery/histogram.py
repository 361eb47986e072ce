"""The histogram of referenced inputs of one exploration, beside that of runs on shuffled residuals."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy import stats

from gpmodel.evolution.chance import chance
from gpmodel.evolution.search import Evolution


@dataclass(frozen=True)
class Histogram:
    """Runs whose best program references each input in effective code, by representation, and on shuffled residuals.

    p_values: the larger of two chances times the number of inputs: count_p of the count, strength_p of what the best
    such run saves. runs, shuffled_runs: how many there were.
    """

    inputs: tuple[str, ...]
    linear: tuple[int, ...]
    tree: tuple[int, ...]
    shuffled: tuple[int, ...]
    p_values: tuple[float, ...]
    significant: tuple[str, ...]
    count_p: tuple[float, ...]
    strength_p: tuple[float, ...]
    runs: int
    shuffled_runs: int


def referenced(
    inputs: tuple[str, ...], tried: Mapping[str, list[Evolution]], by_chance: list[Evolution],
    saved: Callable[[Evolution], float], significance: float,
) -> Histogram:  # fmt: skip
    """The histogram of referenced inputs of real runs beside that of runs on shuffled residuals.

    Runs on one residual agree even where there is only noise, so counting them is not enough: an input's p-value is the
    larger of the count's and of the chance that a shuffled run saves as much as the best run that references it.
    """

    def count(runs: list[Evolution], name: str) -> int:
        return sum(name in run.best.program.inputs for run in runs)

    null = np.array([saved(run) for run in by_chance])
    real = [run for runs in tried.values() for run in runs]
    by_count, by_strength = [], []
    for name in inputs:
        yes, chance_yes = count(real, name), count(by_chance, name)
        table = [[yes, len(real) - yes], [chance_yes, len(by_chance) - chance_yes]]
        best = max((saved(run) for run in real if name in run.best.program.inputs), default=-np.inf)
        by_count.append(min(1.0, len(inputs) * float(stats.fisher_exact(table, "greater").pvalue)))
        by_strength.append(min(1.0, len(inputs) * chance(best, null).p))
    p_values = tuple(map(max, by_count, by_strength))
    return Histogram(
        inputs=inputs,
        linear=tuple(count(tried.get("linear", []), name) for name in inputs),
        tree=tuple(count(tried.get("tree", []), name) for name in inputs),
        shuffled=tuple(count(by_chance, name) for name in inputs),
        p_values=p_values,
        significant=tuple(n for n, p in zip(inputs, p_values, strict=True) if p < significance),
        count_p=tuple(by_count),
        strength_p=tuple(by_strength),
        runs=len(real),
        shuffled_runs=len(by_chance),
    )

"""The Feynman laws (Udrescu and Tegmark 2020) that `laws` leaves out, and two halves of 48 of them drawn by a seed.

Names, formulas and ranges of `feynman.csv` are those of their database; its hundred less the twelve in `laws`.
"""

import csv
from pathlib import Path

import numpy as np

from experiments.recovery.laws import Law

DRAWN, SEED = 48, 0


def others() -> tuple[Law, ...]:
    """All of the table, in its order."""
    with (Path(__file__).parent / "feynman.csv").open(encoding="utf-8") as file:
        rows = list(csv.reader(file))[1:]
    return tuple(Law(name, dict(map(_variable, ranges.split())), formula) for name, formula, ranges in rows)


def _variable(text: str) -> tuple[str, tuple[float, float]]:
    name, low, high = text.split(":")
    return name, (float(low), float(high))


def halves() -> tuple[tuple[Law, ...], tuple[Law, ...]]:
    """To tune on, and for a last look: 24 each of the 48 drawn by `SEED`."""
    laws = others()
    drawn = [laws[k] for k in np.random.default_rng(SEED).permutation(len(laws))[:DRAWN]]
    return tuple(drawn[: DRAWN // 2]), tuple(drawn[DRAWN // 2 :])

"""Other readings of a table's columns, each with no further unknown, and what it would mean that one fits."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np

from gpmodel.arrays import Array, Mask
from gpmodel.mechanism.protocol import Mechanism

LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "in": 0.0254, "cm": 1e-2}
"""Metres of the units that tables of lengths are written in."""
OF_ANOTHER_SIZE = 5.0
"""Times larger or smaller than the workspace that measured points may be spread."""


@dataclass(frozen=True)
class Reading:
    """meaning: what is wrong and how to write it. q (N, n), position (N, 3): as they were meant. scale: of the lengths
    of the mechanism."""

    meaning: str
    q: Array
    position: Array
    scale: float = 1.0


def of_joints(
    mechanism: Mechanism, q: Array, p: Array, only: Mask | None = None, *, scaled: bool = True
) -> Iterator[Reading]:
    """The other angle unit, the other sign, two columns swapped, an angle counted from its neighbour's.

    only: (n,) bool, the joints that may be read otherwise; None for all. scaled: in the other angle unit, too.
    """
    joints = mechanism.joints
    chosen = np.ones(len(joints), dtype=bool) if only is None else only
    revolute = np.array([j.kind == "revolute" for j in joints])
    units = ((np.pi / 180, "radians", "deg"), (180 / np.pi, "degrees", "rad"))
    for factor, given, meant in units if scaled else ():
        what = f"joint values given as {given} look like {'degrees' if meant == 'deg' else 'radians'}"
        if only is None:
            yield Reading(f"{what}: write [{meant}] in their headers", np.where(revolute, q * factor, q), p)
        for i in np.flatnonzero(revolute & chosen).tolist():
            yield Reading(f"column '{joints[i].name}' looks like [{meant}], given as {given}", _scaled(q, i, factor), p)
    for i in np.flatnonzero(chosen).tolist():
        yield Reading(f"column '{joints[i].name}' looks counted the other way round", _scaled(q, i, -1.0), p)
    for i, k in combinations(range(len(joints)), 2):
        if chosen[i] and chosen[k]:
            order = np.arange(len(joints))
            order[[i, k]] = k, i
            yield Reading(f"columns '{joints[i].name}' and '{joints[k].name}' look swapped", q[:, order], p)
    for i, k in permutations(range(len(joints)), 2):
        if abs(i - k) == 1 and chosen[i] and revolute[i] and revolute[k]:
            for sign, word in ((1.0, "+"), (-1.0, "-")):
                coupled = q.copy()
                coupled[:, i] += sign * q[:, k]
                name, other = joints[i].name, joints[k].name
                yield Reading(f"column '{name}' looks as if it were to be '{name}' {word} '{other}'", coupled, p)


def of_lengths(q: Array, p: Array, spread: float, reach: float) -> Iterator[Reading]:
    """Units of x, y and z, or of one of them, and a mirrored frame.

    spread, reach: RMS distance, m, of the points and of the flange from their centres.
    """
    for ratio in sorted({a / b for a in LENGTHS.values() for b in LENGTHS.values()} - {1.0}):
        if 1.0 / OF_ANOTHER_SIZE < spread * ratio / max(reach, 1e-9) < OF_ANOTHER_SIZE:
            yield Reading(f"x, y and z look {_wrong_by(ratio)}", q, p * ratio)
        for k, axis in enumerate("xyz"):
            if ratio in (1e3, 1e-3, 25.4, 1 / 25.4):
                yield Reading(f"column '{axis}' looks {_wrong_by(ratio)}", q, _scaled(p, k, ratio))
    mirrored = p * np.array([-1.0, 1.0, 1.0])
    yield Reading("two of the columns x, y, z look swapped, or one has the wrong sign", q, mirrored)


def of_the_mechanism(name: str, q: Array, p: Array) -> Iterator[Reading]:
    """Lengths of the description in another unit."""
    for ratio in (1e-3, 1e3):
        what = f"the lengths of {name} look {1 / ratio:g} times too {'large' if ratio < 1 else 'small'}"
        how = (
            "millimetres written where metres are meant" if ratio < 1 else "metres written where millimetres are meant"
        )
        yield Reading(f"{what}, {how}: correct the description, not the table", q, p, ratio)


def _scaled(values: Array, column: int, factor: float) -> Array:
    out = values.copy()
    out[:, column] *= factor
    return out


def _wrong_by(ratio: float) -> str:
    pairs = [(a, b) for a in LENGTHS for b in LENGTHS if np.isclose(LENGTHS[a] / LENGTHS[b], ratio, rtol=1e-9)]
    size = f"{ratio:g} times too small" if ratio > 1 else f"{1 / ratio:g} times too large"
    return f"{size}, as {' or '.join(f'[{meant}] given as [{given}]' for meant, given in pairs)}"

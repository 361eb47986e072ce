"""Alternative interpretations of the columns of a table, without further unknowns, each with a text for the user."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np

from gpmodel.arrays import Array, Mask
from gpmodel.mechanism.protocol import Mechanism

LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "in": 0.0254, "cm": 1e-2}
"""Units of length in tables, and their size in metres."""
OF_ANOTHER_SIZE = 5.0
"""Largest plausible ratio of the spread of measured points to the workspace, or of the workspace to the spread."""
MIRROR_IMAGE = "two of the columns x, y, z look swapped, or one has the wrong sign"
ALIKE = 1.5
"""Ratio of a residual to the smallest up to which another interpretation of columns is also named as likely."""
SCREENED = 200
"""Number of interpretations of the columns that are computed at once, to limit the memory."""
MOST_ORDERED = 6
"""Largest number of joints whose columns are tried in all orders (720 orders)."""


@dataclass(frozen=True)
class Reading:
    """An interpretation of the columns of a table.

    meaning: description of the table's error and its correction.
    q, position: joint values and positions of the interpretation, rad and m.
    scale: factor on the lengths of the mechanism.
    """

    meaning: str
    q: Array
    position: Array
    scale: float = 1.0


def joint_readings(
    mechanism: Mechanism, q: Array, p: Array, only: Mask | None = None, *, scaled: bool = True
) -> Iterator[Reading]:
    """Yield interpretations with the other angle unit, the other sign, two swapped columns, or two coupled joints.

    only: mask of joints whose columns may change; None for all joints.
    scaled: True to include deg for rad or rad for deg.
    """
    joints = mechanism.joints
    chosen = np.ones(len(joints), dtype=bool) if only is None else only
    revolute = np.array([j.kind == "revolute" for j in joints])
    units = ((np.pi / 180, "radians", "deg"), (180 / np.pi, "degrees", "rad"))
    for factor, given, meant in units if scaled else ():
        what = f"joint values given as {given} look like {'degrees' if meant == 'deg' else 'radians'}"
        if only is None:
            yield Reading(f"{what}: write [{meant}] in the headers", np.where(revolute, q * factor, q), p)
        for i in np.flatnonzero(revolute & chosen).tolist():
            yield Reading(f"column '{joints[i].name}' looks like [{meant}], given as {given}", _scaled(q, i, factor), p)
    for i in np.flatnonzero(chosen).tolist():
        yield Reading(f"column '{joints[i].name}' probably has the opposite sign", _scaled(q, i, -1.0), p)
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
                yield Reading(f"column '{name}' should probably be '{name}' {word} '{other}'", coupled, p)


def sign_readings(mechanism: Mechanism, q: Array, p: Array) -> Iterator[Reading]:
    """Yield interpretations with opposite signs of several joints, as for a mirrored arm or another controller."""
    names = [j.name for j in mechanism.joints]
    for size in range(2, len(names) + 1):
        for chosen in combinations(range(len(names)), size):
            flipped = np.where(np.isin(np.arange(len(names)), chosen), -q, q)
            yield Reading(f"columns {listed([names[i] for i in chosen])} probably have the opposite sign", flipped, p)


def order_readings(mechanism: Mechanism, q: Array, p: Array) -> Iterator[Reading]:
    """Yield interpretations with the joint columns in reverse order, rotated, or in any order for few joints."""
    names, count = [j.name for j in mechanism.joints], len(mechanism.joints)
    first = np.arange(count)
    yield Reading("the joint columns look in reverse order", q[:, ::-1], p)
    orders = permutations(range(count)) if count <= MOST_ORDERED else (np.roll(first, k) for k in range(1, count))
    for order in map(list, orders):
        held = listed([names[order.index(i)] for i in range(count)])
        yield Reading(f"the joint columns look to hold, in this order, {held}", q[:, order], p)


def listed(names: Sequence[str]) -> str:
    """Return the quoted names as a list in words."""
    quoted = [f"'{name}'" for name in names]
    return " and ".join([", ".join(quoted[:-1]), quoted[-1]] if len(quoted) > 1 else quoted)


def length_readings(q: Array, p: Array, spread: float, reach: float) -> Iterator[Reading]:
    """Yield interpretations with other units of x, y and z, or of one of these coordinates, and with a mirrored frame.

    spread, reach: RMS distance, m, of the measured points and of the flange from their centres.
    """
    for ratio in sorted({a / b for a in LENGTHS.values() for b in LENGTHS.values()} - {1.0}):
        if 1.0 / OF_ANOTHER_SIZE < spread * ratio / max(reach, 1e-9) < OF_ANOTHER_SIZE:
            yield Reading(f"x, y and z look {_wrong_by(ratio)}", q, p * ratio)
        for k, axis in enumerate("xyz"):
            if ratio in (1e3, 1e-3, 25.4, 1 / 25.4):
                yield Reading(f"column '{axis}' looks {_wrong_by(ratio)}", q, _scaled(p, k, ratio))
    mirrored = p * np.array([-1.0, 1.0, 1.0])
    yield Reading(MIRROR_IMAGE, q, mirrored)


def mechanism_readings(name: str, q: Array, p: Array) -> Iterator[Reading]:
    """Yield interpretations with the lengths of the mechanism's description in another unit."""
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

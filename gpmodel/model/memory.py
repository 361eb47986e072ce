"""Columns with memory: inputs of basis functions that depend on the poses measured before.

Expressions may contain the names of columns with memory. The name of a column with memory ends with the constant of its
operator (`p`: decimal point):

    last_move_J2            sign of the last move of the joint, 0 before its first move
    play_J2_0p01            play operator of half-width r:  y_k = max(x_k - r, min(x_k + r, y_(k-1))), y_0 = x_0
    stop_torque_J2_40       stop operator, x - play: within ±r
    lag_temperature_2400    first order lag, tau dy/dt = x - y, y_0 = x_0, over `time` or the rows

If the table declares the direction of approach of a joint (`approach_J2`), that direction replaces `last_move_J2`. Rows
are taken as the path of a joint only if its declared direction agrees with the moves between rows.

Sources: Visintin 1994, ch. III (play and stop; their sums are Prandtl and Ishlinskii's hysteresis); ISO 230-2, 3.3
(direction of approach).
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gpmodel.arrays import ROUNDING, Array, IntArray
from gpmodel.errors import InputError
from gpmodel.table.blocks import SAME_JOINT
from gpmodel.table.dataset import Dataset
from gpmodel.table.units import TEMPERATURES, is_time

OFTEN = 0.05
"""Least share of rows with a joint value close to the previous row's, for the joint to count as standing still. Of
random poses in a joint range of 0.2 rad, one in two hundred is within SAME_JOINT of the previous pose."""
_LAST_MOVE = re.compile(r"last_move_(?P<of>\w+)$")
_WITH_CONSTANT = re.compile(r"(?P<what>play|stop|lag)_(?P<of>\w+)_(?P<size>\d+(?:p\d+)?)$")
APPROACH = "approach"
"""Column of directions of approach, ±1, of all joints; with the name of a joint appended, of that joint."""
FEWEST_ROWS = 10
"""Least number of rows with rising times for the rows to count as ordered. Random times rise in 1 of 10! tables."""


def word(value: float, digits: int = 4) -> str:
    """Write a positive constant for the end of a column name, such as 0.0123 as `0p0123`."""
    return np.format_float_positional(float(f"{value:.{digits}g}"), trim="-").replace(".", "p")


def read_by(name: str) -> tuple[str, ...]:
    """Return the source columns of a column with memory, such as J2 of `last_move_J2`; none of other columns."""
    match = _LAST_MOVE.match(name) or _WITH_CONSTANT.match(name)
    return (match["of"],) if match else ()


def columns_of(names: Iterable[str]) -> set[str]:
    """Return the columns from which inputs are computed: the source of a column with memory, otherwise the input."""
    return {column for name in names for column in read_by(name) or (name,)}


def constant_of(name: str) -> tuple[str, str, float] | None:
    """Return the operation of a column with memory (`play`, `stop`, `lag`), its source column and its constant.

    Names of columns without memory give None.
    """
    match = _WITH_CONSTANT.match(name)
    return (match["what"], match["of"], float(match["size"].replace("p", "."))) if match else None


@dataclass(frozen=True, eq=False)
class Past:
    """The columns of a whole table in the order of measurement, and the columns with memory computed from them.

    clock: name of the column of times, or `row` for the row number. A column with memory (of earlier poses) is computed
    once, on first use.
    """

    columns: Mapping[str, Array]
    units: Mapping[str, str]
    clock: str
    _known: dict[str, Array] = field(default_factory=dict)

    def column(self, name: str) -> Array | None:
        """Return the values of a column that depends on earlier poses, by its name, or None for any other name."""
        if name not in self._known:
            sources = read_by(name)
            if not sources or sources[0] not in self.columns:
                return None
            order = np.argsort(self.columns["row"], kind="stable")
            values = np.empty(len(order))
            values[order] = self._in_order(name, self.columns[sources[0]][order], order)
            self._known[name] = values
        return self._known[name]

    def unit(self, name: str) -> str:
        """Return the unit of a column with memory: that of its source column, or `1` for a direction."""
        return "1" if _LAST_MOVE.match(name) else self.units[read_by(name)[0]]

    def _in_order(self, name: str, values: Array, order: IntArray) -> Array:
        match = _WITH_CONSTANT.match(name)
        if match is None:
            joint = self.units[read_by(name)[0]] in ("rad", "m")
            return last_move(values, self.columns["row"][order], jitter(values) if joint else 0.0)
        size = float(match["size"].replace("p", "."))
        if match["what"] == "lag":
            return lag(values, self.columns[self.clock][order], size)
        behind = play(values, size)
        return behind if match["what"] == "play" else values - behind


def jitter(values: Array) -> float:
    """Return the change of a joint value between rows (rad or m) up to which the joint counts as standing still.

    For measured values of a joint at rest, the threshold is SAME_JOINT: more than the share OFTEN of the rows differs
    from the previous row by less. For commanded joint values, the threshold is ROUNDING.
    """
    steps = np.abs(np.diff(values))
    held = np.sum((steps > ROUNDING) & (steps <= SAME_JOINT))
    return SAME_JOINT if held > OFTEN * len(values) else ROUNDING


def last_move(values: Array, rows: Array, still: float) -> Array:
    """Return at each row the sign of the last move of more than `still`; 0 before the first move and after a gap in the
    row numbers."""
    out = np.zeros(len(values))
    side, at = 0.0, values[0] if len(values) else 0.0
    for k in range(1, len(values)):
        if rows[k] > rows[k - 1] + 1:
            side, at = 0.0, values[k]
        elif abs(values[k] - at) > still:
            side, at = (1.0 if values[k] > at else -1.0), values[k]
        out[k] = side
    return out


def play(values: Array, half_width: float) -> Array:
    """Return the play operator at each row: the output follows the input at a distance of at most `half_width`."""
    out = np.array(values, dtype=float)
    for k, value in enumerate(values[1:].tolist(), 1):
        out[k] = max(value - half_width, min(value + half_width, out[k - 1]))
    return out


def lag(values: Array, time: Array, constant: float) -> Array:
    """Return the solution y of tau dy/dt = x - y, with input x linear between rows, time constant tau and y_0 = x_0."""
    out = np.array(values, dtype=float)
    step = np.diff(time) / constant
    decay = np.exp(-step)
    mean = np.where(step > 1e-9, -np.expm1(-step) / np.where(step > 0, step, 1.0), 1.0)
    drive = (mean - decay) * values[:-1] + (1.0 - mean) * values[1:]
    for k, (keeps, takes) in enumerate(zip(decay.tolist(), drive.tolist(), strict=True), 1):
        out[k] = keeps * out[k - 1] + takes
    return out


def clock_of(dataset: Dataset) -> str | None:
    """Return the column that orders the rows: a column of times that never falls, or `row` if the table states it.

    Rows of unknown order give None. Raises InputError if the table states an order and a time falls.
    """
    times = [name for name, unit in dataset.extra_units.items() if is_time(unit)]
    for name in times:
        steps = np.diff(dataset.extras[name][np.argsort(dataset.row, kind="stable")])
        if len(dataset) >= FEWEST_ROWS and np.all(steps >= 0) and np.any(steps > 0):
            return name
        if dataset.in_order and np.any(steps < 0):
            row = np.sort(dataset.row)[int(np.argmax(steps < 0)) + 1]
            raise InputError(
                f"{dataset.source}: rows are stated to be in the order of measurement, but '{name}' falls at row "
                f"{row}; sort the rows, or omit --in-order"
            )
    return "row" if dataset.in_order else None


def declared_approach(joints: Sequence[str], columns: Iterable[str]) -> dict[str, str]:
    """Return the column of the table that declares the direction of approach, for each joint that has one.

    An approach column is named after a joint or its number in the chain; `approach` declares all other joints.
    """
    there = set(columns)
    numbered = [f"J{i}" if f"J{i}" not in joints else joint for i, joint in enumerate(joints, 1)]
    named = {j: (f"{APPROACH}_{j}", f"{APPROACH}_{n}", APPROACH) for j, n in zip(joints, numbered, strict=True)}
    return {j: next(name for name in names if name in there) for j, names in named.items() if there & set(names)}


def _agrees(past: Past, joint: str, approach: str) -> bool:
    """Return whether declared directions of approach have the sign, or always the opposite sign, of the last moves."""
    moves = past.column(f"last_move_{joint}")
    both = np.sign(past.columns[approach]) * moves
    return bool(np.all(both >= 0) or np.all(both <= 0))


def standing(past: Past, joints: Sequence[str]) -> list[str]:
    """Return the columns with memory (of earlier poses) that every search for effects uses.

    The columns with memory are the last move of each moving joint without a declared direction of approach, the stop
    operator over a tenth of the range of each moving joint whose path is known, and temperatures with a lag of a
    thirtieth, a tenth and a third of the session.
    """
    moving = {j: float(np.ptp(past.columns[j])) for j in joints if np.ptp(past.columns[j]) > SAME_JOINT}
    declared = declared_approach(joints, past.columns)
    names = [f"last_move_{j}" for j in moving if j not in declared]
    known = {j: span for j, span in moving.items() if j not in declared or _agrees(past, j, declared[j])}
    names += [f"stop_{j}_{word(0.1 * span)}" for j, span in known.items()]
    session = float(np.ptp(past.columns[past.clock]))
    warm = [c for c in temperatures(past.units) if np.ptp(past.columns[c]) > 0]
    return names + [f"lag_{c}_{word(session / share)}" for c in warm for share in (30, 10, 3)]


def temperatures(units: Mapping[str, str]) -> list[str]:
    """Return the names of the columns with a unit of temperature."""
    return [c for c, unit in units.items() if unit in TEMPERATURES.values()]

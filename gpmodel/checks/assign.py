"""Assign columns of a table to joints and measured points, so that the nominal mechanism fits with a small residual."""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.checks.formulas import EQUALLY, formula_readings
from gpmodel.checks.mixed_up import FEWEST_ROWS, GOOD_SHARE, MOST_ROWS, typical_rows
from gpmodel.checks.notes import POOR_LENGTH, Registered, flange, least_misfit, registered, spread_of
from gpmodel.checks.readings import ALIKE, LENGTHS, MIRROR_IMAGE, OF_ANOTHER_SIZE, Reading, joint_readings, listed
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import Mechanism, closed
from gpmodel.numerics.least_squares import OUTLIER_SHARE, root_mean_square
from gpmodel.table.layout import Sheet, name_and_unit
from gpmodel.table.robot_programs import fields_of
from gpmodel.table.units import factor_like

Columns = tuple[int, ...]
NOMINAL = ("nom", "target", "cmd", "command", "soll", "set", "desired", "program", "theor", "design", "cad", "ref")
ACTUAL = ("act", "meas", "ist", "real", "encoder", "feedback", "observed")
"""Words in column names of a table that indicate commanded values, and words that indicate measured values."""
_WORDS = re.compile(r"[^A-Za-z]+|(?<=[a-z])(?=[A-Z])")


def joint_families(names: Sequence[str], mechanism: Mechanism, numeric: Sequence[int]) -> Iterator[Columns]:
    """Yield columns of all joints in order: columns with the joints' names, or with names that differ in a number."""
    count = len(mechanism.joints)
    bare = {i: re.sub(r"\W|_", "", names[i]).casefold() for i in numeric}
    joint_names = [re.sub(r"\W|_", "", joint.name).casefold() for joint in mechanism.joints]
    for wanted, ending in ((joint_names, ""), (joint_names, "joint"), (_in_programs(mechanism), "")):
        found = [[i for i, name in bare.items() if (word := w.removesuffix(ending)) and word in name] for w in wanted]
        exact = [[i for i in part if bare[i] == w] or part for part, w in zip(found, wanted, strict=True)]
        if exact and all(len(part) == 1 for part in exact) and len({i for part in exact for i in part}) == count:
            yield tuple(part[0] for part in exact)
            break
    groups: dict[str, dict[int, list[int]]] = {}
    for i in numeric:
        for number in re.finditer(r"\d{1,9}", names[i]):
            stem = f"{names[i][: number.start()]}#{names[i][number.end() :]}".casefold()
            groups.setdefault(stem, {}).setdefault(int(number[0]), []).append(i)
    for group in groups.values():
        for first in sorted(group):
            if all(first + k in group for k in range(count)):
                copies = min(len(group[first + k]) for k in range(count))
                yield from (tuple(group[first + k][c] for k in range(count)) for c in range(copies))


def _in_programs(mechanism: Mechanism) -> list[str]:
    """Return the names of a mechanism's joints in robot programs, a1 to a6 and e1 to e6; empty if it has no such."""
    with suppress(InputError):
        return [field.casefold() for field in fields_of(mechanism, None)]
    return []


def xyz_triples(names: Sequence[str], numeric: Sequence[int], letters: Sequence[str] = ("xyz",)) -> Iterator[Columns]:
    """Yield three columns whose names differ in one letter, x, y and z. Of columns with one name, the next to the right
    is used."""
    for i, word in product(numeric, letters):
        for place, letter in enumerate(names[i]):
            if letter.lower() != word[0]:
                continue
            others = []
            for other in word[1:]:
                same = other.upper() if letter.isupper() else other
                name = f"{names[i][:place]}{same}{names[i][place + 1 :]}"
                alike = [k for k in numeric if names[k] == name]
                others += [min(alike, key=lambda k: (k < i, abs(k - i)))] if alike else []
            if len(others) == len(word) - 1:
                yield (i, *others)


def windows(numeric: Sequence[int], count: int, strides: Sequence[int] = (1,)) -> Iterator[Columns]:
    """Yield groups of `count` adjacent columns of a table, or of columns at equal distances `strides`."""
    known = set(numeric)
    for stride, first in product(strides, numeric):
        found = tuple(first + stride * k for k in range(count))
        if known.issuperset(found):
            yield found


def role_of(names: Sequence[str], columns: Columns) -> int:
    """Return 1 if the names of the columns indicate measured values, -1 if they indicate commanded values, else 0."""
    words = [word.lower() for i in columns for word in _WORDS.split(names[i]) if word]
    nominal = any(word.startswith(NOMINAL) for word in words)
    return any(word.startswith(ACTUAL) for word in words) - nominal


MOST_COLUMNS = 60
"""Largest number of numeric columns that are tried as joints and coordinates regardless of their names."""
ENOUGH_TO_SCREEN = 25
"""Number of rows from which a lower bound of the residual, with 13 unknowns per coordinate, can exclude columns."""
ROUGH, ROUNDS = 0.25, 8
"""Largest residual of a coarse fit as a share of the spread of the points, and its number of iterations. For ten poses
of three arms the residual was a share of 0.004; with points of wrong rows 0.6."""
MOST_DEGREES = 370.0
"""Largest joint value, deg, in table columns that are not identified as joints by their names."""
Readings = Callable[[Mechanism, Array, Array], Iterator[Reading]]
SI_UNIT = {"revolute": "rad", "prismatic": "m"}
WRITTEN_IN = {"revolute": ("deg", "rad"), "prismatic": ("mm", "m")}
"""Units in which tables give joint values, by the kind of joint."""


class Axis(NamedTuple):
    """Name and unit of a table column, from its header. sure: True if the unit is in brackets or in a line of units."""

    name: str
    unit: str | None
    sure: bool


@dataclass(frozen=True)
class Fit:
    """Columns of the joints and of a point, with the units for which the residual is small.

    left: RMS residual of a fit of registration and tool, m.
    reading: text on the necessary change of the joint values, empty if no change is needed.
    turned: factors of the joint columns and constants, (joints, joints + 1), rad and m, of the change.
    rows: numbers of the compared rows.
    q: joint values (compared rows, joints), rad and m.
    position: measured points (compared rows, 3), m.
    found: registration fitted to the points.
    """

    joints: Columns
    units: tuple[str, ...]
    points: Columns
    unit: str
    left: float
    rows: IntArray
    q: Array
    position: Array
    found: Registered
    reading: str = ""
    turned: Array | None = None


class Assigner:
    """Search for assignments of a sheet's columns to joints and points, compared on at most 60 rows."""

    def __init__(self, sheet: Sheet, mechanism: Mechanism, rows: IntArray | None = None) -> None:
        self.mechanism = mechanism
        self.axes = [header_of(sheet, i) for i in range(len(sheet.names))]
        self.values = {i: v.to_numpy() for i in sheet.columns if (v := sheet.numbers(i)) is not None}
        self.moving = {i for i, v in self.values.items() if np.nanmax(v) > np.nanmin(v)}
        self.rows = np.arange(len(sheet.cells)) if rows is None else rows

    def fits(self) -> list[Fit]:
        """Return all assignments by the names of the columns or, if none fits, by the positions of the columns."""
        readings = (None, partial(joint_readings, scaled=False))
        names, numeric = [axis.name for axis in self.axes], sorted(self.values)
        count, few = len(self.mechanism.joints), numeric[:MOST_COLUMNS]
        named = list(dict.fromkeys(joint_families(names, self.mechanism, numeric)))
        largest = {i: float(np.nanmax(np.abs(v))) for i, v in self.values.items()}
        placed = [
            c for c in windows(few, count, (1, 2, 3))
            if max(largest[i] for i in c) < MOST_DEGREES and 2 * len(self.moving & set(c)) >= count
        ]  # fmt: skip
        varied = [i for i in numeric if i in self.moving]
        points, beside = (
            list(dict.fromkeys(xyz_triples(names, varied))),
            list(windows(varied[:MOST_COLUMNS], 3, (1, 2, 4))),
        )
        for joints, triples in product((named, placed), (points, beside)):
            if found := list(self._fits(joints, triples, readings if joints is named else (None,))):
                return found
        return []

    def turned(self) -> list[Fit]:
        """Return the first fit of columns with the joints' names after changes of joint zeros, signs and couplings."""
        names = [axis.name for axis in self.axes]
        joints = list(dict.fromkeys(joint_families(names, self.mechanism, sorted(self.values))))[:1]
        varied = [i for i in sorted(self.values) if i in self.moving and i not in joints[0]] if joints else []
        points = list(dict.fromkeys(xyz_triples(names, varied)))[:1] or list(windows(varied, 3))
        return list(self._fits(joints, points, (formula_readings,)))

    def _fits(
        self, joints: Iterable[Columns], triples: Sequence[Columns], readings: Sequence[Readings | None]
    ) -> Iterator[Fit]:
        for columns in joints:
            rest = [t for t in triples if not set(t) & set(columns)]
            for reread in readings[: 1 if closed(self.mechanism) else None]:
                found = [
                    fit for units in self._units(columns) for points in rest
                    for fit in self._of(columns, units, points, reread)
                ]  # fmt: skip
                yield from found
                if found:
                    break

    def _units(self, columns: Columns) -> Iterator[tuple[str, ...]]:
        """Yield possible units of the joint columns: units in the headers, then one unit for all joints of a kind."""
        kinds, seen = [joint.kind for joint in self.mechanism.joints], set()
        slides = WRITTEN_IN["prismatic"] if "prismatic" in kinds else ()
        for turn, slide in product((None, *WRITTEN_IN["revolute"]), (None, *slides)):
            chosen = {"revolute": turn, "prismatic": slide}
            own = [
                self.axes[i].unit if si_of(self.axes[i].unit, k) else None for i, k in zip(columns, kinds, strict=True)
            ]
            units = tuple(chosen[k] or unit or WRITTEN_IN[k][0] for k, unit in zip(kinds, own, strict=True))
            if units not in seen:
                seen.add(units)
                yield units

    def _of(self, columns: Columns, units: tuple[str, ...], points: Columns, reread: Readings | None) -> Iterator[Fit]:
        """Yield the fit of given joint columns, or a fit for each change of joint values that `reread` yields."""
        rows = self.rows[np.isfinite([self.values[i][self.rows] for i in (*columns, *points)]).all(axis=0)]
        raw = np.column_stack([self.values[i][rows] for i in points])
        rows, raw = rows[np.ptp(raw, axis=1) > 0], raw[np.ptp(raw, axis=1) > 0]
        step = max(1, len(rows) // MOST_ROWS)
        rows, raw = rows[::step], raw[::step]
        if len(rows) < FEWEST_ROWS or not np.ptp(raw, axis=0).any():
            return
        kinds = [joint.kind for joint in self.mechanism.joints]
        q = np.column_stack([si_of(u, k) * self.values[i][rows] for i, u, k in zip(columns, units, kinds, strict=True)])
        if reread is None:
            if (best := self._registered(flange(self.mechanism, q), raw, points)) is not None:
                p = si_of(best[0], "prismatic") * raw
                yield Fit(columns, units, points, best[0], best[1], rows, q, p, best[2])
            return
        for reading in reread(self.mechanism, q, raw):
            if (best := self._registered(flange(self.mechanism, reading.q), raw, points)) is not None:
                p = si_of(best[0], "prismatic") * raw
                yield Fit(
                    columns, units, points, best[0], best[1], rows, reading.q, p, best[2], reading.meaning,
                    _formulas(q, reading.q),
                )  # fmt: skip

    def _registered(self, frames: Array, raw: Array, points: Columns) -> tuple[str, float, Registered] | None:
        """Return the unit of points (rows, 3), the residual and the registration, or None if no unit gives a small
        residual."""
        if len(raw) >= ENOUGH_TO_SCREEN and not _may_fit(frames, raw):
            return None
        said, reach = [self.axes[i].unit for i in points], spread_of(frames[:, :3, 3])
        given = said[0] if len(set(said)) == 1 and si_of(said[0], "prismatic") else None
        best: tuple[str, float, Registered] | None = None
        for unit in dict.fromkeys([given, *LENGTHS] if given else LENGTHS):
            p = si_of(unit, "prismatic") * raw
            if not 1.0 / OF_ANOTHER_SIZE < spread_of(p) / max(reach, 1e-9) < OF_ANOTHER_SIZE:
                continue
            if len(raw) < ENOUGH_TO_SCREEN and _roughly(frames, p) > ROUGH * spread_of(p):
                continue
            most, errors = typical_rows(frames, p)
            left = root_mean_square(errors[most])
            if left < max(POOR_LENGTH, GOOD_SHARE * min(spread_of(p), reach) / 2) and (best is None or left < best[1]):
                best = unit, left, registered(frames[most], p[most])
        return best


def sign_doubts(mechanism: Mechanism, fit: Fit) -> list[str]:
    """Return questions to the user if two interpretations of joints or mirrored positions fit equally well."""
    equal = [fit.reading] if EQUALLY in fit.reading else []
    if fit.turned is None or not (flipped := np.diag(fit.turned) < 0).any():
        return equal
    frames, mirrored = flange(mechanism, np.where(flipped, -fit.q, fit.q)), fit.position * [-1.0, 1.0, 1.0]
    most, errors = typical_rows(frames, mirrored)
    if root_mean_square(errors[most]) > ALIKE * fit.left:
        return equal
    names = listed([joint.name for joint, wrong in zip(mechanism.joints, flipped.tolist(), strict=True) if wrong])
    return [
        *equal,
        f"opposite signs of {names} are inferred, but the positions fit as well if {MIRROR_IMAGE}; expected corrected "
        "positions in the file in the second case",
    ]


def header_of(sheet: Sheet, column: int) -> Axis:
    """Return name and unit of a column from its header in the sheet."""
    return Axis(*name_and_unit(sheet.names[column]))


def si_of(unit: str | None, kind: str) -> float:
    """Return the factor from a unit to rad or m, by kind of joint; 0 for a unit that is not one of the joint's kind
    (angle or length)."""
    return factor_like(unit or "", SI_UNIT[kind]) or 0.0


def _formulas(q: Array, meant: Array) -> Array:
    """Return factors and constants (joints, joints + 1) that convert joint values `q` to the joint values `meant`."""
    change = meant - q
    factors = np.round(np.linalg.lstsq(q - q.mean(axis=0), change - change.mean(axis=0))[0]).T
    zeros = (change - q @ factors.T).mean(axis=0)
    return np.column_stack([np.eye(q.shape[1]) + factors, np.where(np.abs(zeros) > np.radians(1.0), zeros, 0.0)])


def _roughly(frames: Array, p: Array) -> float:
    """Return the median error, m, of points (poses, 3) after eight alternating fits of registration and tool point."""
    tool: Array = np.zeros(3)
    for _ in range(ROUNDS):
        found = Registered.of(frames, p, tool)
        left = (p - found.shift) @ found.turn - frames[:, :3, 3]
        tool = np.asarray(np.linalg.lstsq(frames[:, :3, :3].reshape(-1, 3), left.ravel())[0], dtype=np.float64)
    return float(np.median(found.errors(frames, p)))


def _may_fit(frames: Array, raw: Array) -> bool:
    """Return True if points (poses, 3), except for a share of outliers, could fit in some unit of length."""
    columns = np.hstack([np.ones((len(frames), 1)), frames[:, :3, 3], frames[:, :3, :3].reshape(-1, 9)])
    kept = np.arange(len(raw))
    for _ in range(3):
        left = np.linalg.norm(raw - columns @ np.linalg.lstsq(columns[kept], raw[kept])[0], axis=1)
        kept = np.sort(np.argsort(left)[: round((1.0 - OUTLIER_SHARE) * len(raw))])
    return bool(least_misfit(frames[kept], raw[kept]) < GOOD_SHARE * spread_of(raw[kept]))

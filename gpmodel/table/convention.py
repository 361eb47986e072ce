"""Convention of joint values: signs, zeros, couplings and order of a controller's axes relative to a description."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from gpmodel.arrays import Array
from gpmodel.characters import is_name
from gpmodel.errors import InputError
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.table.cells import joint_table, numbers
from gpmodel.table.units import JOINT_UNITS, factor, factor_like, identifier, split_header

COLUMN, PREFIX, SENT = "convention", "controller_", "to_controller_"
"""Table column with the convention of the joint values, prefix of columns with joint values in the convention of the
controller, and prefix of columns with corrected joint values in the convention of the controller."""
LONGEST = 5_000
"""Largest number of characters of a convention: 200 joints with couplings."""
EXPECTED = "expected one formula a joint with signs and whole numbers of axes, as in J1 = -A1; J2 = 90 - A2"
_TRIED = 1e-9
"""Largest relative deviation of a formula from a sum of its inputs, by rounding."""
_SHOWN = {"revolute": ("deg", float(np.degrees(1.0))), "prismatic": ("mm", 1e3)}
"""Unit of the controller's values in texts and tables, and its number in a rad or m, by kind of joint."""


@dataclass(frozen=True)
class Convention:
    """Joint values of a description as functions of the controller's values: q = turned c + zero.

    axes: the controller's names of the axes, in the order of the joints that they move. text: one formula a joint, with
    degrees and millimetres. turned: (n, n), whole numbers. zero: (n,), rad or m. kinds: kind of each joint.
    """

    text: str
    axes: tuple[str, ...]
    turned: Array
    zero: Array
    kinds: tuple[str, ...]

    def of_description(self, values: Array) -> Array:
        """Return joint values q (poses, n) of the description, from the controller's values, rad or m."""
        return np.asarray(values @ self.turned.T + self.zero)

    def of_controller(self, q: Array) -> Array:
        """Return the controller's values (poses, n), from joint values of the description, rad or m."""
        return np.asarray((q - self.zero) @ np.round(np.linalg.inv(self.turned)).T)

    @property
    def unchanged(self) -> bool:
        """True if the controller has the signs and zeros of the description."""
        return bool((self.turned == np.eye(len(self.zero))).all() and not self.zero.any())

    def columns(self, q: Array, prefix: str) -> dict[str, Array]:
        """Return table columns with the controller's values, deg or mm, of joint values of the description."""
        shown = (_SHOWN[kind] for kind in self.kinds)
        values = self.of_controller(q).T
        return {f"{prefix}{a} [{u}]": k * v for a, (u, k), v in zip(self.axes, shown, values, strict=True)}


def sum_of(text: str) -> tuple[dict[str, float], float] | None:
    """Return the factors of a formula's inputs and its constant; None unless the formula is a sum of its inputs."""
    try:
        formula = Expression(text)
    except InputError:
        return None
    count = len(formula.inputs)
    far = 2.5 + np.arange(count) * np.sqrt(2.0)
    points = np.vstack([np.zeros(count), np.eye(count), far, -far])
    states = {name: points[:, k] for k, name in enumerate(formula.inputs)}
    values = np.asarray(formula(pd.DataFrame(states, index=range(len(points))).to_records()), dtype=np.float64)
    factors = values[1:-2] - values[0]
    left = values[0] + points[-2:] @ factors - values[-2:]
    if not (np.abs(left) <= _TRIED * (1.0 + np.abs(values).max())).all():
        return None
    return dict(zip(formula.inputs, factors.tolist(), strict=True)), float(values[0])


def convention_text(joints: Mapping[str, tuple[Mapping[str, float], float, str]]) -> str:
    """Write the convention of a map of joint columns, as one formula a joint in degrees and millimetres.

    joints: factors of the controller's axes, constant and unit, by joint. Return "" if a factor is no whole number, if
    an axis occurs with two units, or if no axis belongs to one joint alone.
    """
    units = dict[str, str]()
    lines = []
    for name, (factors, constant, unit) in joints.items():
        kind = next((kind for kind, si in JOINT_UNITS.items() if factor_like(unit, si)), None)
        if kind is None or any(units.setdefault(a, unit) != unit or k != round(k) for a, k in factors.items()):
            return ""
        zero = constant * (factor_like(unit, JOINT_UNITS[kind]) or 0.0) * _SHOWN[kind][1]
        lines.append(f"{name} = {_sum(factors, zero)}")
    text = "; ".join(lines)
    plain = len(text) <= LONGEST and not any(set(name) & set('=;"\\') for name in joints)
    return text if plain and _own_axes([factors for factors, *_ in joints.values()]) else ""


def _sum(factors: Mapping[str, float], zero: float) -> str:
    """Write a sum such as `90 - A2 + A3`."""
    terms = [(zero, f"{abs(zero):.12g}")] * bool(zero)
    terms += [(k, axis if abs(k) == 1.0 else f"{abs(k):.0f}*{axis}") for axis, k in factors.items() if k]
    text = " ".join(f"{'-' if k < 0 else '+'} {term}" for k, term in terms)
    return text.removeprefix("+ ") if not text.startswith("- ") else f"-{text[2:]}"


def _own_axes(sums: Sequence[Mapping[str, float]]) -> tuple[str, ...]:
    """Return the axis of each joint, which no joint found before contains; empty if there is none for some joint."""
    own = dict[int, str]()
    while len(own) < len(sums):
        left = {i: [a for a, k in row.items() if k and a not in own.values()] for i, row in enumerate(sums)}
        single = [(i, axes[0]) for i, axes in left.items() if i not in own and len(axes) == 1]
        if not single or abs(sums[single[0][0]][single[0][1]]) != 1.0:
            return ()
        own[single[0][0]] = single[0][1]
    axes = tuple(own[i] for i in range(len(sums)))
    return axes if {a for row in sums for a, k in row.items() if k} <= set(axes) else ()


def read_convention(text: str, mechanism: Mechanism, where: str) -> Convention:
    """Read the text of a convention, whose joints have the mechanism's names or are J1, J2, ...

    Raises InputError naming `where` for a missing joint, or a formula that is no sum of axes with whole factors.
    """
    formulas = _formulas(text)
    names = _names(formulas, mechanism)
    if missing := [name for name in names if name not in formulas]:
        raise InputError(f"{where}: no formula of joint '{missing[0]}'; {EXPECTED}")
    found = [sum_of(formulas[name]) for name in names]
    sums = [part[0] for part in found if part is not None]
    axes = _own_axes(sums) if len(sums) == len(found) else ()
    named = all(is_name(axis) and axis.isascii() for axis in axes)
    if not axes or not named or any(k != round(k) for row in sums for k in row.values()):
        raise InputError(f"{where}: {text[:80]!r}; {EXPECTED}")
    kinds = tuple(joint.kind for joint in mechanism.joints)
    turned = np.array([[row.get(axis, 0.0) for axis in axes] for row in sums])
    zero = np.array([part[1] for part in found if part]) / [_SHOWN[kind][1] for kind in kinds]
    return Convention(text, axes, turned, zero, kinds)


def _formulas(text: str) -> dict[str, str]:
    """Split the text of a convention into formulas by joint name; empty if the text is too long."""
    parts = dict(part.split("=", 1) for part in text.split(";") if "=" in part) if len(text) <= LONGEST else {}
    return {identifier(name.strip()): formula.strip() for name, formula in parts.items()}


def _names(formulas: Mapping[str, str], mechanism: Mechanism) -> tuple[str, ...]:
    """Return the joint names of a convention: the mechanism's, or J1, J2, ..."""
    own = tuple(joint.name for joint in mechanism.joints)
    numbered = tuple(f"J{i}" for i in range(1, len(own) + 1))
    return numbered if formulas.keys() >= set(numbered) and not formulas.keys() >= set(own) else own


def axes_note(convention: Convention | None) -> str:
    """State the convention of joint values that are those of the description, in one phrase."""
    said = "joint values have the signs and zeros of the description"
    if convention is None:
        return said
    if convention.unchanged:
        return f"{said}, which are those of the imported joint columns"
    return f"{said}, in terms of the imported joint columns, deg and mm: {convention.text}"


def pose_table(mechanism: Mechanism, q: Array, names: Sequence[str], convention: Convention | None) -> pd.DataFrame:
    """Write joint values q, rad or m, as a table of poses; also in the convention of the controller, if it is another.

    names: column names of the joints.
    """
    table = joint_table(mechanism, q, names)
    if convention is None or convention.unchanged:
        return table
    return table.assign(**convention.columns(q, PREFIX), **{COLUMN: [convention.text] * len(q)})


def convention_in(frame: pd.DataFrame) -> str:
    """Return the convention in a table's column `convention`, "" without one or if the rows differ."""
    if COLUMN not in frame:
        return ""
    said = {" ".join(str(cell).split()) for cell in frame[COLUMN].dropna()}
    return said.pop() if len(said) == 1 and frame[COLUMN].notna().all() and "=" in next(iter(said)) else ""


def with_joint_columns(frame: pd.DataFrame, path: Path, mechanism: Mechanism, text: str) -> pd.DataFrame:
    """Add joint columns of the description to a table that has the controller's values `controller_AXIS` alone.

    text: convention of the model, for a table without the column `convention`. Raises InputError if a column of an axis
    is missing. A table without a known convention is unchanged.
    """
    headers = {split_header(str(c))[0]: str(c) for c in frame.columns}
    joints = {identifier(name) for name in headers}
    text = convention_in(frame) or text
    given = [name for name in headers if name.startswith(PREFIX)]
    own = {joint.name for joint in mechanism.joints} | {f"J{i + 1}" for i in range(len(mechanism.joints))}
    if joints & own or not given or not text:
        return frame
    convention = read_convention(text, mechanism, f"{path.name}, {COLUMN}")
    values = []
    for axis, joint in zip(convention.axes, mechanism.joints, strict=True):
        header = headers.get(f"{PREFIX}{axis}", "")
        where, unit = f"{path.name}, column '{header}'", split_header(header)[1]
        if not header or unit is None:
            raise InputError(f"{path.name}: column '{PREFIX}{axis} [unit]' is missing; expected one for every axis")
        cells = numbers(frame[header], where)
        values.append(cells * factor(unit, "angle" if joint.kind == "revolute" else "length", where))
    q = convention.of_description(np.column_stack(values))
    names = _names(_formulas(text), mechanism)
    columns = {
        f"{name} [{JOINT_UNITS[joint.kind]}]": ["" if np.isnan(v) else repr(v) for v in column.tolist()]
        for name, joint, column in zip(names, mechanism.joints, q.T, strict=True)
    }
    return frame.assign(**columns)


def described_axes(names: Iterable[str], text: str) -> set[str]:
    """Return the names of a table's columns that hold the controller's values of a convention."""
    axes = set(re.findall(r"[^\W\d]\w*", text))
    return {name for name in names if name.startswith(PREFIX) and name.removeprefix(PREFIX) in axes}

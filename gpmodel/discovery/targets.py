"""Compute sufficient statistics of a residual at every site, and the inputs that a formula may use."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy import linalg

from gpmodel.arrays import Array, IntArray
from gpmodel.evidence.residual import Residual
from gpmodel.evolution.kinds import ANGLE, NUMBER, SHORT, SHORT_RANGE
from gpmodel.evolution.problems import Inputs
from gpmodel.evolution.projection import Targets
from gpmodel.families.candidate import loaded
from gpmodel.formula.expression import ONE
from gpmodel.model.memory import read_by
from gpmodel.model.sites import Site
from gpmodel.model.states import States
from gpmodel.table.units import is_time


def targets(residual: Residual, sites: Sequence[Site], rows: IntArray) -> Targets:
    """Compute the sufficient statistics of the residual at each site for some poses.

    A basis function φ at a site adds the column r φ; r: sensitivity of the rows. Statistics, summed over each pose's
    rows: r² (weight of φ²), r times the basis of the model's columns, and r times the residual. rows: pose numbers.
    """
    columns = _columns(residual, sites)
    weight = _by_pose(residual, columns**2, rows)
    enabled = residual.span.basis[: residual.measured]
    cross = np.stack([_compact(_by_pose(residual, columns[:, [s]] * enabled, rows)) for s in range(len(sites))])
    alive = weight.sum(axis=1) > 1e-12
    samples = int(len(residual.values) * len(rows) / len(residual.poses))
    blank = Targets(
        weight * alive[:, None], cross, np.zeros(weight.shape), 0.0, tuple(site.name for site in sites), samples,
        residual.criteria.scored_share**2,
    )  # fmt: skip
    return aimed(blank, residual, sites, rows, residual.values)


def aimed(blank: Targets, residual: Residual, sites: Sequence[Site], rows: IntArray, values: Array) -> Targets:
    """Return the statistics `blank` completed with the residual `values` at each site, for genetic programming."""
    pull = _by_pose(residual, _columns(residual, sites) * values[: residual.measured, None], rows)
    return replace(blank, pull=pull, energy=float(values @ values) * len(rows) / len(residual.poses))


def _columns(residual: Residual, sites: Sequence[Site]) -> Array:
    return residual.columns([site.effect("", ONE, "") for site in sites])


def _by_pose(residual: Residual, values: Array, rows: IntArray) -> Array:
    """Sum values over the rows of each of some poses; return one line per column of `values`. rows: pose numbers."""
    out = np.zeros((len(residual.poses), values.shape[1]))
    present, first = np.unique(residual.problem.pose_of_row, return_index=True)
    out[present] = np.add.reduceat(values, first, axis=0)
    return out[rows].T


def _compact(cross: Array) -> Array:
    """Compress products of the model's basis with the poses (`cross`) to fewer rows of equal inner products."""
    few = len(cross) <= cross.shape[1]
    return cross if few else linalg.qr(cross, mode="r", check_finite=False)[0][: cross.shape[1]]


KINDS = {"m": "length", "Nm": "torque", "N": "force", "degC": "temperature", "K": "temperature", "s": "time"}
"""Physical quantity of a table column by its unit. A unit that is not listed is a physical quantity by itself."""

ALIKE = 1e-4
"""Largest unexplained share of variance of two columns that count as proportional: a hundredth of the spread. The
weight of a wrist has as large a share in the load of a carriage."""


def readable_inputs(states: States, rows: IntArray) -> tuple[Inputs, Mapping[str, str]]:
    """Return the columns that a formula may use, scaled to order one, and the text of each in table columns.

    Not used are constant columns, negligible loads, joint reactions other than torques (torques and base moments span
    the reactions), and loads in proportion to a length or the payload, as on linear axes. Of several proportional
    lengths only the first is used: the travel of a joint rather than the height of the tool. The row number is excluded
    if a clock rises with it, since another table has other rows.
    """
    names, values, written = [], [], {}
    clocks = [column for name, column in states.columns.items() if is_time(states.units[name])]
    lengths = [name for name in states.columns if states.units[name] == "m"]
    masses = [name for name in states.columns if states.units[name] == "kg"]
    torques = {f"torque_{name}" for name in states.columns}
    reactions = states.loads - torques - {"moment_base_x", "moment_base_y"}
    for name, column in states.columns.items():
        spread, largest = float(np.ptp(column)), float(np.max(np.abs(column)))
        if name in reactions or not loaded(states, name) or spread < 1e-9 * max(largest, 1.0):
            continue
        if name == "row" and any(_in_step(column, clock) for clock in clocks):
            continue
        unit = states.units[name]
        plainer = [length for length in lengths if length in names] if unit == "m" else [*lengths, *masses]
        if unit in ("Nm", "N", "m") and any(in_proportion(column, states[other]) for other in plainer):
            continue
        if unit in ("rad", "m"):
            offset, scale = 0.0, 1.0
        elif unit in ("Nm", "N"):
            offset, scale = 0.0, float(f"{largest:.3g}")
        else:
            mean, deviation = float(column.mean()), max(float(column.std()), 1e-12)
            digits = 4 + max(0, int(np.log10(max(abs(mean) / deviation, 1.0))) - 1)
            offset, scale = float(f"{mean:.{digits}g}"), float(f"{deviation:.3g}")
        names.append(name)
        values.append((column[rows] - offset) / scale)
        shifted = f"({name} - {offset!r})" if offset else name
        written[name] = shifted if scale == 1.0 else f"({shifted}/{scale!r})"
    kinds = tuple(kind_of(name, states) for name in names)
    return Inputs(tuple(names), np.array(values), kinds), written


def _in_step(row: Array, clock: Array) -> bool:
    """Return whether the values of a clock never fall along the rows, and rise at least once."""
    along = clock[np.argsort(row, kind="stable")]
    return bool(np.all(np.diff(along) >= 0) and along[0] < along[-1])


def in_proportion(first: Array, second: Array) -> bool:
    """Return whether two columns are equal up to offset, scale, and a share ``ALIKE`` of their variance."""
    first, second = (column - column.mean() for column in (first, second))
    return bool((first @ second) ** 2 > (1.0 - ALIKE) * (first @ first) * (second @ second) > 0)


def kind_of(name: str, states: States) -> str:
    """Return the physical quantity of a column. A column of earlier values of an angle counts as a travel, without a
    period."""
    unit = states.units[name]
    if name == "row":
        return "row"
    if unit == "rad":
        short = float(np.ptp(states[name])) < SHORT_RANGE
        return "travel" if read_by(name) else SHORT if short else ANGLE
    return NUMBER if unit == "1" else KINDS.get(unit, unit)

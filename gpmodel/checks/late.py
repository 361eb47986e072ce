"""Find positions that were measured before or after the joint values of their rows, on a moving robot."""

from dataclasses import replace

import numpy as np

from gpmodel.arrays import Array
from gpmodel.calibration.linearise import Linearised
from gpmodel.calibration.result import Calibration, problem_at
from gpmodel.checks.mixed_up import MOST_IN_ORDER
from gpmodel.checks.warnings import JUMP_ROWS
from gpmodel.checks.weak_columns import FAR_LESS, PASSES, fitted
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.branches import branched
from gpmodel.mechanism.protocol import Mechanism, closed
from gpmodel.model.effect import Effect, drive_effect
from gpmodel.model.error_model import prepare
from gpmodel.model.memory import clock_of
from gpmodel.numerics import rank
from gpmodel.table.dataset import Dataset

SMOOTH = 0.5
"""Largest mean square step of the joints, relative to that of unordered rows, for a path: the rates are known."""


def measured_late(mechanism: Mechanism, data: Dataset, standard: tuple[Effect, ...]) -> str | None:
    """State by how much the positions are later than the joint values of their rows; None if they are not.

    Model: p_i = f(q(t_i + τ)), with q(t + τ) = q + τ dq/dt and central differences dq/dt over the times or the ordered
    rows. The delay τ and the standard model are fitted in turn. The delay is named if it divides the standard deviation
    of the residual by three.
    """
    data = data.subset(np.arange(min(len(data), MOST_IN_ORDER)))
    rate = path_rates(mechanism, data)
    if rate is None:
        return None
    late, fit = 0.0, fitted(mechanism, data, standard)
    now = fit
    for _ in range(PASSES):
        late += _delay(now, _shifted(data, late * rate), rate)
        now = fitted(mechanism, _shifted(data, late * rate), standard)
    return delayed(late, data, now.sigma, fit.sigma)


def delayed(late: float, data: Dataset, now: float, before: float) -> str | None:
    """State a delay of the positions that divides the residual by three; None otherwise. now, before: residuals, m."""
    if FAR_LESS * now > before:
        return None
    size = f"{abs(late):.3g} {data.extra_units.get(clock_of(data) or 'row', 'rows')}"
    return (
        f"x, y and z are measured {size} {'after' if late > 0 else 'before'} the joint values of a moving robot: the "
        f"residual of the model is then {1e3 * now:.3g} mm instead of {1e3 * before:.3g} mm; expected poses at rest, "
        "or joint values at the times of the positions"
    )


def path_rates(mechanism: Mechanism, data: Dataset) -> Array | None:
    """Return the rates of the joints at each row, rad or m per unit of time (or per row); None if rows are no path.

    Rows are a path if the times rise and steps of the joints are small.
    """
    clock, known = clock_of(data), np.isfinite(data.position).all() and all(j.measured for j in mechanism.joints)
    if clock is None or not known or branched(mechanism) or closed(mechanism) or len(data) < JUMP_ROWS:
        return None
    time = data.row.astype(float) if clock == "row" else data.extras[clock]
    spread = 2.0 * np.var(data.q, axis=0).sum()
    short = np.mean(np.sum(np.diff(data.q, axis=0) ** 2, axis=1)) < SMOOTH * spread
    return np.gradient(data.q, time, axis=0) if short and np.all(np.diff(time) > 0) else None


def _shifted(data: Dataset, by: Array) -> Dataset:
    return replace(data, q=data.q + by)


def _delay(fit: Calibration, data: Dataset, rate: Array) -> float:
    """Return the delay of the positions that a linear fit adds to a fitted standard model."""
    sound = np.delete(np.arange(len(data)), fit.outliers)
    problem = problem_at(fit, prepare(fit.model.mechanism, data.subset(sound)))
    column = moved_by_rates(problem.effect_rows(zeros(fit.model.mechanism), fit.model), problem, rate[sound])
    own = rank.remove(rank.orthonormal(problem.columns), column)
    return float(own @ problem.residual / (own @ own))


def zeros(mechanism: Mechanism) -> list[Effect]:
    """Return the error of the value of each joint as an effect."""
    return [drive_effect(joint.name, joint, Expression("1")) for joint in mechanism.joints]


def moved_by_rates(rows: Array, problem: Linearised, rate: Array) -> Array:
    """Return the derivative of the weighted measurements with respect to a delay. rows: derivatives to joint values."""
    return np.asarray(np.sum(rows * rate[problem.pose_of_row], axis=1))

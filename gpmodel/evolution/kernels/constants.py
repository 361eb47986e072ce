"""Constants of a program of one output by least squares, seen from one place: ``gpmodel.evolution.constants``."""

import numpy as np

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.evolution.kernels.compiler import compiled, reduction
from gpmodel.evolution.kernels.differentiation import carry_tangents

_ROUNDING = 1e-13
TRIALS = 4
"""Dampings tried a step, each ten times the one before."""


@compiled
def solve(normal: Array, sizes: Array, count: int) -> bool:
    """Gauss-Jordan of symmetric normal equations, the right side in the column ``count``; False where singular.

    sizes: room for the diagonal before anything was eliminated.
    """
    for k in range(count):
        sizes[k] = normal[k, k]
    for k in range(count):
        pivot = normal[k, k]
        if not pivot > _ROUNDING * sizes[k]:
            return False
        for i in range(count):
            if i != k:
                factor = normal[i, k] / pivot
                for j in range(k, count + 1):
                    normal[i, j] -= factor * normal[k, j]
    for k in range(count):
        normal[k, count] /= normal[k, k]
    return True


@reduction
def _product(one: Array, other: Array) -> float:
    total = 0.0
    for j in range(len(one)):
        total += one[j] * other[j]
    return total


@compiled
def _limited(row: Array, limit: float) -> bool:
    """Return whether all values of a row are numbers below a limit."""
    within = 0
    for j in range(len(row)):
        within += abs(row[j]) < limit
    return within == len(row)


@compiled
def explained(
    row: Array, weight: Array, cross: Array, begins: IntArray, pull: Array, energy: float, unique_share: float,
    smallest: float,
) -> tuple[float, float]:  # fmt: skip
    """Gain of one basis (N,) and its coefficient, as ``Targets.set_gain`` has them of one."""
    if not _limited(row, np.inf) or energy <= 0.0:
        return 0.0, 0.0
    largest = np.abs(row).max()
    if largest <= smallest:
        return 0.0, 0.0
    scaled = row / largest
    total = _product(weight, scaled * scaled)
    unique = total
    for k in range(len(cross)):
        unique -= _product(cross[k, begins[k] :], scaled[begins[k] :]) ** 2
    if not unique > unique_share * total:
        return 0.0, 0.0
    pulled = _product(pull, scaled)
    return pulled * pulled / unique / energy, pulled / unique / largest


@compiled
def _normal_equations(
    columns: Array,
    coefficient: float,
    weight: Array,
    cross: Array,
    begins: IntArray,
    pull: Array,
    idle: float,
    normal: Array,
) -> bool:
    """Fill those (m, m + 1) of one Gauss-Newton step, the first of the columns (m, N) being the basis, the right side
    the last; whether they are usable."""
    size = len(columns)
    seen, stays = np.empty((size, len(cross))), np.zeros(size, np.bool_)
    for k in range(len(cross)):
        for i in range(size):
            seen[i, k] = _product(cross[k, begins[k] :], columns[i, begins[k] :])
    for i in range(size):
        weighted = columns[i] * weight
        for j in range(i):
            normal[i, j] = normal[j, i] = _product(weighted, columns[j]) - _product(seen[i], seen[j])
        total = _product(weighted, columns[i])
        normal[i, i] = total - _product(seen[i], seen[i])
        normal[i, size] = _product(pull, columns[i]) - coefficient * normal[i, 0]
        if not (_limited(normal[i, : i + 1], np.inf) and abs(normal[i, size]) < np.inf):
            return False
        stays[i] = normal[i, i] <= idle * total
    for i in np.flatnonzero(stays):
        normal[i], normal[:, i] = 0.0, 0.0
        normal[i, i] = 1.0
    return True


@compiled
def _distinct(constants: Array) -> bool:
    """Return whether constants are numbers and all different: equal ones would be one node."""
    for i in range(len(constants)):
        if not abs(constants[i]) < np.inf:
            return False
        for j in range(i):
            if constants[i] == constants[j]:
                return False
    return True


@compiled
def fit_constants(
    nodes: IntArray,
    inputs: Array,
    constants: Array,
    free: Mask,
    weight: Array,
    cross: Array,
    begins: IntArray,
    pull: Array,
    energy: float,
    unique_share: float,
    limits: tuple[float, float, float],
    steps: int,
) -> float:
    """Move the free ones of the constants (C,) to where the last node of a program explains most; its gain there.

    nodes: as ``carry_tangents`` has them. weight, pull (N,), cross (K, N): of one place. begins (K,): the first number
    of each row of cross that is not zero. limits: what a basis has to exceed, what a column may not, and the share of
    it that has to lie outside the enabled columns.
    """
    poses, size = inputs.shape[1], nodes.shape[1]
    smallest, largest, idle = limits
    moving = np.flatnonzero(free)
    values, tangents = np.empty((size, poses)), np.zeros((len(constants), size, poses))
    carry_tangents(nodes, inputs, constants, values, tangents)
    gain, coefficient = explained(values[-1], weight, cross, begins, pull, energy, unique_share, smallest)
    columns = np.empty((len(moving) + 1, poses))
    normal, sizes = np.empty((len(columns), len(columns) + 1)), np.empty(len(columns))
    damping = 1e-3
    for _ in range(steps if coefficient != 0.0 else 0):
        columns[0] = values[-1]
        for c in range(len(moving)):
            columns[c + 1] = coefficient * tangents[moving[c], -1]
        for column in columns:
            if not _limited(column, largest):
                return gain
        if not _normal_equations(columns, coefficient, weight, cross, begins, pull, idle, normal):
            return gain
        before = gain
        for _ in range(TRIALS):
            damped, trial = normal.copy(), constants.copy()
            for i in range(len(damped)):
                damped[i, i] *= 1.0 + damping
            if solve(damped, sizes, len(damped)):
                trial[moving] += damped[1:, -1]
                if _distinct(trial):
                    carry_tangents(nodes, inputs, trial, values, tangents)
                    found, scale = explained(values[-1], weight, cross, begins, pull, energy, unique_share, smallest)
                    if found > gain:
                        constants[:] = trial
                        gain, coefficient = found, scale
                        break
            damping *= 10.0
        if gain == before or gain - before < 1e-9 * (1.0 - before):
            break
        damping = max(damping * 0.1, 1e-12)
    return gain

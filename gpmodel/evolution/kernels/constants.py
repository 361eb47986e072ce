"""Least-squares fit of the constants of a program of one output at one site, for ``gpmodel.evolution.constants``."""

import numpy as np

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.evolution.code import SiteStatistics
from gpmodel.evolution.kernels.compiler import compiled, largest_magnitude, reduction
from gpmodel.evolution.kernels.differentiation import carry_tangents

_ROUNDING = 1e-13
TRIALS = 4
"""Number of Levenberg-Marquardt dampings that are tried in a step, each ten times the previous one."""


@compiled
def solve(normal: Array, sizes: Array, count: int) -> bool:
    """Solve symmetric normal equations in place by Gauss-Jordan elimination; return False for singular equations. The
    right side is column ``count`` of ``normal``. sizes: scratch space for the original diagonal."""
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
def _product(one: Array, other: Array, begin: int) -> float:
    total = 0.0
    for j in range(begin, len(one)):
        total += one[j] * other[j]
    return total


@reduction
def _weighted(weight: Array, one: Array, other: Array) -> float:
    total = 0.0
    for j in range(len(weight)):
        total += weight[j] * one[j] * other[j]
    return total


@compiled
def _limited(row: Array, count: int, limit: float) -> bool:
    """Return whether the first ``count`` values of a row are finite and smaller than a limit."""
    within = 0
    for j in range(count):
        within += abs(row[j]) < limit
    return within == count


@compiled
def explained(row: Array, site: SiteStatistics, smallest: float) -> tuple[float, float]:
    """Return gain and coefficient of one basis function (poses,), as ``Targets.set_gain`` does."""
    if not _limited(row, len(row), np.inf) or site.energy <= 0.0:
        return 0.0, 0.0
    largest = largest_magnitude(row)
    if largest <= smallest:
        return 0.0, 0.0
    scaled = np.empty(len(row))
    for j in range(len(row)):
        scaled[j] = row[j] / largest
    total = _weighted(site.weight, scaled, scaled)
    unique = total
    for k in range(len(site.cross)):
        unique -= _product(site.cross[k], scaled, site.begins[k]) ** 2
    if not unique > site.unique_share * total:
        return 0.0, 0.0
    pulled = _product(site.pull, scaled, 0)
    return pulled * pulled / unique / site.energy, pulled / unique / largest


@compiled
def _normal_equations(columns: Array, coefficient: float, site: SiteStatistics, idle: float, normal: Array) -> bool:
    """Fill the normal equations of one Gauss-Newton step; return whether the equations are usable. columns: the basis
    function, then its derivatives with respect to the constants, (columns, poses). The last column of `normal` is the
    equations' right side."""
    size = len(columns)
    seen, stays = np.empty((size, len(site.cross))), np.zeros(size, np.bool_)
    for i in range(size):
        for k in range(len(site.cross)):
            seen[i, k] = _product(site.cross[k], columns[i], site.begins[k])
    for i in range(size):
        for j in range(i):
            normal[i, j] = _weighted(site.weight, columns[i], columns[j]) - _product(seen[i], seen[j], 0)
            normal[j, i] = normal[i, j]
        total = _weighted(site.weight, columns[i], columns[i])
        normal[i, i] = total - _product(seen[i], seen[i], 0)
        normal[i, size] = _product(site.pull, columns[i], 0) - coefficient * normal[i, 0]
        if not (_limited(normal[i], i + 1, np.inf) and abs(normal[i, size]) < np.inf):
            return False
        stays[i] = normal[i, i] <= idle * total
    for i in range(size):
        if stays[i]:
            for j in range(size):
                normal[i, j] = normal[j, i] = 0.0
            normal[i, i], normal[i, size] = 1.0, 0.0
    return True


@compiled
def _moved(constants: Array, free: Mask, solved: Array, trial: Array) -> bool:
    """Fill ``trial`` with the constants, of which the free ones are moved by the solution; return whether `trial` is
    usable. Constants have to be finite and different, since equal constants would be one node. Element 0 of the
    solution is unused."""
    k, last = 0, solved.shape[1] - 1
    for i in range(len(constants)):
        k += free[i]
        trial[i] = constants[i] + (solved[k, last] if free[i] else 0.0)
        if not abs(trial[i]) < np.inf:
            return False
        for j in range(i):
            if trial[i] == trial[j]:
                return False
    return True


@compiled
def fit_constants(
    nodes: IntArray,
    inputs: Array,
    constants: Array,
    free: Mask,
    site: SiteStatistics,
    limits: tuple[float, float, float],
    steps: int,
) -> float:
    """Fit the free constants of a program in place; return the share of residual squares that its last node removes.

    nodes: nodes of the program, as in ``carry_tangents``.
    limits: least magnitude of a basis function, largest magnitude of a column, and least share of a column outside the
    columns of the model.
    """
    poses, last = inputs.shape[1], nodes.shape[1] - 1
    smallest, largest, idle = limits
    values, tangents = np.empty((last + 1, poses)), np.zeros((len(constants), last + 1, poses))
    carry_tangents(nodes, inputs, constants, values, tangents)
    gain, coefficient = explained(values[last], site, smallest)
    count = 1 + int(np.sum(free))
    columns, trial = np.empty((count, poses)), np.empty(len(constants))
    normal, damped, sizes = np.empty((count, count + 1)), np.empty((count, count + 1)), np.empty(count)
    damping = 1e-3
    for _ in range(steps if coefficient != 0.0 else 0):
        for j in range(poses):
            columns[0, j] = values[last, j]
        k = 0
        for c in range(len(constants)):
            if free[c]:
                k += 1
                for j in range(poses):
                    columns[k, j] = coefficient * tangents[c, last, j]
        for k in range(count):
            if not _limited(columns[k], poses, largest):
                return gain
        if not _normal_equations(columns, coefficient, site, idle, normal):
            return gain
        before = gain
        for _ in range(TRIALS):
            for i in range(count):
                for j in range(count + 1):
                    damped[i, j] = normal[i, j]
                damped[i, i] *= 1.0 + damping
            if solve(damped, sizes, count) and _moved(constants, free, damped, trial):
                carry_tangents(nodes, inputs, trial, values, tangents)
                found, scale = explained(values[last], site, smallest)
                if found > gain:
                    for c in range(len(constants)):
                        constants[c] = trial[c]
                    gain, coefficient = found, scale
                    break
            damping *= 10.0
        if gain == before or gain - before < 1e-9 * (1.0 - before):
            break
        damping = max(damping * 0.1, 1e-12)
    return gain

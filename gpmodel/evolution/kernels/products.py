"""What products of powers, solved as sums of logarithms, leave of a response itself, and how many powers are simple."""

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.evolution.kernels.compiler import compiled
from gpmodel.evolution.kernels.quotients import multiply, solve

_ROUNDING = 1e-9
_SMALLEST = 1e-300


@compiled
def share_left_by_products(
    terms: Array,
    chosen: IntArray,
    always: Array,
    response: Array,
    passes: int,
    worth: float,
    largest: float,
    left: Array,
    written: IntArray,
) -> None:
    """Share (P,) of the variance of a response (N,), nowhere 0, left by exp of solved sums, its sign given.

    terms (P, k, N), of which the bits of ``chosen`` are in a program's sum, and always (a, N), which are in every one:

        log |y| = sum c_i terms_i,  errors weighted by y²

    by least squares, then again at the fit m found before, by Fisher scoring: working response log m + (|y| - m) / m,
    errors weighted by m² (McCullagh and Nelder 1989), ``passes`` times in all; the least share of all passes counts.
    Coefficients, but the first of ``always``, are then held at multiples of a half up to ``largest``, each where that
    costs less than ``worth`` nats; written (P, 2): how many are not, and how many of ``always`` but the first stay.
    Infinite where nothing can be solved; programs without a term keep theirs.
    """
    programs, offered, points = terms.shape
    first = len(always)
    columns = np.empty((first + offered + 1, points))
    normal = np.empty((first + offered, first + offered + 1))
    inverse = np.empty((first + offered, first + offered))
    sizes, weight, linked = np.empty(first + offered), np.empty(points), np.empty(points)
    variance = np.sum((response - response.mean()) ** 2)
    for p in range(programs):
        if chosen[p] == 0:
            continue
        count = first
        columns[:first] = always
        for i in range(offered):
            if (chosen[p] >> i) & 1:
                columns[count] = terms[p, i]
                count += 1
        for j in range(points):
            size = abs(response[j])
            weight[j] = size * size
            columns[count, j] = np.log(size)
        left[p] = np.inf
        total = np.inf
        for _ in range(passes):
            multiply(columns, weight, count, normal)
            if not solve(normal, sizes, count):
                break
            total = _refit(columns, normal[:, count], count, response, weight, linked)
            if not total < np.inf:
                break
            left[p] = min(left[p], total / variance)
        if total < np.inf:
            multiply(columns, weight, count, normal)
            free, found, more = _hold_simple(normal, inverse, count, total, points, worth, largest)
            left[p] += more / variance
            written[p, 0] = free
            written[p, 1] = np.sum(np.abs(found[1:first]) > _ROUNDING)


@compiled
def _refit(columns: Array, coefficients: Array, count: int, response: Array, weight: Array, linked: Array) -> float:
    """Sum of squares that a fit of the logarithm leaves; the working response and weights at it, in place."""
    linked[:] = 0.0
    for a in range(count):
        coefficient = coefficients[a]
        for j in range(len(linked)):
            linked[j] += coefficient * columns[a, j]
    total = 0.0
    for j in range(len(linked)):
        fit = np.exp(linked[j])
        rest = abs(response[j]) - fit
        total += rest * rest
        weight[j] = fit * fit
        columns[count, j] = linked[j] + rest / fit if fit > 0.0 else 0.0
    return total


@compiled
def _hold_simple(
    normal: Array, inverse: Array, count: int, total: float, points: int, worth: float, largest: float
) -> tuple[int, Array, float]:
    """The cheapest of all coefficients but the first held at its simple one, again and again.

    normal (n, n + 1): the normal equations, whose solution leaves the sum of squares ``total``. With C their inverse,
    holding c at s adds (s - c)² / C_cc to it. How many stay free, all coefficients, and what was added.
    """
    found = np.zeros(count)
    if not _invert(normal, inverse, count):
        return count - 1, found, 0.0
    for a in range(count):
        for b in range(count):
            found[a] += inverse[a, b] * normal[b, count]
    free, more = count - 1, 0.0
    while free:
        best, least = 0, np.inf
        for a in range(1, count):
            if inverse[a, a] > 0.0:
                added = (_simple(found[a], largest) - found[a]) ** 2 / inverse[a, a]
                if added < least:
                    best, least = a, added
        if not 0.5 * points * np.log1p(least / max(total + more, _SMALLEST)) < worth:
            break
        more += least
        step = (_simple(found[best], largest) - found[best]) / inverse[best, best]
        for a in range(count):
            found[a] += inverse[a, best] * step
        for a in range(count):
            if a != best:
                factor = inverse[a, best] / inverse[best, best]
                for b in range(count):
                    inverse[a, b] -= factor * inverse[best, b]
        inverse[best, :] = 0.0
        inverse[:, best] = 0.0
        free -= 1
    return free, found, more


@compiled
def _simple(coefficient: float, largest: float) -> float:
    """The nearest multiple of a half; 0 for those too large to be written as products."""
    return 0.5 * np.round(2.0 * coefficient) if abs(coefficient) <= largest else 0.0


@compiled
def _invert(normal: Array, inverse: Array, count: int) -> bool:
    """Gauss-Jordan inverse of the symmetric part of normal equations; False where they are singular."""
    for a in range(count):
        for b in range(count):
            inverse[a, b] = normal[a, b]
    for k in range(count):
        pivot = inverse[k, k]
        if not pivot > 1e-13 * normal[k, k]:
            return False
        inverse[k, k] = 1.0
        for b in range(count):
            inverse[k, b] /= pivot
        for a in range(count):
            if a != k:
                factor = inverse[a, k]
                inverse[a, k] = 0.0
                for b in range(count):
                    inverse[a, b] -= factor * inverse[k, b]
    return True

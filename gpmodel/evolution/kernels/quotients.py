"""What quotients of solved sums leave of a response: their own errors, not those times the denominator."""

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.evolution.kernels.compiler import compiled, reduction

_ROUNDING = 1e-13


@compiled
def share_left_by_quotients(values: Array, chosen: IntArray, response: Array, passes: int, left: Array) -> None:
    """Share (P,) of the variance of a response (N,) left by quotients; programs without a denominator keep theirs.

    values (P, m, N): outputs phi of each program; bit i of ``chosen`` puts phi_i above the bar, bit i + m below it:

        y (1 - sum b_i (phi_i - mean phi_i)) = c_0 + sum c_i phi_i

    by least squares, then again with each point's error divided by the denominator found before (Sanathanan and
    Koerner 1963), ``passes`` times in all; the least share of all passes counts. Infinite where nothing can be solved.
    """
    programs, outputs, points = values.shape
    plain, columns = np.empty((2, 2 * outputs + 2, points))
    normal = np.empty((2 * outputs + 1, 2 * outputs + 2))
    sizes, weight, rest = np.empty(2 * outputs + 1), np.empty(points), np.empty(points)
    variance = np.sum((response - response.mean()) ** 2)
    for p in range(programs):
        if chosen[p] >> outputs == 0:
            continue
        above, count = _offer(values[p], chosen[p], response, plain, columns)
        weight[:] = 1.0
        left[p] = np.inf
        for _ in range(passes):
            multiply(columns, weight, count, normal)
            if not solve(normal, sizes, count):
                break
            for j in range(points):
                rest[j] = 0.0
                weight[j] = 1.0
            for a in range(count):
                coefficient = normal[a, count]
                for j in range(points):
                    if a < above:
                        rest[j] += coefficient * plain[a, j]
                    else:
                        weight[j] -= coefficient * plain[a, j]
            total = 0.0
            for j in range(points):
                rest[j] = response[j] - rest[j] / weight[j]
                weight[j] = 1.0 / (weight[j] * weight[j])
                total += rest[j] * rest[j]
            if not total < np.inf:
                break
            left[p] = min(left[p], total / variance)


@compiled
def _offer(values: Array, chosen: int, response: Array, plain: Array, columns: Array) -> tuple[int, int]:
    """Rows of 1, of what is chosen above and below the bar, and the response; how many stand above, and before it.

    Those below are centred in ``plain``, and times the response in ``columns``.
    """
    outputs, points = values.shape
    count = 1
    above = 1
    for j in range(points):
        plain[0, j] = 1.0
        columns[0, j] = 1.0
    for i in range(2 * outputs):
        if (chosen >> i) & 1:
            row = values[i % outputs]
            centre = row.mean() if i >= outputs else 0.0
            for j in range(points):
                plain[count, j] = row[j] - centre
                columns[count, j] = plain[count, j] * (response[j] if i >= outputs else 1.0)
            above += i < outputs
            count += 1
    for j in range(points):
        columns[count, j] = response[j]
    return above, count


@reduction
def multiply(columns: Array, weight: Array, count: int, normal: Array) -> None:
    """Weighted products of every two of ``count`` rows, and of each with the one after them."""
    for a in range(count):
        for b in range(a, count + 1):
            total = 0.0
            for j in range(len(weight)):
                total += weight[j] * columns[a, j] * columns[b, j]
            normal[a, b] = total
            if b < count:
                normal[b, a] = total


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

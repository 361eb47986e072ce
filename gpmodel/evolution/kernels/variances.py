"""Prior variances of groups with the largest marginal likelihood, one group after the other."""

import math

from gpmodel.arrays import Array
from gpmodel.evolution.kernels.compiler import compiled, inlined

_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
_LARGE = 1e100
"""Magnitude of a product of many factors above which its logarithm is taken: one logarithm serves several factors."""


@inlined
def _gain(log_variance: float, s: Array, q: Array) -> float:
    variance = math.exp(log_variance)
    fit, volume, beyond = 0.0, 0.0, 0.0  # beyond: product of (1 + load) minus 1, exact if small
    for i in range(len(s)):
        load = variance * s[i]
        fit += variance * q[i] * q[i] / (1.0 + load)
        beyond += load + beyond * load
        if beyond > _LARGE:
            volume += math.log1p(beyond)
            beyond = 0.0
    return 0.5 * (fit - volume - math.log1p(beyond))


@compiled
def largest_gains(
    s: Array, q: Array, top: Array, step: float, places: int, refinements: int, gains: Array, where: Array
) -> None:
    """Fill ``gains`` with the largest gain in log evidence, nats, of each group and ``where`` with its prior variance.
    Log variances up to ``top`` are tried at ``places`` points a ``step`` apart, then refined by a golden section."""
    for g in range(len(s)):
        own_s, own_q = s[g], q[g]
        at, most = 0, _gain(top[g] - step * (places - 1), own_s, own_q)
        for k in range(1, places):
            value = _gain(top[g] - step * (places - 1 - k), own_s, own_q)
            if value > most:
                at, most = k, value
        middle = top[g] - step * (places - 1 - at)
        low, high = middle - step, min(middle + step, top[g])
        left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        at_left, at_right = _gain(left, own_s, own_q), _gain(right, own_s, own_q)
        for _ in range(refinements):
            if at_left > at_right:
                high, right, at_right = right, left, at_left
                left = high - _GOLDEN * (high - low)
                at_left = _gain(left, own_s, own_q)
            else:
                low, left, at_left = left, right, at_right
                right = low + _GOLDEN * (high - low)
                at_right = _gain(right, own_s, own_q)
        gains[g] = max(at_left, at_right)
        where[g] = math.exp(left if at_left > at_right else right)

"""Elementary functions without branches, so that the compiler vectorises loops over poses.

Polynomials are near minimax (interpolated at Chebyshev points, 40 digits), with an error below a tenth of the rounding
error. Sine, cosine and tangent reduce the angle by multiples of pi in two parts, the first short enough for an exact
product. The elementary functions are accurate to a few ulp of 1 up to ``ANGLE_LIMIT``; beyond, callers use the
functions of ``math``.
"""

import math

import numpy as np

from gpmodel.evolution.kernels.compiler import of_a_number

ANGLE_LIMIT = 1e5

_NEAREST = 6755399441055744.0
"""The number 1.5 * 2^52; its addition to x rounds x to an integer, in the lowest bits of the sum."""

_INVERSE_PI = 1.0 / math.pi
_PI_HIGH = 3.1415926534682512
_PI_LOW = 1.2154201013012384e-10
_S = (-0.16666666666666666, 0.008333333333333316, -0.00019841269841254966, 2.7557319219160833e-06,
      -2.505210761669045e-08, 1.6058977292642743e-10, -7.643969663988074e-13, 2.7314368769379893e-15)  # fmt: skip
_P = (-1.79565251976484877988e7, 1.15351664838587416140e6, -1.30936939181383734205e4)
_Q = (-5.38695755929454629881e7, 2.50083801823357915839e7, -1.32089234440210967447e6, 1.36812963470692954678e4)

_TAN_PI_8, _TAN_3PI_8 = math.sqrt(2.0) - 1.0, math.sqrt(2.0) + 1.0
_A = (-0.3333333333333325, 0.19999999999898324, -0.1428571426608229, 0.11111109635603796, -0.09090852527088297,
      0.07691054614825647, -0.06649607953399717, 0.057362969593526145, -0.04483218628995374,
      0.022748939747779046)  # fmt: skip

_LOG2_E = 1.0 / math.log(2.0)
_LN2_HIGH = 0.6931471803691238
_LN2_LOW = 1.9082149292705877e-10
_E = tuple(1.0 / math.factorial(k) for k in range(14))
_L = (0.666666666666667, 0.39999999999899444, 0.2857142862600327, 0.22222211130259878, 0.18182889455674947,
      0.15331710618210773, 0.14616585424888623)  # fmt: skip
_SQRT_HALF_BITS = 0x3FE6A09E667F3BCD
_NORMAL = 2.0**-1022

_T = (-9.64399179425052238628e-1, -9.92877231001918586564e1, -1.61468768441708447952e3)
_U = (1.12811678491632931402e2, 2.23548839060100448583e3, 4.84406305325125486048e3)


@of_a_number
def _bits(x: float) -> int:
    return np.float64(x).view(np.int64)


@of_a_number
def _number(bits: int) -> float:
    return np.int64(bits).view(np.float64)


@of_a_number
def _polynomial(coefficients: tuple[float, ...], x: float) -> float:
    """Return Σ c_k x^k with coefficients c_k, by Horner's rule."""
    value = coefficients[len(coefficients) - 1]
    for k in range(len(coefficients) - 2, -1, -1):
        value = value * x + coefficients[k]
    return value


@of_a_number
def _sine_of_reduced(r: float, turns: int) -> float:
    """Return sin(r) for abs(r) up to pi / 2, with the opposite sign if ``turns`` is odd."""
    s = r * r
    p = _polynomial(_S, s)
    return _number(_bits(r + r * (s * p)) ^ (turns << 63))


@of_a_number
def sine(x: float) -> float:
    """Return sin(x) for abs(x) up to ANGLE_LIMIT."""
    t = x * _INVERSE_PI + _NEAREST
    k = t - _NEAREST
    return _sine_of_reduced((x - k * _PI_HIGH) - k * _PI_LOW, _bits(t))


@of_a_number
def cosine(x: float) -> float:
    """Return cos(x) for abs(x) up to ANGLE_LIMIT, as a sine from the nearest odd multiple of pi / 2."""
    t = (x * _INVERSE_PI - 0.5) + _NEAREST
    k = (t - _NEAREST) + 0.5
    return _sine_of_reduced((x - k * _PI_HIGH) - k * _PI_LOW, ~_bits(t))


@of_a_number
def tangent(x: float) -> float:
    """Return tan(x) for abs(x) up to ANGLE_LIMIT, by a rational function, inverted if the multiple of pi / 2 is odd.
    Source: the library Cephes by Moshier."""
    t = x * (2.0 * _INVERSE_PI) + _NEAREST
    k = t - _NEAREST
    r = (x - k * (0.5 * _PI_HIGH)) - k * (0.5 * _PI_LOW)
    z = r * r
    p = (_P[2] * z + _P[1]) * z + _P[0]
    q = (((z + _Q[3]) * z + _Q[2]) * z + _Q[1]) * z + _Q[0]
    top = r * q + r * (z * p)
    odd = (_bits(t) & 1) == 1
    return (-q if odd else top) / (top if odd else q)


@of_a_number
def arctangent(x: float) -> float:
    """Return atan(x). An argument t is reduced to at most tan(pi / 8) by atan(t) = pi/4 + atan((t - 1)/(t + 1)) = pi/2
    - atan(1/t)."""
    t = abs(x)
    big = t > _TAN_3PI_8
    middle = (t > _TAN_PI_8) & (not big)
    top = -1.0 if big else (t - 1.0 if middle else t)
    bottom = t if big else (t + 1.0 if middle else 1.0)
    start = 0.5 * math.pi if big else (0.25 * math.pi if middle else 0.0)
    r = top / bottom
    z = r * r
    p = _polynomial(_A, z)
    return math.copysign(start + (r * (z * p) + r), x)


@of_a_number
def exponential(x: float) -> float:
    """Return exp(x) as 2^n, in two factors, times a polynomial of x - n ln 2."""
    t = -750.0 if x < -750.0 else (710.0 if x > 710.0 else x)
    w = t * _LOG2_E + _NEAREST
    n = w - _NEAREST
    r = (t - n * _LN2_HIGH) - n * _LN2_LOW
    p = _polynomial(_E, r)
    whole = _bits(w) - _bits(_NEAREST)
    half = whole >> 1
    return p * _number((half + 1023) << 52) * _number((whole - half + 1023) << 52)


@of_a_number
def logarithm(x: float) -> float:
    """Return log(abs(x)), after FreeBSD's msun: x = 2^e m with m from sqrt(1/2) to sqrt(2), s = (m - 1)/(m + 1)."""
    t = abs(x)
    tiny = t < _NORMAL
    bits = _bits(t * 2.0**54 if tiny else t)
    e = (bits - _SQRT_HALF_BITS) >> 52
    f = _number(bits - (e << 52)) - 1.0
    n = np.float64(e - (54 if tiny else 0))
    s = f / (2.0 + f)
    z = s * s
    p = _polynomial(_L, z)
    half = 0.5 * f * f
    value = n * _LN2_HIGH - ((half - (s * (half + z * p) + n * _LN2_LOW)) - f)
    return (value if t > 0.0 else -math.inf) if t < math.inf else t


@of_a_number
def hyperbolic_tangent(x: float) -> float:
    """Return tanh(x), after Cephes: a rational function near 0, the exponential elsewhere."""
    t = abs(x)
    z = x * x
    p = (_T[0] * z + _T[1]) * z + _T[2]
    q = ((z + _U[0]) * z + _U[1]) * z + _U[2]
    far = 1.0 - 2.0 / (exponential(2.0 * t) + 1.0)
    near = t + t * (z * (p / q))
    return math.copysign(near if t < 0.625 else far, x)

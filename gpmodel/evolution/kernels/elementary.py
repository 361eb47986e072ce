"""Elementary functions without branches, so that the compiler vectorises loops over poses.

Sine and cosine reduce the angle by multiples of pi, held in three parts, and evaluate one odd polynomial.
They hold to a few ulp of 1 up to ``ANGLE_LIMIT``; beyond it callers use the library's functions.
"""

import math

import numpy as np

from gpmodel.evolution.kernels.compiler import inlined

ANGLE_LIMIT = 1e5

_INVERSE_PI = 1.0 / math.pi
_PI_1 = 3.1415926534682512
_PI_2 = 1.2154201012607932e-10
_PI_3 = 4.044532497591901e-21
_S = tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(11))

_TAN_3PI_8 = 2.414213562373095
_A = (-8.750608600031904122785e-1, -1.615753718733365076637e1, -7.500855792314704667340e1,
      -1.228866684490136173410e2, -6.485021904942025371773e1)  # fmt: skip
_B = (2.485846490142306297962e1, 1.650270098316988542046e2, 4.328810604912902668951e2,
      4.853903996359136964868e2, 1.945506571482613964425e2)  # fmt: skip

_LOG2_E = 1.0 / math.log(2.0)
_LN2_HIGH = 0.6931471803691238
_LN2_LOW = 1.9082149292705877e-10
_E = tuple(1.0 / math.factorial(k) for k in range(14))
_POWERS_OF_TWO = np.ldexp(1.0, np.arange(-600, 601))

_T = (-9.64399179425052238628e-1, -9.92877231001918586564e1, -1.61468768441708447952e3)
_U = (1.12811678491632931402e2, 2.23548839060100448583e3, 4.84406305325125486048e3)


@inlined
def _reduced_sine(r: float, parity: float) -> float:
    s = r * r
    p = _S[10]
    p = p * s + _S[9]
    p = p * s + _S[8]
    p = p * s + _S[7]
    p = p * s + _S[6]
    p = p * s + _S[5]
    p = p * s + _S[4]
    p = p * s + _S[3]
    p = p * s + _S[2]
    p = p * s + _S[1]
    return (1.0 - 2.0 * parity) * (r + r * (s * p))


@inlined
def sine(x: float) -> float:
    """sin(x) for abs(x) up to ANGLE_LIMIT."""
    k = np.floor(x * _INVERSE_PI + 0.5)
    r = ((x - k * _PI_1) - k * _PI_2) - k * _PI_3
    return _reduced_sine(r, k - 2.0 * np.floor(0.5 * k))


@inlined
def cosine(x: float) -> float:
    """cos(x) for abs(x) up to ANGLE_LIMIT."""
    n = np.floor(x * _INVERSE_PI)
    k = n + 0.5
    r = ((x - k * _PI_1) - k * _PI_2) - k * _PI_3
    n = n + 1.0
    return _reduced_sine(r, n - 2.0 * np.floor(0.5 * n))


@inlined
def arctangent(x: float) -> float:
    """atan(x), after Cephes (S. L. Moshier): two reductions and a rational function."""
    t = abs(x)
    big = t > _TAN_3PI_8
    middle = (t > 0.66) & (not big)
    top = -1.0 if big else (t - 1.0 if middle else t)
    bottom = t if big else (t + 1.0 if middle else 1.0)
    start = 0.5 * math.pi if big else (0.25 * math.pi if middle else 0.0)
    r = top / bottom
    z = r * r
    p = z * ((((_A[0] * z + _A[1]) * z + _A[2]) * z + _A[3]) * z + _A[4])
    q = ((((z + _B[0]) * z + _B[1]) * z + _B[2]) * z + _B[3]) * z + _B[4]
    value = start + (r * (p / q) + r)
    return math.copysign(value, x)


@inlined
def exponential(x: float) -> float:
    """exp(x): 2^n from a table in two halves, times a polynomial of the remainder."""
    t = -750.0 if x < -750.0 else (710.0 if x > 710.0 else x)
    n = np.floor(t * _LOG2_E + 0.5)
    r = (t - n * _LN2_HIGH) - n * _LN2_LOW
    p = _E[13]
    p = p * r + _E[12]
    p = p * r + _E[11]
    p = p * r + _E[10]
    p = p * r + _E[9]
    p = p * r + _E[8]
    p = p * r + _E[7]
    p = p * r + _E[6]
    p = p * r + _E[5]
    p = p * r + _E[4]
    p = p * r + _E[3]
    p = p * r + _E[2]
    p = p * r + 1.0
    p = p * r + 1.0
    whole = np.int64(n if n == n else 0.0)
    half = whole >> 1
    return p * _POWERS_OF_TWO[np.uint64(half + 600)] * _POWERS_OF_TWO[np.uint64(whole - half + 600)]


@inlined
def hyperbolic_tangent(x: float) -> float:
    """tanh(x), after Cephes: a rational function near 0, the exponential elsewhere."""
    t = abs(x)
    z = x * x
    p = (_T[0] * z + _T[1]) * z + _T[2]
    q = ((z + _U[0]) * z + _U[1]) * z + _U[2]
    far = 1.0 - 2.0 / (exponential(2.0 * t) + 1.0)
    near = t + t * (z * (p / q))
    return math.copysign(near if t < 0.625 else far, x)

"""Execution of straight-line code on rows of values, one value per pose."""

import math

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.evolution.kernels.compiler import inlined
from gpmodel.evolution.kernels.elementary import (
    ANGLE_LIMIT,
    arctangent,
    cosine,
    exponential,
    hyperbolic_tangent,
    logarithm,
    sine,
    tangent,
)
from gpmodel.evolution.kernels.machine import CONSTANT


@inlined
def _within(row: Array, limit: float, width: int) -> bool:
    beyond = 0
    for j in range(width):
        beyond += abs(row[j]) > limit
    return beyond == 0


@inlined
def execute(words: IntArray, count: int, constants: Array, rows: Array, base: int, width: int) -> None:
    """Fill row ``base + k`` of ``rows`` with the values of instruction k of a program at `width` poses."""
    for k in range(count):
        code = words[k] & 0xFFFF
        a = (words[k] >> 16) & 0xFFFF
        b = words[k] >> 32
        r = base + k
        if code == 3:
            for j in range(width):
                rows[r, j] = rows[a, j] + rows[b, j]
        elif code == 4:
            for j in range(width):
                rows[r, j] = rows[a, j] - rows[b, j]
        elif code == 5:
            for j in range(width):
                rows[r, j] = rows[a, j] * rows[b, j]
        elif code == 6:
            for j in range(width):
                rows[r, j] = rows[a, j] / rows[b, j]
        elif code == 7:
            for j in range(width):
                rows[r, j] = rows[b, j] * np.floor(rows[a, j] / rows[b, j])
            for j in range(width):
                rows[r, j] = rows[a, j] - rows[r, j]
        elif code == 8:
            for j in range(width):
                x = rows[a, j]
                y = rows[b, j]
                rows[r, j] = x if (x < y) | (x != x) else y
        elif code == 9:
            for j in range(width):
                x = rows[a, j]
                y = rows[b, j]
                rows[r, j] = x if (x > y) | (x != x) else y
        elif code == 10:
            for j in range(width):
                rows[r, j] = abs(rows[a, j])
        elif code == 11:
            for j in range(width):
                rows[r, j] = rows[a, j] * rows[a, j]
        elif code == 12:
            for j in range(width):
                rows[r, j] = math.sqrt(abs(rows[a, j]))
        elif code == 13:
            for j in range(width):
                rows[r, j] = 1.0 if rows[a, j] == 0.0 else 0.0
        elif code == 17:
            for j in range(width):
                rows[r, j] = arctangent(rows[a, j])
        elif code == 18:
            for j in range(width):
                rows[r, j] = exponential(rows[a, j])
        elif code == 19:
            for j in range(width):
                rows[r, j] = logarithm(rows[a, j])
        elif code == 20:
            for j in range(width):
                rows[r, j] = hyperbolic_tangent(rows[a, j])
        elif code == 21:
            for j in range(width):
                rows[r, j] = math.asin(rows[a, j])
        elif code == 22:
            for j in range(width):
                rows[r, j] = 1.0 / rows[a, j]
        elif code == CONSTANT:
            for j in range(width):
                rows[r, j] = constants[a]
        elif _within(rows[a], ANGLE_LIMIT, width):
            if code == 14:
                for j in range(width):
                    rows[r, j] = sine(rows[a, j])
            elif code == 15:
                for j in range(width):
                    rows[r, j] = cosine(rows[a, j])
            else:
                for j in range(width):
                    rows[r, j] = tangent(rows[a, j])
        elif code == 14:
            for j in range(width):
                rows[r, j] = math.sin(rows[a, j])
        elif code == 15:
            for j in range(width):
                rows[r, j] = math.cos(rows[a, j])
        else:
            for j in range(width):
                rows[r, j] = math.tan(rows[a, j])

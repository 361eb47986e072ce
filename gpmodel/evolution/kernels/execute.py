"""Execution of straight-line code on rows of values, one value per pose."""

import math

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.evolution.kernels.compiler import inlined
from gpmodel.evolution.kernels.differentiation import differentiated
from gpmodel.evolution.kernels.machine import CONSTANT


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
        elif code == CONSTANT:
            for j in range(width):
                rows[r, j] = constants[a]
        else:
            for j in range(width):
                rows[r, j] = differentiated(code, rows[a, j], rows[b, j])[0]

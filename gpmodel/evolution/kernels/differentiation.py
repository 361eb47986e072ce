"""Operators with their derivatives, for single numbers, and forward differentiation of programs."""

import math

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.evolution.kernels.compiler import compiled
from gpmodel.evolution.kernels.machine import CONSTANT
from gpmodel.formula.operators import INPUT


@compiled
def differentiated(code: int, a: float, b: float) -> tuple[float, float, float]:
    """Return the value of an operator and its derivatives with respect to its first and second argument. code: op-code
    of ``formula.operators``."""
    if code == 3:
        return a + b, 1.0, 1.0
    if code == 4:
        return a - b, 1.0, -1.0
    if code == 5:
        return a * b, b, a
    if code == 6:
        return a / b, 1.0 / b, -a / (b * b)
    if code == 7:
        turns = np.floor(a / b)
        return a - b * turns, 1.0, -turns
    if code == 8:
        first = 1.0 if a < b else 0.0
        return (a if a < b or a != a else b), first, 1.0 - first
    if code == 9:
        first = 1.0 if a > b else 0.0
        return (a if a > b or a != a else b), first, 1.0 - first
    if code == 10:
        return abs(a), np.sign(a), 0.0
    if code == 11:
        return a * a, 2.0 * a, 0.0
    if code == 12:
        root = math.sqrt(abs(a))
        return root, 0.5 * np.sign(a) / root, 0.0
    if code == 13:
        return (1.0 if a == 0.0 else 0.0), 0.0, 0.0
    if code == 14:
        return math.sin(a), math.cos(a), 0.0
    if code == 15:
        return math.cos(a), -math.sin(a), 0.0
    if code == 16:
        slope = math.tan(a)
        return slope, 1.0 + slope * slope, 0.0
    if code == 17:
        return math.atan(a), 1.0 / (1.0 + a * a), 0.0
    if code == 18:
        power = math.exp(a)
        return power, power, 0.0
    if code == 19:
        return math.log(abs(a)), 1.0 / a, 0.0
    if code == 20:
        level = math.tanh(a)
        return level, 1.0 - level * level, 0.0
    if code == 21:
        return math.asin(a), 1.0 / math.sqrt(1.0 - a * a), 0.0
    if code == 22:
        return 1.0 / a, -1.0 / (a * a), 0.0
    if code == 23:
        return np.sign(a), 0.0, 0.0
    if code == 24:
        return (1.0 if a > 0.0 else 0.0), 0.0, 0.0
    if code == 25:
        half = 0.5 * math.tanh(0.5 * a)
        return 0.5 + half, (0.5 + half) * (0.5 - half), 0.0
    if code == 26:
        return a - min(max(a, -1.0), 1.0), (1.0 if abs(a) > 1.0 else 0.0), 0.0
    if code == 27:
        away = math.hypot(a, b)
        return away, a / max(away, 2.0**-1022), b / max(away, 2.0**-1022)
    return a**b, b * a ** (b - 1.0), a**b * math.log(a)


@compiled
def carry_tangents(nodes: IntArray, inputs: Array, constants: Array, values: Array, tangents: Array) -> None:
    """Fill the values (nodes, poses) of a program, and the derivatives (constants, nodes, poses) by its constants.

    nodes: op-code and two arguments (3, nodes); an operator's are earlier nodes, the first one of an input or a
    constant is its index. Derivatives are computed only for constants on which a node depends.
    """
    own, size, poses = len(constants), nodes.shape[1], inputs.shape[1]
    reached = np.zeros((own, size), np.bool_)
    for k in range(size):
        code, first, second = nodes[0, k], nodes[1, k], nodes[2, k]
        if code == INPUT:
            for j in range(poses):
                values[k, j] = inputs[first, j]
        elif code == CONSTANT:
            for j in range(poses):
                values[k, j] = constants[first]
                tangents[first, k, j] = 1.0
            reached[first, k] = True
        else:
            for c in range(own):
                reached[c, k] = reached[c, first] or reached[c, second]
            for j in range(poses):
                values[k, j], by_first, by_second = differentiated(code, values[first, j], values[second, j])
                for c in range(own):
                    if reached[c, k]:
                        tangent = by_first * tangents[c, first, j] if reached[c, first] else 0.0
                        tangents[c, k, j] = tangent + (
                            by_second * tangents[c, second, j] if reached[c, second] else 0.0
                        )

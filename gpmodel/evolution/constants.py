"""Least-squares fit of the constants of an evolved program."""

from collections.abc import Mapping, Sequence
from itertools import count

import numpy as np

from gpmodel.arrays import LARGEST, Array, IntArray
from gpmodel.evolution.projection import SMALLEST, Targets
from gpmodel.formula.operators import BY_NAME, INPUT
from gpmodel.formula.program import Program

IDLE = 1e-12
"""Least share of the derivative with respect to a constant that lies outside the span of the model's columns. A
constant with a smaller share is not fitted, because columns of the model have an equal effect."""


def polish(
    program: Program,
    targets: Targets,
    site: int,
    inputs: Mapping[str, Array],
    held: tuple[float, ...] = (),
    steps: int = 20,
) -> tuple[Program, float]:
    """Fit the constants of a program at a site (frame and axis); return the program and its gain.

    The gain is the share of the residual sum of squares that the program removes. The method is Levenberg-Marquardt on
    the projected residual (`kernels.constants`); the coefficient is solved at every step. Constants with a value in
    ``held`` are not fitted. The fit never lowers the gain. A program with several outputs, or without a free constant,
    is returned unchanged.
    """
    place = targets if targets.sites == 1 else targets.only(site)
    free = np.array([value not in held for value in program.constants], dtype=bool)
    if len(program.outputs) != 1 or not free.any():
        return program, place.set_gain(program.evaluate(inputs), 0)[0]
    from gpmodel.evolution.kernels.constants import fit_constants

    names = program.inputs
    columns = np.array([inputs[name] for name in names], dtype=float).reshape(-1, place.poses)
    constants = np.array(program.constants)
    limits = (SMALLEST, LARGEST, IDLE)
    gain = fit_constants(_nodes(program, names), columns, constants, free, place.first, limits, steps)
    return program.with_constants(constants.tolist()), gain


def _nodes(program: Program, names: Sequence[str]) -> IntArray:
    """Convert a program to three rows: the op-code and the two arguments of each node. names: inputs by index."""
    from gpmodel.evolution.kernels.machine import CONSTANT

    numbers = count()
    found = []
    for node in program.nodes:
        if node.operator == "input":
            found.append((INPUT, names.index(str(node.value)), 0))
        elif node.operator == "constant":
            found.append((CONSTANT, next(numbers), 0))
        else:
            found.append((BY_NAME[node.operator].code, node.arguments[0], node.arguments[-1]))
    return np.array(found, dtype=np.int64).T.copy()

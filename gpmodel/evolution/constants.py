"""Constants of a program fitted by least squares, with derivatives carried forward through it."""

from collections.abc import Mapping, Sequence
from itertools import count

import numpy as np
from scipy.linalg import lapack

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.evolution.projection import SMALLEST, Targets
from gpmodel.formula.operators import BY_NAME, INPUT
from gpmodel.formula.program import Program

LARGEST = 1e100
"""A value whose square is still a number."""
IDLE = 1e-12
"""Share of its column outside the enabled ones up to which a constant stays: what it does they do."""


def derivatives(program: Program, inputs: Mapping[str, Array]) -> tuple[Array, Array]:
    """Values (m, N) and their derivatives (constants, m, N) with respect to ``program.constants``.

    Forward mode: each node carries one tangent a constant that reaches it.
    """
    length = max(np.size(column) for column in inputs.values())
    values = program.values(inputs, length)
    return _rows(program, values), _tangents(program, values)


def _rows(program: Program, values: list[Array]) -> Array:
    """The outputs (m, N) among the values (N,) of all nodes."""
    return np.array([values[k] for k in program.outputs])


def _tangents(program: Program, values: list[Array]) -> Array:
    """Derivatives (constants, m, N) of the outputs, from the values (N,) of all nodes."""
    length = len(values[0])
    tangents: list[dict[int, Array]] = []
    constants = 0
    with np.errstate(all="ignore"):
        for node in program.nodes:
            tangent: dict[int, Array] = {}
            if node.operator == "constant":
                tangent[constants] = np.ones(length)
                constants += 1
            elif any(tangents[k] for k in node.arguments):
                partials = BY_NAME[node.operator].derivatives(*(values[k] for k in node.arguments))
                for k, partial in zip(node.arguments, partials, strict=True):
                    for constant, inner in tangents[k].items():
                        tangent[constant] = tangent.get(constant, 0.0) + partial * inner
            tangents.append(tangent)
    found = np.zeros((constants, len(program.outputs), length))
    for place, output in enumerate(program.outputs):
        for constant, tangent_row in tangents[output].items():
            found[constant, place] = tangent_row
    return found


def polish(
    program: Program,
    targets: Targets,
    site: int,
    inputs: Mapping[str, Array],
    held: tuple[float, ...] = (),
    steps: int = 20,
) -> tuple[Program, float]:
    """The program with constants that explain most at a site, and its gain there.

    Levenberg-Marquardt on the projected residual; the coefficients of the outputs are solved anew at every
    step. Constants whose value is in ``held`` stay. Never returns a smaller gain than it was given. Of one output a
    kernel does the same.
    """
    place = targets if targets.sites == 1 else targets.only(site)
    free = np.array([value not in held for value in program.constants], dtype=bool)
    if len(program.outputs) == 1 and free.any():
        return _polish_one(program, place, inputs, free, steps)
    return _polish_several(program, place, inputs, free, steps)


def _polish_one(
    program: Program, place: Targets, inputs: Mapping[str, Array], free: Mask, steps: int
) -> tuple[Program, float]:
    """``polish`` for one output at one place."""
    from gpmodel.evolution.kernels.constants import fit_constants

    names = program.inputs
    columns = np.array([inputs[name] for name in names], dtype=float).reshape(-1, place.poses)
    constants = np.array(program.constants)
    gain = fit_constants(
        _nodes(program, names), columns, constants, free, place.weight[0], place.cross[0], place.pull[0],
        float(place.energy), place.unique_share, (SMALLEST, LARGEST, IDLE), steps,
    )  # fmt: skip
    return program.with_constants(constants.tolist()), gain


def _nodes(program: Program, names: Sequence[str]) -> IntArray:
    """Op-code and two arguments (3, nodes) of a program whose inputs have these names, as kernels read them."""
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


def _polish_several(
    program: Program, place: Targets, inputs: Mapping[str, Array], free: Mask, steps: int
) -> tuple[Program, float]:
    """``polish`` for any number of outputs at one place."""
    gain, coefficients = place.set_gain(program.evaluate(inputs), 0)
    constants = np.array(program.constants)
    if not free.any() or not coefficients.any():
        return program, gain
    values = program.values(inputs, place.poses)
    damping, diagonal = 1e-3, np.eye(len(coefficients) + int(free.sum()))
    for _ in range(steps):
        step = _step(program, place, values, coefficients, free)
        if step is None:
            break
        normal, slope = step
        moved = False
        for _ in range(4):
            _, _, change, singular = lapack.dgesv(normal * (1.0 + damping * diagonal), slope)
            trial = constants.copy()
            trial[free] += change[len(coefficients) :]
            if not singular and np.all(np.isfinite(trial)) and len(set(trial.tolist())) == len(trial):
                trial_values = program.values(inputs, place.poses, trial.tolist())
                trial_gain, trial_coefficients = place.set_gain(_rows(program, trial_values), 0)
                if trial_gain > gain:
                    moved = True
                    break
            damping *= 10.0
        if not moved:
            break
        improvement = trial_gain - gain
        constants, values, gain, coefficients = trial, trial_values, trial_gain, trial_coefficients
        damping = max(damping * 0.1, 1e-12)
        if improvement < 1e-9 * (1.0 - gain):
            break
    return program.with_constants(constants), gain


def own_constants_polished(
    program: Program, targets: Targets, site: int, inputs: Mapping[str, Array], own: Array, fixed: tuple[float, ...]
) -> Array:
    """A program's own constants after ``polish``; those that its effective code does not use stay."""
    better, _ = polish(program, targets, site, inputs, held=fixed, steps=8)
    change = dict(zip(program.constants, better.constants, strict=True))
    return np.array([change.get(value, value) for value in own.tolist()])


def _step(
    program: Program, place: Targets, values: list[Array], coefficients: Array, free: Mask
) -> tuple[Array, Array] | None:
    """Normal equations of one Gauss-Newton step in coefficients and free constants, None where they are no numbers."""
    rows, tangents = _rows(program, values), _tangents(program, values)
    with np.errstate(all="ignore"):
        columns = np.vstack([rows, np.tensordot(coefficients, tangents[free], axes=(0, 1))])
        shape = coefficients @ rows
    if not np.all(np.abs(columns) < LARGEST):
        return None
    seen = columns @ place.cross[0].T
    total = (columns * place.weight[0]) @ columns.T
    normal = total - seen @ seen.T
    rest = place.pull[0] - place.weight[0] * shape + (place.cross[0] @ shape) @ place.cross[0]
    slope = columns @ rest
    if not (np.all(np.isfinite(normal)) and np.all(np.isfinite(slope))):
        return None
    idle = np.diag(normal) <= IDLE * np.diag(total)
    normal[idle, :], normal[:, idle], slope[idle] = 0.0, 0.0, 0.0
    return normal + np.diag(idle.astype(float)), slope

"""Test the compiled fit of constants against finite differences and NumPy."""

import numpy as np
import pytest

from gpmodel.arrays import Array
from gpmodel.evolution import constants
from gpmodel.evolution.constants import polish
from gpmodel.evolution.kernels.constants import solve
from gpmodel.evolution.kernels.differentiation import carry_tangents, differentiated
from gpmodel.evolution.projection import Targets
from gpmodel.formula.expression import parse
from gpmodel.formula.operators import LANGUAGE, Operator

RNG = np.random.default_rng(7)
INPUTS = {"a": RNG.uniform(-2, 2, 90), "b": RNG.uniform(0.5, 2, 90)}
PROGRAMS = (
    "sin(1.7*a + 0.3)",
    "exp(-((a - 0.4)/0.7)**2)*b",
    "t = a*2.5; tanh(t)*t + max(t, 0.1)",
    "sqrt(b + 3.5)/(b - 4.5) + log(b*0.2) + atan(a % 0.9)",
    "deadzone(1.3*(a - 0.2)) - 0.4*logistic(3.1*a)",
    "power(abs(a - 0.1), 1.7)",
    "hypot(a - 0.3, 0.5*(b - 1.1))",
    "step(a - 0.2)*(b - 0.7)",
    "tanh(1.2*(a - 0.3)) - 0.77",
    "sqrt(1 - abs(a - 3))",
    "min(a - 0.2, 0) + 1.5",
    "a - 0.5",
)


def seen_from_a_place(response: Array) -> Targets:
    """A response (N,) seen with unequal weights, an offset and a slope enabled."""
    sensitivity = RNG.uniform(0.2, 1.5, (3, len(response)))
    rows = np.vstack([np.ones_like(response), INPUTS["b"], RNG.normal(size=(3, len(response)))])
    columns = np.concatenate([rows * axis for axis in sensitivity], axis=1)
    q = np.linalg.qr(columns.T)[0].T
    residual = (sensitivity * response).ravel()
    residual -= q.T @ (q @ residual)
    cross = np.einsum("kan,an->kn", q.reshape(len(q), 3, -1), sensitivity)
    pull = np.sum(sensitivity * residual.reshape(3, -1), axis=0)
    weight = np.sum(sensitivity**2, axis=0)
    return Targets(weight[None], cross[None], pull[None], float(residual @ residual), ("J1",), residual.size)


@pytest.mark.parametrize("operator", LANGUAGE, ids=lambda operator: operator.name)
def test_operators_and_their_derivatives(operator: Operator) -> None:
    a, b = RNG.normal(scale=3.0, size=(2, 200))
    special = np.array([0.0, -0.0, 1.0, -1.0, np.nan, 1e-310, 0.5, -2.5])
    a, b = np.concatenate([a, np.repeat(special, 8)]), np.concatenate([b, np.tile(special, 8)])
    found = np.array([differentiated(operator.code, x, y) for x, y in zip(a, b, strict=True)]).T
    arguments = (a, b)[: operator.arity]
    with np.errstate(all="ignore"):
        expected = (operator.function(*arguments), *operator.derivatives(*arguments))
    for one, other in zip(found, expected, strict=False):
        defined = ~np.isnan(a) & ~np.isnan(b)  # of NaN a derivative is a NaN or, where it is a constant, a number
        np.testing.assert_allclose(one[defined], other[defined], rtol=1e-13, atol=1e-15)
    np.testing.assert_array_equal(np.isnan(found[0]), np.isnan(expected[0]))


@pytest.mark.parametrize("text", PROGRAMS)
def test_tangents_agree_with_finite_differences(text: str) -> None:
    program = parse(text)
    nodes, start = constants._nodes(program, program.inputs), np.array(program.constants)
    columns = np.array([INPUTS[name] for name in program.inputs])
    values, found = np.empty((nodes.shape[1], 90)), np.zeros((len(start), nodes.shape[1], 90))
    carry_tangents(nodes, columns, start, values, found)
    np.testing.assert_allclose(values[-1], program.evaluate(INPUTS)[0], rtol=1e-12, atol=1e-14)
    for k, step in enumerate(1e-6 * np.eye(len(start))):
        ahead, behind = (program.with_constants(start + sign * step).evaluate(INPUTS)[0] for sign in (1, -1))
        np.testing.assert_allclose(found[k, -1], (ahead - behind) / 2e-6, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("text", PROGRAMS)
def test_the_gain_is_that_of_the_constants_found_and_no_smaller(text: str) -> None:
    program = parse(text)
    response = np.sin(1.3 * INPUTS["a"]) * INPUTS["b"] + 0.05 * RNG.normal(size=90)
    place = seen_from_a_place(response)
    found, gain = polish(program, place, 0, INPUTS, (0.2, -1.0))
    assert gain == pytest.approx(place.set_gain(found.evaluate(INPUTS), 0)[0], rel=1e-9)
    assert gain >= place.set_gain(program.evaluate(INPUTS), 0)[0] - 1e-12


def test_a_constant_that_the_enabled_columns_say_stays() -> None:
    place = seen_from_a_place(np.tanh(2.0 * (INPUTS["a"] - 0.4)))
    start = parse("tanh(1.2*(a - 0.1)) - 0.77")
    found, gain = polish(start, place, 0, INPUTS)
    assert gain > 1.0 - 1e-9
    assert found.constants == pytest.approx((2.0, 0.4, 0.77))


def test_small_normal_equations_are_solved_in_place() -> None:
    for size in range(1, 6):
        columns, right = RNG.normal(size=(size, 9)), RNG.normal(size=size)
        matrix = columns @ columns.T
        equations = np.column_stack([matrix, right])
        assert solve(equations, np.empty(size), size)
        np.testing.assert_allclose(equations[:, -1], np.linalg.solve(matrix, right), rtol=1e-9)
    assert not solve(np.column_stack([np.zeros((2, 2)), np.ones(2)]), np.empty(2), 2)

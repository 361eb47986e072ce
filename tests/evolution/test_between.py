"""Loss of a formula between the rows of a table: poles and undefined values count, curvature does not."""

import numpy as np
import pytest

from gpmodel.evolution.between import PointsBetween
from gpmodel.formula.expression import parse

RNG = np.random.default_rng(0)
COLUMNS = {name: -0.99 + 0.02 * RNG.permutation(200) for name in "abc"}
BETWEEN = PointsBetween(COLUMNS, 1.0, RNG)

SMOOTH = ("sin(9.8*a)*sin(1.3*b)", "exp(a*b) - c**3", "1/(1 + a**2 + b**2)", "abs(a)*sqrt(c)", "step(a - 1)",
          "tanh(90*a)", "sin(a)/a", "a/b*b", "3")  # fmt: skip
EXPLODES = ("1/(a - 1)", "b + 0.03/(c - 2)", "exp(b)/(1 - 0.5*a)", "tanh(a)/a**2", "a + 0.001/a**2")


@pytest.mark.parametrize("law", SMOOTH)
def test_a_formula_without_a_pole_loses_nothing(law: str) -> None:
    assert BETWEEN.loss(parse(law)) < 1e-4


@pytest.mark.parametrize("law", EXPLODES)
def test_a_pole_between_the_rows_counts_although_no_row_shows_it(law: str) -> None:
    assert BETWEEN.loss(parse(law)) > 0.01
    assert BETWEEN.loss(parse(law), 2.0) == pytest.approx(4.0 * BETWEEN.loss(parse(law)))


def test_a_formula_that_is_not_defined_between_the_rows_loses_the_variance_there() -> None:
    corners = {"a": np.array([0.0, 1.0])}
    assert PointsBetween(corners, 7.0, RNG).loss(parse("power(a*(a - 1), 0.5)")) == 1.0


@pytest.mark.parametrize("rows", [1, 2, 5])
def test_equal_rows_have_nothing_between_them(rows: int) -> None:
    assert PointsBetween({"a": np.ones(rows)}, 1.0, RNG).loss(parse("1/a")) == 0.0


POLES = ("1/a", "b + 1e-9/(a + b + 0.003)", "log(abs(c))/b", "tan(3*a)", "exp(a)/(b - a*c)", "1/(a*abs(a))")


@pytest.mark.parametrize("law", POLES)
def test_a_pole_on_a_line_between_two_rows_is_located(law: str) -> None:
    assert BETWEEN.has_pole(parse(law))


@pytest.mark.parametrize("law", [*SMOOTH, "1/(a - 1.01)", "a*(b - c)/(b - c)", "sqrt(abs(a - b))", "log(a + 1.5)"])
def test_a_zero_without_a_pole_is_none(law: str) -> None:
    assert not BETWEEN.has_pole(parse(law))


def test_a_pole_in_a_gap_of_the_rows_is_located() -> None:
    gap = np.concatenate([np.linspace(-1.0, -0.5, 20), np.linspace(0.0, 1.0, 20)])
    assert PointsBetween({"a": gap}, 1.0, RNG).has_pole(parse("a + 0.01/(a + 0.3)"))

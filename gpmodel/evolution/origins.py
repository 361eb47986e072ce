"""Origins of a table: a column that is far from zero compared with its range, such as a year, is searched from an
origin near its values.

In the unit of a distant column every smooth function is a straight line, and the residual is below the rounding error
of the column's squares. The search therefore uses ``column - origin``, and its formulas are converted to formulas of
the columns at the end.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import count

import numpy as np

from gpmodel.arrays import Array
from gpmodel.evolution.founders import combine
from gpmodel.evolution.links import exactly
from gpmodel.evolution.problems import Inputs
from gpmodel.formula.expression import parse
from gpmodel.formula.program import Program

DISTANT = 30.0
"""Ratio of a column's middle to its range above which the column is distant. At a ratio of 30 the best parabola differs
from 1/x by 7e-5 of the standard deviation of 1/x; at half the ratio by 3e-4, at double by 2e-5."""
NEAR = 2.0
"""Largest distance of an origin from the middle of a column, in ranges of the column. Zero of a response such as 1e6 +
hypot(a, b) is often a range outside the values; seen from a farther origin the values are distant."""


@dataclass(frozen=True)
class Origins:
    """Origins of the columns of a table, 0 for a column that is not distant.

    inputs: {name: origin} of the distant inputs. response: origin of the response.
    """

    inputs: Mapping[str, float]
    response: float

    @staticmethod
    def of(inputs: Inputs, response: Array) -> "Origins":
        """Return the origins of the columns of a table."""
        found = {name: _origin(column) for name, column in inputs.mapping().items()}
        return Origins({name: value for name, value in found.items() if value}, _origin(response))

    def differences(self, inputs: Inputs) -> Inputs:
        """Return the inputs minus their origins."""
        origins = np.array([self.inputs.get(name, 0.0) for name in inputs.names])
        return replace(inputs, values=inputs.values - origins[:, None])

    def restored(self, program: Program) -> Program:
        """Convert a formula of the differences to a formula of the columns."""
        shifts = {name: combine("subtract", parse(repr(name)), exactly(value)) for name, value in self.inputs.items()}
        found = program.with_inputs(shifts)
        return combine("add", exactly(self.response), found) if self.response else found


def _origin(column: Array) -> float:
    """Return the number of fewest digits near a distant column; 0 for a column that is not distant or constant."""
    width, middle = float(np.ptp(column)), 0.5 * float(column.min() + column.max())
    if not width or abs(middle) <= DISTANT * width:
        return 0.0
    rounded = (round(middle, digits) for digits in count(-int(np.log10(abs(middle))) - 1))
    return next(value for value in rounded if abs(value - middle) <= NEAR * width)


def rounding_share(column: Array) -> float:
    """Return the share of a column's variance that rounding errors of its values can have at most."""
    deviation = float(column.std())
    return float(np.square(np.finfo(float).eps * np.abs(column).max() / deviation)) if deviation > 0.0 else 0.0

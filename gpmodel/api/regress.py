"""Symbolic regression of any table: a formula of a response in named columns."""

import time
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from gpmodel.api.arguments import brief, check_integer, check_number, check_texts, file_path
from gpmodel.api.table import Shown, aligned
from gpmodel.arrays import LARGEST, Array
from gpmodel.errors import InputError, choices
from gpmodel.extras import extra_for
from gpmodel.files import to_json, write_text
from gpmodel.formula.expression import Expression

if TYPE_CHECKING:
    from gpmodel.evolution.regression import Law

FEWEST = 5
"""Least number of rows of the regression table. With fewer rows, the shortest formula with two constants fits any
response."""


@dataclass(frozen=True, repr=False)
class Regression(Shown):
    """Formulas found by symbolic regression, shortest first; each fits better than all shorter formulas.

    laws: the list of formulas. names: names of the columns of X (inputs). deviation: standard deviation of the
    response, in its unit. seconds: duration of the search.
    """

    _with_rows = False
    laws: tuple["Law", ...]
    names: tuple[str, ...]
    deviation: float
    seconds: float

    @cached_property
    def best(self) -> "Law":
        """The regression formula with the least description length."""
        return min(self.laws, key=lambda law: law.nats)

    @cached_property
    def expression(self) -> Expression:
        """The regression formula with the least description length, as a basis function of an effect."""
        return Expression(str(self.best.program))

    def predict(self, X: pd.DataFrame | ArrayLike, law: int | None = None) -> Array:
        """Predict the response at the rows of X, by the best formula or by the formula with the index `law` in `laws`.

        The predicted response is NaN in a row in which the formula is not defined. Raises InputError for a missing
        column, or a value that is not a finite real number.
        """
        names, values = _columns(X, self.names)
        if law is not None and not 0 <= check_integer(law, "law") < len(self.laws):
            raise InputError(f"{law}, expected 0 to {len(self.laws) - 1}", "law")
        chosen = self.best if law is None else self.laws[law]
        found = chosen.program.evaluate(dict(zip(names, values, strict=True)))[0]
        return np.where(np.isfinite(found), found, np.nan)

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row per formula of the regression.

        Columns: law, length (nodes and constants), r_squared, rms in the unit of the response, nats (description
        length, less is better), best.
        """
        return pd.DataFrame(
            {
                "law": [str(law.program) for law in self.laws],
                "length": [law.length for law in self.laws],
                "r_squared": [1.0 - law.left for law in self.laws],
                "rms": [self.deviation * float(np.sqrt(law.left)) for law in self.laws],
                "nats": [law.nats for law in self.laws],
                "best": [law is self.best for law in self.laws],
            }
        )

    def summary(self) -> str:
        """Return the formulas of the regression as a text table; a star marks the least description length."""
        rows = [
            (("* " if row.best else "  ") + str(row.law), str(row.length), f"{row.r_squared:.6f}", f"{row.rms:.3g}",
             f"{row.nats:.1f}")
            for row in self.to_dataframe().itertuples()
        ]  # fmt: skip
        return aligned([("  law", "length", "R²", "rms", "nats"), *rows])

    def save(self, file: str | Path) -> None:
        """Write the formulas of the regression as JSON. Raises InputError if the file cannot be written."""
        rows = self.to_dataframe().to_dict("records")
        write_text(file_path(file, "file"), to_json({"schema": 1, "inputs": self.names, "laws": rows}))

    def __repr__(self) -> str:
        return f"<{self.best.program}: R² {1.0 - self.best.left:.6f}, {len(self.laws)} laws>"


def regress(
    X: pd.DataFrame | ArrayLike,
    y: ArrayLike,
    *,
    names: list[str] | tuple[str, ...] | None = None,
    seconds: float = 5.0,
    seed: int = 0,
) -> Regression:
    """Find a formula y = f(X) by genetic programming with several link functions, and fit its constants.

    X: inputs, as a DataFrame, or an array with one column per input. Column values of order one are searched best.
    A column far from zero compared with its range, such as a year, is searched as its difference from a near number.
    y: response, one number per row of X, in any unit and with any offset.
    names: names of the columns of an array; None for x1 ... xK.
    seconds: duration of the search, unless an exact formula is found earlier. At most 100 (1 + seconds) rows, drawn at
    random, are searched; the constants are fitted to all rows afterwards. The search may take longer than `seconds`.
    seed: random seed; an exact formula depends on the seed alone, an approximate one also on the speed of the computer.
    The search minimises the description length rows/2 ln(1 - R²) + 3 (nodes + constants), nats. Where a formula grows
    without bound between neighbouring rows, its deviation from a straight line counts in R². A formula with a
    pole between neighbouring rows is returned only if it is exact at the rows.
    Raises InputError for inconsistent shapes, fewer than 5 rows, a constant y, or values that are complex, masked, not
    finite or above 1e100.
    Source: McCullagh, Nelder (1989), links; Rissanen (1978), description length.
    """
    seconds, seed = check_number(seconds, "seconds", 0.0), check_integer(seed, "seed")
    given = None if names is None else check_texts(names, "names", "('voltage', 'speed')")
    called, values = _columns(X, given)
    response = _response(y, values.shape[1])
    with extra_for("gpmodel.regress", "discover"):
        from gpmodel.evolution.problems import Inputs
        from gpmodel.evolution.regression import regression_front

        started = time.perf_counter()
        laws = regression_front(Inputs(called, values), response, np.random.default_rng(seed), seconds)
    return Regression(laws, called, float(response.std()), time.perf_counter() - started)


def _columns(table: pd.DataFrame | ArrayLike, names: tuple[str, ...] | None) -> tuple[tuple[str, ...], Array]:
    """Return names and values of a table's columns, or of the columns `names` alone."""
    if isinstance(table, pd.DataFrame):
        named = tuple(str(name) for name in table.columns)
        if twice := [name for name in dict.fromkeys(named) if named.count(name) > 1]:
            raise InputError(f"column '{twice[0]}' appears twice, expected each name once", "X")
        wanted = named if names is None else names
        missing = [name for name in wanted if name not in named]
        if missing:
            raise InputError(f"no column '{missing[0]}'; available: {choices(missing[0], named)}", "X")
        columns = table.set_axis(list(named), axis=1)[list(wanted)]
        for name, kind in zip(wanted, columns.dtypes, strict=True):
            if not pd.api.types.is_numeric_dtype(kind) or pd.api.types.is_complex_dtype(kind):
                raise InputError(f"column '{name}' holds no numbers, expected real numbers in every column", "X")
        return wanted, _checked(columns.to_numpy(dtype=float, na_value=np.nan), "X", wanted).T
    values = _numbers(table, "X")
    values = values[:, None] if values.ndim == 1 else values
    if values.ndim != 2 or not values.size:
        raise InputError(f"shape {values.shape}, expected (rows, columns)", "X")
    wanted = tuple(f"x{k + 1}" for k in range(values.shape[1])) if names is None else names
    if len(wanted) != values.shape[1]:
        raise InputError(f"{values.shape[1]} columns, expected {len(wanted)}: {', '.join(wanted)}", "X")
    return wanted, _checked(values, "X", wanted).T


def _response(y: ArrayLike, rows: int) -> Array:
    """Return the response y as numbers; raise InputError unless it has one number per row of the inputs X."""
    response = _numbers(y, "y").reshape(-1) if np.ndim(y) < 2 or np.shape(y)[1:] == (1,) else _numbers(y, "y")
    if response.shape != (rows,):
        raise InputError(f"has shape {response.shape}; expected one number for each of the {rows} rows of X", "y")
    if rows < FEWEST:
        raise InputError(f"{rows} rows, expected {FEWEST} or more", "X")
    return _checked(response, "y")


def _checked(values: Array, argument: str, names: tuple[str, ...] = ()) -> Array:
    """Return values (rows, columns); raise InputError for a value that is not finite or too large to be squared."""
    wrong = np.argwhere(~(np.abs(values) <= LARGEST))
    if len(wrong):
        place, value = tuple(wrong[0].tolist()), values[tuple(wrong[0])]
        what = f"{value:g} in" if np.isfinite(value) else "not finite in"
        column = f"column '{names[place[1]]}' is " if names else ""
        raise InputError(f"{column}{what} row {place[0]}, expected numbers up to {LARGEST:g}", argument)
    return values


def _numbers(value: ArrayLike, argument: str) -> Array:
    """Return a value as an array of numbers, masked numbers as NaN. Raises InputError if the value holds no real
    numbers."""
    if np.iscomplexobj(value):
        raise InputError("complex numbers, expected real numbers", argument)
    try:
        numbers = np.asarray(value, dtype=float)
        return np.where(np.ma.getmaskarray(value), np.nan, numbers) if np.ma.isMaskedArray(value) else numbers
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{brief(value)}, expected numbers", argument) from None

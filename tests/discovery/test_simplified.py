"""Test that the tested formula is the formula of the fit."""

from types import SimpleNamespace
from typing import Any, cast

from gpmodel.discovery.choose import FittedSelection, simplified
from gpmodel.families.candidate import one
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import Effect, effect_at


def formula(text: str) -> Effect:
    return effect_at(text, "J2.moving", "Rz", Expression(text))


def test_a_formula_that_algebra_writes_anew_is_fitted_anew() -> None:
    long, short = (one(text, formula(text), 4.0) for text in ("J2 + J2", "2*J2"))
    problem = cast(
        Any, SimpleNamespace(fit=lambda found, start: (found, start), residual=lambda fit: ("residual", fit))
    )
    fitted = FittedSelection(cast(Any, None), {"a": long}, cast(Any, SimpleNamespace(calibration="before")))

    def law(after: object) -> Any:
        return SimpleNamespace(candidate=SimpleNamespace(name="a"), simplified=lambda: after)

    anew = simplified(problem, fitted, [law(short)])
    assert anew.candidates == {"a": short}
    assert cast(Any, anew.left) == ("residual", ((short,), "before"))
    assert simplified(problem, fitted, [law(long)]) is fitted

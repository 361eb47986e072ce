"""Constants inside a candidate: whole symbols, however many there are."""

from gpmodel.families.inner import Constant, NonlinearParameters, symbol
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import effect_at


def inner(count: int) -> NonlinearParameters:
    effects = tuple(
        effect_at(f"gain {symbol(k)}", "base", "Rx", Expression(f"row*{symbol(k)} + lag_time_{symbol(k)}"))
        for k in range(count)
    )
    return NonlinearParameters("gains", effects, tuple(Constant("gain", "1", 2.0 + k, number=k) for k in range(count)))


def test_an_eleventh_constant_is_not_the_second_followed_by_a_nought() -> None:
    said = [effect.name for effect in inner(12).effects]
    assert said == [f"gain {2 + k}" for k in range(12)]
    assert str(inner(12).effects[10].terms[0].basis) == "row*12 + lag_time_12"


def test_leaving_out_the_second_constant_leaves_the_eleventh_in() -> None:
    left = inner(11).without(1)
    assert len(left.template) == len(left.constants) == 10
    assert left.effects[-1].name == "gain 12"

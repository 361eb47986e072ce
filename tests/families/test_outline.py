"""Laws of one input by their outline: a bump, a step, where it is, how wide, and how surely."""

import pytest

from gpmodel.families.candidate import Candidate
from gpmodel.families.outline import in_words, outline
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import effect_at

UNITS = {"J2": "rad", "J4": "rad", "slide": "m", "temperature": "degC"}


def law(text: str, family: str = "") -> Candidate:
    return Candidate(text, (effect_at(text, "J3.moving", "Ry", Expression(text), "rad", family),), family, 4.0)


@pytest.mark.parametrize(
    ("basis", "said"),
    [
        ("exp((-13.195)*square(J2 - (-1.6662)))", "bump of J2 at -95.5°, width 11.2°"),
        ("exp((-13.195)*square(J2 + 1.6662))", "bump of J2 at -95.5°, width 11.2°"),
        ("exp(-square((J4 - 0.5)/1.0))", "bump of J4 at 28.6°, width 40.5°"),
        ("exp(-2*square((temperature - 20)/3))", "bump of temperature at 20 °C, width 1.5 °C"),
        ("tanh((slide - 0.2)/0.05)", "step of slide at 200.0 mm, width 50 mm"),
        ("logistic((slide - 0.2)/(-0.025))", "step of slide at 200.0 mm, width 50 mm"),
        ("deadzone(4*(slide - 0.2))", "dead zone of slide at 200.0 mm, width 500 mm"),
    ],
)
def test_a_bump_and_a_step_are_called_so(basis: str, said: str) -> None:
    (named,) = in_words([law(basis)], UNITS)
    assert named.name == said == named.effects[0].name
    assert str(named.bases[0]) == basis


@pytest.mark.parametrize(
    "basis", ["exp(13*square(J2 + 1.7))", "sin(J2)", "exp(J2)", "exp(-square(J2)) + 1", "J2*exp(-J4)"]
)
def test_another_law_has_no_outline(basis: str) -> None:
    assert outline(Expression(basis)) is None
    assert in_words([law(basis)], UNITS)[0].name == basis


def test_names_stay_apart_and_families_keep_theirs() -> None:
    twins = [law("exp(-2*square(J4 - 0.5))"), law("exp(-2.0001*square(J4 - 0.5))")]
    assert [c.name for c in in_words(twins, UNITS)] == [c.name for c in twins]
    assert in_words([law("exp(-2*square(J4))", "gear")], UNITS)[0].name == "exp(-2*square(J4))"

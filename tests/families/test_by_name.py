"""Effects by the names a user gives them."""

import pytest
from cli_cases import robot

from gpmodel.errors import InputError
from gpmodel.families.by_name import effects_named, one_effect_named
from gpmodel.model.error_model import prepare

MECHANISM, MADE = robot(20)
STATES = prepare(MECHANISM, MADE.dataset).states


@pytest.mark.parametrize(
    ("name", "slots"),
    [
        ("base_compliance", ["base"]),
        ("joint_compliance J2", ["J2.moving", "J3.moving"]),
        ("gear_harmonic J4", ["J4.moving"]),
        ("gear_harmonic J4 2", ["J4.moving"]),
        ("J3.fixed:Tx:cos(J1)", ["J3.fixed"]),
    ],
)
def test_one_instance_acts_where_its_name_says(name: str, slots: list[str]) -> None:
    for effects in (effects_named(name, MECHANISM, STATES), one_effect_named(name, MECHANISM, STATES)):
        assert {slot for e in effects for slot in e.slots} == set(slots)


def test_a_family_is_all_its_instances() -> None:
    names = [e.name for e in effects_named("joint_compliance", MECHANISM, STATES)]
    assert set(names) >= {f"joint compliance, J{i}" for i in (2, 3, 4, 5)}
    assert len(set(names)) == len(names)
    assert len(effects_named("eccentricity", MECHANISM, STATES)) == 12


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("gremlins", "'gremlins' is unknown"),
        ("transmission_ripple", "name one"),
        ("thermal_growth", "no instance"),
        ("J9.fixed:Tx:1", "slot 'J9.fixed'"),
        ("J1.fixed:T:1", "axis 'T'"),
        ("J1.fixed:Tx:1/(row-3)", "undefined"),
    ],
)
def test_names_that_mean_nothing_here(name: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        effects_named(name, MECHANISM, STATES)

"""Test effects given by name."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from cli_cases import robot
from effect_cases import bare, measure, mechanism

from gpmodel.errors import InputError
from gpmodel.families import catalogue as families
from gpmodel.families.by_name import effects_named, one_effect_named
from gpmodel.families.candidate import Candidate, relative
from gpmodel.families.catalogue import Family, candidates, catalogue, installed
from gpmodel.families.inner import Constant, NonlinearParameters, lag_constants, symbol
from gpmodel.families.outline import in_words, outline
from gpmodel.formula.expression import Columns, Expression
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect, drive_effect, effect_at
from gpmodel.model.error_model import prepare
from gpmodel.model.sites import standard_effects
from gpmodel.model.states import States

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
        ("transmission_ripple", "expected one, for example"),
        ("thermal_growth", "does not exist for"),
        ("gear_harmonic 2", "names no joint and fits"),
        ("gear_harmonic J9", "does not exist for"),
        ("J9.fixed:Tx:1", "slot 'J9.fixed' is unknown"),
        ("J1.fixed:T:1", "axis 'T' is unknown.*Tx"),
        ("J1.fixed:Tx:1/(row-3)", "infinite or undefined"),
    ],
)
def test_names_that_mean_nothing_here(name: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        effects_named(name, MECHANISM, STATES)


def test_an_effect_of_unknown_loads_names_the_missing_masses(tmp_path: Path) -> None:
    text = (files("robots") / "data" / "irb6400r.toml").read_text(encoding="utf-8")
    (tmp_path / "arm.toml").write_text(re.sub(r"(?m)^(mass|com)_.*\n", "", text), encoding="utf-8")
    arm, made = robot(20, name=str(tmp_path / "arm.toml"))
    with pytest.raises(InputError, match="none; loads are unknown without masses of the links or a payload"):
        effects_named("joint_compliance J2", arm, prepare(arm, made.dataset).states)


def test_a_joint_whose_name_is_a_number_is_meant_by_it(tmp_path: Path) -> None:
    """In code such a name begins with an underscore; a number may also be the order of a harmonic."""
    text = (files("robots") / "data" / "irb6400r.toml").read_text(encoding="utf-8")
    (tmp_path / "arm.toml").write_text(re.sub(r'"J([1-6])"', r'"_\1"', text), encoding="utf-8")
    arm, made = robot(20, name=str(tmp_path / "arm.toml"))
    states = prepare(arm, made.dataset).states
    for name in ("gear_harmonic 4", "gear_harmonic J4", "gear_harmonic _4"):
        assert {slot for e in effects_named(name, arm, states) for slot in e.slots} == {"_4.moving"}


@pytest.mark.parametrize(
    "name",
    ["joint compliance, shoulder lift joint", "joint_compliance shoulder-lift_joint",
     "shoulder-lift joint.moving:Rz:torque_shoulder lift joint"],
)  # fmt: skip
def test_a_joint_is_named_as_its_description_or_table_spells_it(name: str) -> None:
    arm, made = robot(20, name="ur5")
    states = prepare(arm, made.dataset).states
    assert {slot for e in effects_named(name, arm, states) for slot in e.slots} == {"shoulder_lift_joint.moving"}
    assert len(standard_effects(arm, ("shoulder lift-joint R?",))) == 3


JOINT = mechanism("ur5").joints[3]
J = JOINT.name


def of(*bases: str) -> Candidate:
    effects = tuple(drive_effect(f"e{i}", JOINT, Expression(b)) for i, b in enumerate(bases))
    return Candidate("c", effects, "", 4.0)


STEP = Candidate("moved", tuple(effect_at(a, "base", a, Expression("row")) for a in ("Tx", "Ty", "Rz")), "", 4.0)


@pytest.mark.parametrize(
    ("values", "unit", "text"),
    [
        ((31.0, 38.0), "degC", "c - 20"),
        ((300.0, 310.0), "K", "c - 293.15"),
        ((1.7e9, 1.7e9 + 3600), "s", "c - 1700000000"),
        ((990.0, 1030.0), "hPa", "c - 990"),
        ((-3.0, -2.0), "1", "c + 2"),
        ((-1.0, 1.0), "1", "c"),
        ((0.0, 50.0), "kg", "c"),
    ],
)
def test_a_column_counts_from_where_the_constants_hold(values: tuple[float, ...], unit: str, text: str) -> None:
    arm = mechanism("ur5")
    states = prepare(arm, replace(bare("ur5", 2), extras={"c": np.array(values)}, extra_units={"c": unit})).states
    assert relative(states, "c", unit) == text


@pytest.mark.parametrize(
    ("candidate", "kind"),
    [
        (of(J), "single"),
        (of(f"sin(2*{J})", f"cos(2*{J})"), "harmonic"),
        (of(f"sin(2*{J})", f"cos(3*{J})"), "curve"),
        (of(f"sin({J})*row", f"cos({J})*row"), "curve"),
        (of(f"sin({J})", f"cos({J})", f"sin(2*{J})"), "curve"),
        (STEP, "vector"),
    ],
)
def test_the_kind_follows_from_the_bases(candidate: Candidate, kind: str) -> None:
    assert candidate.kind == kind


@pytest.mark.parametrize("candidate", [of(J), of(f"sin({J})", f"cos({J})"), of(J, f"{J}**2", "1"), STEP])
def test_the_gradient_of_the_amplitude_is_its_difference_quotient(candidate: Candidate) -> None:
    rng = np.random.default_rng(0)
    states = measure("ur5", (), (), 0).poses.states
    theta = rng.normal(size=len(candidate.effects))
    slope = candidate.amplitude(theta, states)[1]
    steps = 1e-6 * np.eye(len(theta))
    apart = [candidate.amplitude(theta + s, states)[0] - candidate.amplitude(theta - s, states)[0] for s in steps]
    np.testing.assert_allclose(slope, np.array(apart) / 2e-6, atol=1e-6)


def test_what_remembers_has_the_constants_of_its_columns_inside() -> None:
    effects = (effect_at("a lag_T_30p5", "base", "Tx", Expression("lag_T_30p5*stop_J2_0p1 + lag_T_30p5")),)
    inner = lag_constants("on lag_T_30p5", effects, lambda what, of: f"{what} of {of}")
    assert inner is not None
    assert [(c.name, c.unit, c.value) for c in inner.constants] == [
        ("lag", "lag of T", 30.5), ("half-width", "stop of J2", 0.1),
    ]  # fmt: skip
    assert (inner.full_name, inner.effects) == ("on lag_T_30p5", effects)
    moved = inner.at((41.25, 0.2))
    assert moved.full_name == "on lag_T_41p25"
    assert str(moved.effects[0].terms[0].basis) == "lag_T_41p25*stop_J2_0p2 + lag_T_41p25"
    assert lag_constants("plain", (effect_at("plain", "base", "Tx", Expression("last_move_J2")),), str.__add__) is None


def test_a_law_that_loses_a_term_loses_it_from_its_names() -> None:
    name = "lag_t_30 and lag_t_40 on J1.moving Tx"
    bases = [Expression("lag_t_30"), Expression("lag_t_40")]
    effects = tuple(effect_at(f"{name} [{k}]", "J1.moving", "Tx", basis) for k, basis in enumerate(bases, 1))
    inner = lag_constants(name, effects, lambda what, of: "min")
    assert inner is not None
    fewer = inner.without(0)
    assert fewer.full_name == "lag_t_40 on J1.moving Tx"
    assert [e.name for e in fewer.effects] == ["lag_t_40 on J1.moving Tx"]


@dataclass(frozen=True)
class Notch:
    """A basis in Python, whose text is no expression."""

    at: float
    inputs: tuple[str, ...] = ("J1",)

    def __call__(self, states: Columns) -> np.ndarray:
        return np.exp(-((states["J1"] - self.at) ** 2))

    def __str__(self) -> str:
        return f"a notch at {self.at} rad"


def test_two_bases_in_python_are_a_curve() -> None:
    effects = tuple(effect_at(f"notch {a}", "base", "Rx", Notch(a)) for a in (0.1, 0.2))
    assert Candidate("notches", effects, "", 4.0).kind == "curve"
    assert Candidate("notch", effects[:1], "", 4.0).kind == "single"


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


ARM = mechanism("ur5")
STATES_OFFER = prepare(ARM, bare("ur5", 20)).states


def cable_drag(mechanism: Mechanism, states: States) -> Iterator[Effect]:
    for joint in mechanism.joints:
        yield drive_effect(f"cable drag, {joint.name}", joint, Expression(f"tanh({joint.name})"))


MINE = Family("cable_drag", "the dress pack pulls at the joint", "our own cell", cable_drag)
EFFECT = drive_effect("stick", ARM.joints[0], Expression("tanh(9*row)"))
CANDIDATE = Candidate("stick and slip", (EFFECT,), "", 2.0)


def test_a_family_from_outside_is_offered_with_the_catalogue() -> None:
    pool = candidates(ARM, STATES_OFFER, (*catalogue, MINE))
    drags = [c for c in pool if c.family == "cable_drag"]
    assert len(drags) == len(ARM.joints)
    assert pool[: -len(drags)] == candidates(ARM, STATES_OFFER)
    assert {e.family for c in drags for e in c.effects} == {"cable_drag"}
    assert {c.explanation for c in drags} == {"the dress pack pulls at the joint (our own cell)"}
    assert all(c.explanation for c in pool)


def test_a_single_effect_or_candidate_is_offered_as_it_is() -> None:
    alone, ready = candidates(ARM, STATES_OFFER, (EFFECT, CANDIDATE))
    assert (alone.name, alone.effects, alone.family) == ("stick", (EFFECT,), "stick")
    assert alone.cost > 0
    assert ready == CANDIDATE
    assert candidates(ARM, STATES_OFFER, ()) == ()


def called_alike(mechanism: Mechanism, states: States) -> Iterator[Effect]:
    for n in (2, 3):
        yield drive_effect("cable drag", mechanism.joints[0], Expression(f"tanh({n}*J1)"))


def of_another_family(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    yield CANDIDATE


@pytest.mark.parametrize(
    ("offers", "said"),
    [
        ((MINE, MINE), "'cable_drag' is offered twice"),
        (("base_compliance",), "is of type str; expected a Family or an Effect"),
        ((Family("text", "yields text alone", "nobody", lambda m, s: ["tanh"]),), "'text' yields a str"),  # type: ignore[list-item]
        (
            (Family("other", "yields another's", "nobody", of_another_family),),
            "'stick and slip' belongs to",
        ),
        (
            (Family("alike", "yields two of one name", "nobody", called_alike),),
            "alike: two effects are called 'cable drag'",
        ),
    ],
)
def test_what_cannot_be_offered_is_said_in_one_line(offers: tuple[Family, ...], said: str) -> None:
    with pytest.raises(InputError, match=said):
        candidates(ARM, STATES_OFFER, offers)


class Provider:
    """An entry point as far as it is used."""

    def __init__(self, name: str, given: object) -> None:
        self.name, self.given = name, given

    def load(self) -> object:
        if isinstance(self.given, Exception):
            raise self.given
        return self.given


def test_installed_families_are_found_and_a_broken_provider_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    other = Family("other", "something else again", "our own cell", cable_drag)
    given = [Provider("b", (other,)), Provider("a", MINE)]
    monkeypatch.setattr(families, "entry_points", lambda group: given if group == "gpmodel.families" else [])
    assert installed() == (MINE, other)
    given.append(Provider("c", ImportError("no module named cables")))
    with pytest.warns(UserWarning, match="families of 'c' cannot be loaded: no module named cables"):
        assert installed() == (MINE, other)


def test_a_family_from_outside_changes_nothing_for_the_others() -> None:
    own = {e.name: e for c in candidates(ARM, STATES_OFFER) for e in c.effects}
    both = {e.name: e for c in candidates(ARM, STATES_OFFER, (MINE, *catalogue)) for e in c.effects}
    assert own.items() <= both.items()
    assert all(np.isfinite(t.basis(STATES_OFFER)).all() for name in both.keys() - own.keys() for t in both[name].terms)


@pytest.mark.long
@pytest.mark.parametrize("every", [False, pytest.param(True, marks=pytest.mark.long)])
def test_a_name_with_other_constants_is_read_as_it_is_printed(every: bool) -> None:
    """A search refines time constants, rows and rates, and prints names that no list of candidates has.

    Names that differ in their joint or axis only are of one kind.
    """
    arm = mechanism("irb6400r" if every else "dh")
    states = prepare(arm, bare("irb6400r" if every else "dh", 12, in_order=True)).states
    grids = (grid for f in catalogue for grid in f.grids(arm, states))
    inner = [*(c.inner for c in candidates(arm, states)), *(g.at(float(g.rates[1])).inner for g in grids)]
    of_constants = [own for own in inner if own and all(c.symbol in own.name for c in own.constants)]
    kinds = {own.name if every else re.sub(r"J\d|[TR][xyz]", "", own.name): own for own in of_constants}
    assert len(kinds) > 20
    for own in kinds.values():
        other = own.at([c.value + 1 if c.whole else float(f"{0.93 * c.value:.4g}") for c in own.constants])
        assert effects_named(other.full_name, arm, states) == other.effects

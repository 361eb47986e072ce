"""Families, candidates and effects from outside the package, offered like its own."""

from collections.abc import Iterator

import numpy as np
import pytest
from effect_cases import bare, mechanism

from gpmodel.errors import InputError
from gpmodel.families import family as families
from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import candidates, catalogue
from gpmodel.families.family import Family, installed
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect, drive_effect
from gpmodel.model.error_model import prepare
from gpmodel.model.states import States

ARM = mechanism("ur5")
STATES = prepare(ARM, bare("ur5", 20)).states


def cable_drag(mechanism: Mechanism, states: States) -> Iterator[Effect]:
    for joint in mechanism.joints:
        yield drive_effect(f"cable drag, {joint.name}", joint, Expression(f"tanh({joint.name})"))


MINE = Family("cable_drag", "the dress pack pulls at the joint", "our own cell", cable_drag)
EFFECT = drive_effect("stick", ARM.joints[0], Expression("tanh(9*row)"))
CANDIDATE = Candidate("stick and slip", (EFFECT,), "", 2.0)


def test_a_family_from_outside_is_offered_with_the_catalogue() -> None:
    pool = candidates(ARM, STATES, (*catalogue, MINE))
    drags = [c for c in pool if c.family == "cable_drag"]
    assert len(drags) == len(ARM.joints)
    assert pool[: -len(drags)] == candidates(ARM, STATES)
    assert {e.family for c in drags for e in c.effects} == {"cable_drag"}
    assert {c.explanation for c in drags} == {"the dress pack pulls at the joint (our own cell)"}
    assert all(c.explanation for c in pool)


def test_a_single_effect_or_candidate_is_offered_as_it_is() -> None:
    alone, ready = candidates(ARM, STATES, (EFFECT, CANDIDATE))
    assert (alone.name, alone.effects, alone.family) == ("stick", (EFFECT,), "stick")
    assert alone.cost > 0
    assert ready == CANDIDATE
    assert candidates(ARM, STATES, ()) == ()


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
            "'stick and slip' says it is of",
        ),
        (
            (Family("alike", "yields two of one name", "nobody", called_alike),),
            "alike: two effects are called 'cable drag'",
        ),
    ],
)
def test_what_cannot_be_offered_is_said_in_one_line(offers: tuple[Family, ...], said: str) -> None:
    with pytest.raises(InputError, match=said):
        candidates(ARM, STATES, offers)


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
    own = {e.name: e for c in candidates(ARM, STATES) for e in c.effects}
    both = {e.name: e for c in candidates(ARM, STATES, (MINE, *catalogue)) for e in c.effects}
    assert own.items() <= both.items()
    assert all(np.isfinite(t.basis(STATES)).all() for name in both.keys() - own.keys() for t in both[name].terms)

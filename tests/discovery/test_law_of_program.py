"""What was evolved and chosen, alone or in several parts at one place, gives way to the law of its inputs there."""

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from effect_cases import bare, measure, mechanism

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration
from gpmodel.discovery import additive as together
from gpmodel.discovery import compact
from gpmodel.discovery.additive import Additive, additive
from gpmodel.discovery.choice import Choice
from gpmodel.discovery.compact import compact_laws, replacement
from gpmodel.discovery.one_place import of_one_place
from gpmodel.discovery.search import Search
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import residual_of
from gpmodel.evidence.score import scores
from gpmodel.evolution.pareto import Solution, scored
from gpmodel.evolution.problems import SlotProblem
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression
from gpmodel.formula.parse import parse
from gpmodel.model.effect import effect_at
from gpmodel.model.error_model import ErrorModel
from gpmodel.model.sites import geometric_effects

ARM, COUNT = "irb6400r", 60
TRUE, AWKWARD = "tanh(8*(J4 - 0.7))", "tanh(exp(4*J4 - 2.8) - reciprocal(exp(4*J4 - 2.8)))"


def chosen(fresh: bool) -> Additive:
    """Of a robot whose fourth drive turns over, for which a program of more nodes was evolved."""
    arm = mechanism(ARM)
    truth = measure(
        ARM, [effect_at("turn", "J4.moving", "Rz", Expression(TRUE))], [2e-3], 3, dataset=bare(ARM, COUNT, 3)
    )
    geometry = geometric_effects(arm)

    def fit(found: Sequence[Candidate], start: Calibration | None = None) -> Calibration:
        return calibrate(ErrorModel(arm, (*geometry, *(e for c in found for e in c.effects))), truth.poses, start=start)

    program = Candidate("evolved", (effect_at("evolved", "J4.moving", "Rz", Expression(AWKWARD)),), "", 30.0, "evolved")
    names = frozenset({"evolved"}) if fresh else frozenset[str]()
    search, criteria = Search(runs=0, workers=1), Criteria(shuffles=19)
    choice = Choice(fit(()), fit, truth.poses, (), search, criteria, fresh=names)
    return additive(choice, (program,))


@pytest.mark.parametrize("fresh", [True, False])
def test_what_was_evolved_just_now_gives_way_to_the_law_of_its_input(fresh: bool) -> None:
    accepted = [h.candidate for h in chosen(fresh).hypotheses if h.accepted]
    assert [c.inputs for c in accepted] == [("J4",)]
    nodes = Expression(str(accepted[0].effects[0].terms[0].basis)).program.complexity
    assert (nodes < Expression(AWKWARD).program.complexity) == fresh


PRODUCT = "sqrt(J1 + 2.8)*max(J4, 0.4)"
PARTS = "J1*J4", "J4"


def at_one_place(*texts: str, found_by: str = "evolved", slot: str = "J4.moving") -> list[Candidate]:
    return [Candidate(t, (effect_at(t, slot, "Rz", Expression(t)),), "", 20.0, found_by) for t in texts]


def test_an_idle_constant_goes_where_laws_with_poles_hid_what_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the search only a law with a constant that says nothing is left; the law without it saves more."""
    arm, idle = mechanism(ARM), "square(tanh(4*J4 - 2.8) - 0.0001)"
    law = effect_at("law", "J4.moving", "Rz", Expression("square(tanh(4*J4 - 2.8))"))
    truth = measure(ARM, [law], [1e-3], 3, dataset=bare(ARM, 100, 3))
    (curve,) = at_one_place(idle)
    model = ErrorModel(arm, (*geometric_effects(arm), *curve.effects))
    left = residual_of(calibrate(model, truth.poses), truth.poses, Criteria(), 0)

    def found(problem: SlotProblem, site: int, names: Sequence[str]) -> tuple[Solution, ...]:
        return (scored(parse(idle), problem.only(site, names)),)

    monkeypatch.setattr(compact, "laws_at", found)
    ((_, residual, laws),) = compact_laws(left, [curve], Search(workers=1))
    kept = replacement(curve, residual, laws)
    assert kept is not None
    assert "square(tanh(" in kept.candidate.name
    assert kept.program.complexity == parse(idle).complexity - 2
    nodes = [one.program.complexity for one in laws]
    assert nodes == sorted(nodes, reverse=True)


@pytest.mark.long
def test_parts_at_one_place_give_way_to_the_law_that_they_stood_for() -> None:
    """The law of a part alone is searched beside the other part, which has taken some of it."""
    arm = mechanism(ARM)
    law = effect_at("law", "J4.moving", "Rz", Expression(PRODUCT))
    truth = measure(ARM, [law], [1e-3], 3, dataset=bare(ARM, 150, 3))
    parts = at_one_place(*PARTS)
    effects = (*geometric_effects(arm), *(e for c in parts for e in c.effects))
    left = residual_of(calibrate(ErrorModel(arm, effects), truth.poses), truth.poses, Criteria(), 0)
    ((_, whole),) = of_one_place(parts)
    ((curve, residual, laws),) = compact_laws(left, [whole], Search(workers=2))
    found = replacement(curve, residual, laws)
    assert found is not None
    before, after = scores(residual, [whole, found.candidate])
    assert set(found.candidate.inputs) == {"J1", "J4"}
    assert after.nats > before.nats + 100.0


def test_what_is_elsewhere_or_reads_a_third_input_or_is_called_more_is_not_joined() -> None:
    elsewhere = [*at_one_place("J1"), *at_one_place("J2", slot="J5.moving")]
    named = [called("gear_ratio", "J4"), called("joint_compliance", "torque_J4")]
    curve = [called("gear_ratio", "J4"), called("joint_curve", "sin(J4)", "cos(J4)", "sin(2*J4)")]
    for apart in (elsewhere, named, curve, at_one_place("J1", "J2*J3"), at_one_place("J1")):
        assert not list(of_one_place(apart))
    assert [c.name for _, c in of_one_place(at_one_place("sin(J4)", "cos(J4)", "J4"))] == ["sin(J4) and cos(J4) and J4"]


def test_a_curve_and_a_law_at_one_place_are_joined() -> None:
    curve, law = at_one_place("sin(J4)", "cos(J4)")
    curve = replace(curve, effects=tuple(replace(e, prior=1e-3) for e in curve.effects))
    ((names, whole),) = of_one_place([curve, law])
    assert names == ("sin(J4)", "cos(J4)")
    assert [e.prior for e in whole.effects] == [1e-3, np.inf]


def test_what_is_chosen_beside_a_law_is_asked_for_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """After the law of one curve another curve is chosen; what was asked for once is not asked for again."""
    curve, other, law, second = at_one_place("sin(J4)", "sin(J5)", "J4", "J5")
    steps = [chosen_of(curve), chosen_of(law, other), chosen_of(law, second)]
    searched: list[str] = []

    def no_laws(left: object, curves: Sequence[Candidate], search: Search) -> list[object]:
        searched.extend(c.name for c in curves)
        return [(c, None, ()) for c in curves]

    def law_of(curve: Candidate, residual: object, laws: object) -> object:
        found = {"sin(J4)": law, "sin(J5)": second}.get(curve.name)
        return found and SimpleNamespace(simplified=lambda: found)

    monkeypatch.setattr(together, "compact_laws", no_laws)
    monkeypatch.setattr(together, "replacement", law_of)
    monkeypatch.setattr(together, "chosen_again", lambda choice, before, laws: steps[steps.index(before) + 1])
    choice = SimpleNamespace(
        fresh=frozenset({"sin(J4)", "sin(J5)"}), late=lambda: False, search=None, criteria=Criteria(), simplified=True
    )
    said = together._with_laws(choice, steps[0], frozenset())
    assert said.last is steps[-1]
    assert [c.name for c in said.every] == ["J4", "J5"]
    assert searched.count("sin(J4)") == searched.count("sin(J5)") == 1


def chosen_of(*candidates: Candidate) -> SimpleNamespace:
    kept = [SimpleNamespace(determined=1.0, effects=c.effects) for c in candidates]
    return SimpleNamespace(
        candidates={c.name: c for c in candidates}, left=None,
        chosen=SimpleNamespace(kept=kept, likelier_by=lambda other: -1.0),
    )  # fmt: skip


def test_origin_and_scale_of_an_input_count_half_among_laws() -> None:
    """Of laws that save as much the one with an origin stands, until a part more is read."""
    task = SimpleNamespace(problem=SimpleNamespace(parsimony=2.0))
    (curve,) = at_one_place("J4")
    texts = ("sin(J4)", "sin(2*J4)", "sin(2*(J4 - 0.3))", "sin(2*(J4 - 0.3))*abs(J4)")
    assert [compact.ShortLaw(parse(text), task, curve).unread for text in texts] == [0.0, 2.0, 4.0, 4.0]


def called(family: str, *texts: str) -> Candidate:
    effects = tuple(effect_at(text, "J4.moving", "Rz", Expression(text), family=family) for text in texts)
    return Candidate(family, effects, family, 5.0, "catalogue")


@pytest.mark.parametrize(("law", "replaced"), [("J4 + 0.5*sin(2*J4 + 1)", False), ("deadzone(J4 - 0.27)", True)])
def test_parts_with_names_give_way_to_a_law_that_says_more_alone(law: str, replaced: bool) -> None:
    """A gear ratio and an error of two per turn are what they are called, or stand for the play of a gear."""
    arm = mechanism(ARM)
    effect = effect_at("law", "J4.moving", "Rz", Expression(law))
    truth = measure(ARM, [effect], [1e-3], 3, dataset=bare(ARM, 60, 3))
    parts = [called("gear_ratio", "J4"), called("gear_harmonic", "sin(2*J4)", "cos(2*J4)")]
    effects = (*geometric_effects(arm), *(e for c in parts for e in c.effects))
    left = residual_of(calibrate(ErrorModel(arm, effects), truth.poses), truth.poses, Criteria(), 0)
    ((_, whole),) = of_one_place(parts)
    ((_, residual, laws),) = compact_laws(left, [whole], Search(workers=1))
    found = replacement(whole, residual, laws)
    assert (found is not None) == replaced
    assert not replaced or "deadzone" in found.candidate.name


def test_the_law_of_a_curve_is_looked_for_where_the_curve_saves_most() -> None:
    """The two axes are parallel; large errors had been cut short where the curve was evolved."""
    arm = mechanism(ARM)
    law = effect_at("law", "J3.moving", "Rz", Expression("abs(J5 + 0.4)"))
    truth = measure(ARM, [law], [2e-3], 3, dataset=bare(ARM, 100, 3))
    (curve,) = at_one_place("max(J5, -0.4)", slot="J2.moving")
    model = ErrorModel(arm, (*geometric_effects(arm), *curve.effects))
    left = residual_of(calibrate(model, truth.poses), truth.poses, Criteria(), 0)
    ((_, residual, laws),) = compact_laws(left, [curve], Search(workers=1))
    found = replacement(curve, residual, laws)
    assert found is not None
    assert found.candidate.place.slot == "J3.moving"
    assert found.candidate.inputs == ("J5",)


@pytest.mark.parametrize(
    ("text", "inputs"),
    [("J4*last_move_J4*J1", {("J1", "J4"), ("J1", "last_move_J4")}), ("J4*last_move_J4", {("J4",), ("last_move_J4",)}),
     ("J1*J4", {("J1", "J4")})],
)  # fmt: skip
def test_of_one_column_read_in_two_ways_each_is_asked_by_itself(
    text: str, inputs: set[tuple[str, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    arm, asked = mechanism(ARM), set[tuple[str, ...]]()
    truth = measure(ARM, [], [], 3, dataset=bare(ARM, COUNT, 3, in_order=True))
    (curve,) = at_one_place(text)
    model = ErrorModel(arm, (*geometric_effects(arm), *curve.effects))
    left = residual_of(calibrate(model, truth.poses), truth.poses, Criteria(), 0)

    def none(problem: SlotProblem, site: int, names: Sequence[str]) -> tuple[Solution, ...]:
        asked.add(tuple(sorted(names)))
        return ()

    monkeypatch.setattr(compact, "laws_at", none)
    assert not list(compact_laws(left, [curve], Search(workers=1)))
    assert asked == inputs

"""Test the proposal of formulas for selected smooth terms: sites, inputs, number and length."""

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from effect_cases import bare, measure, mechanism

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration
from gpmodel.discovery import choose as choosing
from gpmodel.discovery import formulas as searching
from gpmodel.discovery.choose import Problem, Proposals, choose
from gpmodel.discovery.formulas import curves_of, formulas
from gpmodel.discovery.judge import Judged, judge
from gpmodel.discovery.search import Search
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import Residual, residual_of
from gpmodel.evidence.score import scores
from gpmodel.evolution.pareto import Solution, scored
from gpmodel.evolution.problems import SlotProblem
from gpmodel.families.candidate import Candidate, formula_of
from gpmodel.formula.expression import Expression, parse
from gpmodel.model.effect import Effect, effect_at
from gpmodel.model.error_model import ErrorModel
from gpmodel.model.sites import geometric_effects
from gpmodel.selection.result import Kept

ARM, COUNT = "irb6400r", 60
TRUE, AWKWARD = "tanh(8*(J4 - 0.7))", "tanh(exp(4*J4 - 2.8) - reciprocal(exp(4*J4 - 2.8)))"


def at(text: str, slot: str = "J4.moving", family: str = "") -> Effect:
    return effect_at(text, slot, "Rz", Expression(text), family=family)


def evolved(*texts: str, slot: str = "J4.moving") -> list[Candidate]:
    return [Candidate(t, (at(t, slot),), "", 20.0, "sequence") for t in texts]


def named(family: str, *texts: str) -> Candidate:
    return Candidate(family, tuple(at(text, family=family) for text in texts), family, 5.0, "catalogue")


def left_with(effect: Effect, size: float, poses: int, *candidates: Candidate) -> Residual:
    """Residual of a robot with one effect, calibrated with some candidates."""
    truth = measure(ARM, [effect], [size], 3, dataset=bare(ARM, poses, 3))
    effects = (*geometric_effects(mechanism(ARM)), *(e for c in candidates for e in c.effects))
    return residual_of(calibrate(ErrorModel(mechanism(ARM), effects), truth.poses), truth.poses, Criteria(), 0)


def sites_together(*candidates: Candidate) -> dict[tuple[str, ...], Candidate]:
    """Curves of a selection that are made of several of its groups."""
    kept = [(c, cast(Kept, SimpleNamespace(determined=1.0, effects=c.effects))) for c in candidates]
    return {names: c for names, c in curves_of(kept, frozenset()).items() if len(names) > 1}


def judged(fresh: bool) -> Judged:
    """Test a robot with an undulating fourth drive, for which a longer program was evolved."""
    arm = mechanism(ARM)
    truth = measure(ARM, [at(TRUE)], [2e-3], 3, dataset=bare(ARM, COUNT, 3))
    geometry = geometric_effects(arm)

    def fit(found: Sequence[Candidate], start: Calibration | None = None) -> Calibration:
        return calibrate(ErrorModel(arm, (*geometry, *(e for c in found for e in c.effects))), truth.poses, start=start)

    program = Candidate(
        "evolved", (effect_at("evolved", "J4.moving", "Rz", Expression(AWKWARD)),), "", 30.0, "sequence"
    )
    search, criteria = Search(runs=0, workers=1), Criteria(shuffles=19)
    problem = Problem(fit(()), fit, truth.poses, (), search, criteria)
    fitted, _ = choose(problem, (program,), frozenset({"evolved"} if fresh else ()))
    return judge(problem, fitted, np.random.default_rng(0).normal(0.0, 1.0, 9))


@pytest.mark.long
@pytest.mark.parametrize("fresh", [True, False])
def test_a_program_evolved_just_now_gives_way_to_a_formula_of_its_input(fresh: bool) -> None:
    accepted = [h.candidate for h in judged(fresh).hypotheses if h.accepted]
    assert [c.inputs for c in accepted] == [("J4",)]
    nodes = Expression(str(accepted[0].effects[0].terms[0].basis)).program.complexity
    assert (nodes < Expression(AWKWARD).program.complexity) == fresh


def test_an_idle_constant_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search returns only a formula with a constant that changes nothing."""
    idle = "square(tanh(4*J4 - 2.8) - 0.0001)"
    (curve,) = evolved(idle)
    left = left_with(at("square(tanh(4*J4 - 2.8))"), 1e-3, 100, curve)

    def found(problem: SlotProblem, site: int, names: Sequence[str]) -> tuple[Solution, ...]:
        return (scored(parse(idle), problem.only(site, names)),)

    monkeypatch.setattr(searching, "formulas_at", found)
    laws = list(formulas(left, [curve], Search(workers=1)))
    nodes = [law.program.complexity for law in laws]
    assert nodes == sorted(nodes, reverse=True)
    assert parse(idle).complexity - 2 in nodes


@pytest.mark.long
def test_groups_at_one_site_give_way_to_the_formula_that_they_stood_for() -> None:
    """The formula of one group alone is searched beside the other group, which has taken some of it."""
    parts = evolved("J1*J4", "J4")
    left = left_with(at("sqrt(J1 + 2.8)*max(J4, 0.4)"), 1e-3, 150, *parts)
    (whole,) = sites_together(*parts).values()
    laws = [law.candidate for law in formulas(left, [whole], Search(workers=2))]
    before, *after = scores(left.without(whole.effects), [whole, *laws])
    best = max(range(len(laws)), key=lambda k: after[k].nats)
    assert set(laws[best].inputs) == {"J1", "J4"}
    assert after[best].nats > before.nats + 100.0


def test_groups_at_other_sites_or_of_a_third_input_or_with_more_unknowns_are_not_joined() -> None:
    elsewhere = [*evolved("J1"), *evolved("J2", slot="J5.moving")]
    springs = [named("gear_ratio", "J4"), named("joint_compliance", "torque_J4")]
    curve = [named("gear_ratio", "J4"), named("joint_curve", "sin(J4)", "cos(J4)", "sin(2*J4)")]
    for apart in (elsewhere, springs, curve, evolved("J1", "J2*J3"), evolved("J1")):
        assert not sites_together(*apart)
    assert list(sites_together(*evolved("sin(J4)", "cos(J4)", "J4"))) == [("sin(J4)", "cos(J4)", "J4")]


def test_a_curve_and_a_formula_at_one_site_are_joined() -> None:
    curve, law = evolved("sin(J4)", "cos(J4)")
    curve = replace(curve, effects=tuple(replace(e, prior=1e-3) for e in curve.effects))
    ((names, whole),) = sites_together(curve, law).items()
    assert names == ("sin(J4)", "cos(J4)")
    assert [e.prior for e in whole.effects] == [1e-3, np.inf]


def test_each_curve_is_asked_for_formulas_once(monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = evolved("sin(J4)", "sin(J5)")
    searched: list[str] = []

    def none(left: object, curves: Sequence[Candidate], search: object) -> list[object]:
        searched.extend(c.name for c in curves)
        return []

    monkeypatch.setattr(choosing, "formulas", none)
    chosen = SimpleNamespace(
        kept=[SimpleNamespace(determined=1.0, effects=c.effects) for c in (first, second)],
        offered=SimpleNamespace(screening=SimpleNamespace(shapes=None)),
    )

    def fitted(selection: Any) -> Any:
        return SimpleNamespace(chosen=selection, candidates={c.name: c for c in (first, second)}, left=None)

    problem = cast(Any, SimpleNamespace(fitted=fitted, late=lambda: False, search=None))
    proposals = Proposals(problem, frozenset({"sin(J4)", "sin(J5)"}))
    assert proposals(cast(Any, chosen)) == ([], frozenset({"sin(J4)", "sin(J5)"}))
    assert proposals(cast(Any, chosen)) == ([], frozenset())
    assert searched.count("sin(J4)") == searched.count("sin(J5)") == 1


@pytest.mark.long
def test_the_formula_of_a_curve_is_searched_where_the_curve_has_its_largest_gain() -> None:
    """The two axes are parallel; large errors had been cut short where the curve was evolved."""
    (curve,) = evolved("max(J5, -0.4)", slot="J2.moving")
    left = left_with(at("abs(J5 + 0.4)", "J3.moving"), 2e-3, 100, curve)
    laws = [law.candidate for law in formulas(left, [curve], Search(workers=1))]
    nats = [score.nats for score in scores(left.without(curve.effects), laws)]
    best = laws[int(np.argmax(nats))]
    assert best.place.slot == "J3.moving"
    assert best.inputs == ("J5",)


@pytest.mark.parametrize(
    ("text", "inputs"),
    [("J4*last_move_J4*J1", {("J1", "J4"), ("J1", "last_move_J4")}), ("J4*last_move_J4", {("J4",), ("last_move_J4",)}),
     ("J1*J4", {("J1", "J4")})],
)  # fmt: skip
def test_of_one_column_read_in_two_ways_each_is_asked_by_itself(
    text: str, inputs: set[tuple[str, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = set[tuple[str, ...]]()
    truth = measure(ARM, [], [], 3, dataset=bare(ARM, COUNT, 3, in_order=True))
    (curve,) = evolved(text)
    model = ErrorModel(mechanism(ARM), (*geometric_effects(mechanism(ARM)), *curve.effects))
    left = residual_of(calibrate(model, truth.poses), truth.poses, Criteria(), 0)

    def none(problem: SlotProblem, site: int, names: Sequence[str]) -> tuple[Solution, ...]:
        asked.add(tuple(sorted(names)))
        return ()

    monkeypatch.setattr(searching, "formulas_at", none)
    assert not list(formulas(left, [curve], Search(workers=1)))
    assert asked == inputs


@pytest.mark.parametrize(
    ("makers", "expected"),
    [
        (("catalogue",), "formula"),
        (("smooth term",), "formula"),
        (("formula", "named"), "formula"),
        (("sequence",), "formula of a program"),
        (("smooth term", "tree"), "formula of a program"),
        (("formula of a program",), "formula of a program"),
        (("a representation of a user",), "formula of a program"),
    ],
)
def test_a_formula_says_whether_it_replaces_an_evolved_program(makers: tuple[str, ...], expected: str) -> None:
    parts = [replace(c, found_by=m) for c, m in zip(evolved("sin(J4)", "cos(J4)"), makers, strict=False)]
    assert formula_of(makers) == expected
    together = sites_together(*parts, replace(*evolved("J4"), found_by="formula"))
    assert [c.found_by for c in together.values()] == [expected]

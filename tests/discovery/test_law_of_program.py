"""A program that was evolved and chosen gives way to the shorter law of its inputs at its place."""

from collections.abc import Sequence

import pytest
from effect_cases import bare, measure, mechanism

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration
from gpmodel.discovery.additive import Additive, Choice, additive
from gpmodel.discovery.search import Search
from gpmodel.evidence.criteria import Criteria
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression
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

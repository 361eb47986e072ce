"""Another formula of a front takes the place of a finding's."""

from dataclasses import replace
from pathlib import Path

import pytest

import gpmodel as gp
from gpmodel.api.saved import SavedResult
from gpmodel.cli.calibrate import found_in
from gpmodel.errors import InputError
from gpmodel.report.explain import explain
from gpmodel.report.schema_search import FormulaRecord

FRONT = (
    FormulaRecord("J5", 1, 40.0),
    FormulaRecord("tanh(2*J5)", 2, 90.0, taken=True),
    FormulaRecord("sin(J5)", 2, 9.0),
)


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> SavedResult:
    """A calibration with a compliance and a formula that has a front."""
    arm = gp.load_mechanism("irb6400r", payload="60 kg")
    truth = ["joint_compliance J2=1e-6", "J3.moving:Ry:tanh(2*J5)=0.3 mrad"]
    made = gp.simulate(arm, truth, poses=40, seed=2)
    folder = tmp_path_factory.mktemp("front")
    done = gp.calibrate(arm, made.table, ["joint_compliance J2", "J3.moving:Ry:tanh(2*J5)"], holdout=0.0)
    effects = (done.record.effects[0], replace(done.record.effects[1], front=FRONT))
    done.model.save(folder / "model.json")
    return SavedResult(folder, replace(done.record, effects=effects))


def test_a_formula_of_the_front_takes_the_place_of_the_finding(result: SavedResult) -> None:
    first, second = result.effects()
    assert result.effects(formula=1)[0] == first
    other = result.effects(formula=1)[1]
    assert [str(term.basis) for term in other.terms] == ["J5"]
    assert [(t.slot, t.axis, t.weight) for t in other.terms] == [(t.slot, t.axis, t.weight) for t in second.terms]
    assert result.effects(formula=3, finding=2)[1].name == "sin(J5) on J3.moving Ry"


@pytest.mark.parametrize(
    ("formula", "finding", "said"),
    [
        (4, None, "4, expected 1 to 3"),
        (0, 2, "0, expected 1 to 3"),
        (1, 1, "finding 1: no formula"),
        (1, 7, "that has: 2"),
    ],
)
def test_a_formula_or_finding_that_is_not_there_is_refused(
    result: SavedResult, formula: int, finding: int | None, said: str
) -> None:
    with pytest.raises(InputError, match=said):
        result.effects(formula, finding)


def test_the_explanation_counts_the_formulas(result: SavedResult) -> None:
    assert any("number 2 of 3" in fact for fact in explain(result.record, 2).facts)
    assert not any("number 2 of 3" in fact for fact in explain(result.record, 1).facts)


@pytest.mark.parametrize("written", ["x", "=", "1=", "a=2", "1=2=3", "-1"])
def test_a_formula_is_asked_for_by_numbers(written: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected K or N=K"):
        found_in(tmp_path, written)


def test_a_formula_is_of_a_result() -> None:
    assert found_in(None, None) == ()
    with pytest.raises(InputError, match="expected --findings as well"):
        found_in(None, "2")

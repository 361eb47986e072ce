"""Test formulas of the Pareto front, user-defined families, few poses, rows of outliers, and `gp.regress`."""

import inspect
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import numbers, table
from spherical_cases import JOINT, OFFSETS

import gpmodel as gp
from experiments.spherical_joint.rig import Rig
from gpmodel.api.regress import Regression
from gpmodel.api.saved import SavedResult
from gpmodel.calibration.result import without_outlier_marks
from gpmodel.cli.calibrate import found_in
from gpmodel.errors import InputError
from gpmodel.evolution.code import Scores
from gpmodel.evolution.regression import Law
from gpmodel.formula.expression import parse
from gpmodel.report.explain import explain
from gpmodel.report.saved import read_report
from gpmodel.report.schema import Report
from gpmodel.report.schema_search import FormulaRecord
from gpmodel.table.cells import frame_of, joint_table

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
        (1, 7, "a finding with formulas: 2"),
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
    with pytest.raises(InputError, match="expected --findings RESULT too"):
        found_in(None, "2")


ARM = gp.load_mechanism("irb6400r")
CABLE = gp.simulate(ARM, ["J4.moving:Ry:sin(J4)*tanh(temperature-25)=0.5 mrad"], poses=90, seed=4,
                    inputs={"temperature [degC]": "20:30"})  # fmt: skip
QUICK = gp.Search(runs=1, population=64, generations=6)


def cable_drag(mechanism: gp.Mechanism, states: gp.States) -> Iterator[gp.Effect]:
    for joint in mechanism.joints[3:]:
        shape = gp.Expression(f"sin({joint.name})*tanh(temperature-25)")
        yield gp.effect_at(f"cable drag, {joint.name}", f"{joint.name}.moving", "Ry", shape)


FAMILY = gp.Family("cable_drag", "a stiff cable pulls at the wrist", "own measurements, 2024", cable_drag)


@dataclass(frozen=True)
class Roulette:
    """Parents in proportion to what they explain (Holland 1975); the best `kept` of them live on."""

    kept: int = 8

    def eligible(self, population: int) -> int:
        return population

    def parents(self, scores: Scores, rng: np.random.Generator) -> np.ndarray:
        fit = np.where(np.isfinite(scores.score), scores.score, np.inf)
        worth = np.maximum(np.max(fit[np.isfinite(fit)], initial=0.0) - fit, 0.0)
        worth = np.where(np.isfinite(worth), worth, 0.0) + 1e-12
        return rng.choice(len(worth), (2, len(worth)), p=worth / worth.sum())

    def survivors(self, scores: Scores, population: int) -> np.ndarray:
        best = np.argsort(scores.score[:population], kind="stable")[: self.kept]
        young = population + np.argsort(scores.score[population:], kind="stable")[: population - self.kept]
        return np.concatenate([best, young])


def test_they_are_as_short_as_is_promised() -> None:
    assert len(inspect.getsource(cable_drag).splitlines()) + 1 <= 10
    assert len(inspect.getsource(Roulette).splitlines()) <= 30


@pytest.mark.long
def test_a_family_from_outside_is_found_named_and_explained() -> None:
    found = gp.discover(ARM, CABLE.table, holdout=0.3, candidates=(*gp.catalogue, FAMILY), search=QUICK)
    assert [(f.name, f.catalogue) for f in found.findings] == [("cable drag, J4", "cable_drag")]
    assert found.findings[0].explanation == "a stiff cable pulls at the wrist (own measurements, 2024)"
    assert found.findings[0].value == pytest.approx(5e-4, abs=5 * found.findings[0].stderr)


@pytest.mark.long
def test_the_loop_evolves_with_a_selection_scheme_from_outside() -> None:
    search = gp.Search(runs=4, population=256, generations=20, selection=Roulette())
    made = gp.simulate(ARM, ["J4.moving:Rx:tanh(3*sin(J4))*J2=0.5 mrad"], poses=90, seed=4)
    found = gp.discover(ARM, made.table, holdout=0.3, candidates=(), search=search)
    assert found.findings[0].slot == "J4.moving"
    assert "J4" in found.findings[0].inputs
    assert found.record.ladder[-1].heldout.rms_mm < 0.6 * found.record.ladder[1].heldout.rms_mm


def touched(instrument: str, column: str, value: str, folder: Path) -> Path:
    """A table of touches with one column wrong."""
    frame = gp.simulate("ur5", poses=90, instrument=instrument, geometry_sigma="0.3 mm", seed=1).to_dataframe()
    frame[column] = value
    frame.to_csv(folder / "touched.csv", index=False)
    return folder / "touched.csv"


@pytest.mark.long
def test_wrong_labels_are_named_in_the_verdict(tmp_path: Path) -> None:
    verdict = gp.calibrate("ur5", touched("spheres", "on_sphere", "A", tmp_path)).verdict
    assert "touched.csv: residual of the fit: " in verdict
    assert (
        "mm RMS; calibrated machines have less than 2 mm. Possible causes: a wrong label or length (on_sphere)"
        in verdict
    )


@pytest.mark.long
def test_a_bar_of_another_length_is_refused(tmp_path: Path) -> None:
    with pytest.raises(gp.InputError, match=r"touched\.csv, column 'pair': does not fit ur5"):
        gp.calibrate("ur5", touched("bar", "length [mm]", "3000", tmp_path))


def test_a_fit_that_is_as_of_a_machine_says_nothing_of_it(tmp_path: Path) -> None:
    made = gp.simulate("ur5", poses=40, geometry_sigma="0.3 mm", seed=1)
    assert "the fit leaves" not in gp.calibrate("ur5", made.table).verdict


def test_a_label_touched_along_one_circle_is_said_with_its_file(tmp_path: Path) -> None:
    frame = gp.simulate("ur5", poses=90, instrument="spheres", seed=1).to_dataframe()
    frame.loc[frame.on_sphere == "B", frame.columns[:6]] = (
        frame.loc[frame.on_sphere == "B", frame.columns[:6]].iloc[:1].to_numpy()
    )
    frame.to_csv(tmp_path / "touched.csv", index=False)
    with pytest.raises(gp.InputError, match=r"touched\.csv: on_sphere B"):
        gp.calibrate("ur5", tmp_path / "touched.csv")


SPOILED = (7, 36, 61)
"""Rows of the table, from 1."""


@cache
def spoiled() -> pd.DataFrame:
    frame = table(70, name="ur5")
    for row in SPOILED:
        frame.loc[row - 1, "x [mm]"] = f"{numbers(frame, 'x [mm]')[row - 1] + 5.0:.6f}"
    return frame


COMMANDS: dict[str, Callable[[], Report]] = {
    "calibrate": lambda: gp.calibrate("ur5", spoiled()).record,
    "discover": lambda: (
        gp.discover("ur5", spoiled(), holdout=0.3, search=gp.Search(runs=0), candidates=gp.catalogue[:1]).record
    ),
    "evolve": lambda: gp.evolve("ur5", spoiled(), space="slot", runs=1, population=16, generations=1, workers=1).record,
}


SLOW = pytest.param("discover", marks=pytest.mark.long)


@pytest.mark.long
@pytest.mark.parametrize("command", [SLOW if command == "discover" else command for command in COMMANDS])
def test_outliers_are_rows_of_the_table(command: str) -> None:
    assert set(COMMANDS[command]().data.outliers) == set(SPOILED)


def test_a_fit_to_training_poses_names_what_it_left_out_though_the_final_fit_did_not() -> None:
    """The errors of the ladder are those of the fit to training poses."""
    made = gp.calibrate("ur5", spoiled()).calibrated
    ladder = replace(made, final=without_outlier_marks(made.final))
    rows = made.poses.dataset.row[ladder.outliers].tolist()
    assert rows == [row for row in SPOILED if row - 1 in made.train]


@pytest.mark.long
def test_a_compensator_has_the_poses_of_the_fit() -> None:
    """Otherwise it gains by taking back what the fit gave up on the poses it left out."""
    result = gp.evolve("ur5", spoiled(), runs=1, population=40, generations=1, workers=1)
    left_out = np.isin(result.start.poses.dataset.row[result.start.train], SPOILED)
    assert left_out.any()
    assert result.fit.outliers.tolist() == np.flatnonzero(left_out).tolist()
    made = result.record.compensation
    assert made is not None
    assert [len(values) for values in made.values] == [np.count_nonzero(~left_out)] * 3


@pytest.mark.long
def test_ten_poses_after_a_calibration_tell_a_constant_from_what_it_could_be(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    rig = Rig(JOINT, parameters=OFFSETS)
    first = rig.poses(31, rng)
    gp.calibrate("spherical-joint", frame_of(rig.measure(first, rng), JOINT)).report(tmp_path)
    (mimic,) = read_report(tmp_path).mimics
    chosen = gp.choose_poses(count=10, after=tmp_path, criterion="rivals")
    assert f"{mimic.constant} or {mimic.rival}" in chosen.said
    task = joint_table(JOINT, first[:5])
    for_task = gp.choose_poses(count=10, after=tmp_path, task=task)
    assert f"5 targets of data frame; {mimic.constant} or {mimic.rival}" in for_task.said
    more = rig.measure(np.vstack([first, chosen.q]), np.random.default_rng(1))
    assert mimic not in gp.calibrate("spherical-joint", frame_of(more, JOINT)).record.mimics


RNG = np.random.default_rng(2)
FRAME = pd.DataFrame({"load": RNG.uniform(1, 3, 60), "oil temp": RNG.uniform(1, 3, 60), "idle": RNG.uniform(1, 3, 60)})
LAW = 3.0 * FRAME["load"] * np.exp(-FRAME["oil temp"])


@pytest.mark.long
def test_a_law_is_found_exactly_and_holds_on_rows_it_never_saw() -> None:
    found = gp.regress(FRAME, LAW, seconds=60, seed=1)
    assert set(found.best.program.inputs) == {"load", "oil temp"}
    new = pd.DataFrame(RNG.uniform(1, 3, (20, 3)), columns=list(FRAME))
    np.testing.assert_allclose(found.predict(new), 3.0 * new["load"] * np.exp(-new["oil temp"]), rtol=1e-9)
    np.testing.assert_allclose(
        found.expression.program.evaluate({n: new[n].to_numpy() for n in new})[0], found.predict(new), rtol=1e-9
    )
    again = gp.regress(FRAME.to_numpy(), LAW.to_numpy(), names=list(FRAME), seconds=60, seed=1)
    assert [str(law.program) for law in again.laws] == [str(law.program) for law in found.laws]


@pytest.mark.long
def test_the_front_goes_from_short_to_close_and_marks_the_law_of_least_description_length(tmp_path: Path) -> None:
    noisy = LAW + np.random.default_rng(0).normal(0, 0.02, len(LAW))
    found = gp.regress(FRAME, noisy, seconds=1.5)
    frame = found.to_dataframe()
    assert len(frame) > 1
    assert frame["length"].is_monotonic_increasing
    assert frame["r_squared"].is_monotonic_increasing
    assert frame["nats"][frame["best"]].tolist() == [frame["nats"].min()]
    residual = noisy - found.predict(FRAME, int(frame.index[-1]))
    assert frame["rms"].iloc[-1] == pytest.approx(np.sqrt(np.mean(residual**2)), rel=1e-6)
    assert len(found.summary().splitlines()) == len(frame) + 1
    found.save(tmp_path / "laws.json")
    assert [row["law"] for row in json.loads((tmp_path / "laws.json").read_text())["laws"]] == frame["law"].tolist()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"y": LAW[:-1]}, "y: has shape (59,); expected one number for each of the 60 rows"),
        ({"y": LAW * 0}, "response"),
        ({"y": LAW.where(LAW.index != 7)}, "y: not finite in row 7"),
        ({"X": FRAME.assign(name="a")}, "X: column 'name' holds no numbers"),
        ({"X": FRAME.to_numpy(), "names": ["a"]}, "X: 3 columns, expected 1: a"),
        ({"X": FRAME.reindex([0, 1, 2, 99, *range(4, 60)])}, "column 'load' is not finite in row 3"),
        ({"X": FRAME[:3], "y": LAW[:3]}, "X: 3 rows, expected 5 or more"),
        ({"X": [["a"]]}, "X: [['a']], expected numbers"),
        ({"seconds": -1}, "seconds: -1"),
        ({"names": ["load", "speed"]}, "X: no column 'speed'; available: load, oil temp, idle"),
        ({"X": FRAME.to_numpy() + 0j}, "X: complex numbers, expected real numbers"),
        ({"X": FRAME.assign(idle=1j)}, "X: column 'idle' holds no numbers, expected real numbers"),
        ({"y": LAW + 1j}, "y: complex numbers, expected real numbers"),
        ({"y": np.ma.masked_greater(LAW.to_numpy(), LAW[4] - 1e-9)}, "y: not finite in row"),
        ({"X": FRAME.assign(idle=1e200)}, "X: column 'idle' is 1e+200 in row 0"),
        ({"y": 1e200 * LAW}, "in row 0, expected numbers up to 1e+100"),
    ],
)
def test_bad_input_is_one_line(change: dict[str, object], said: str) -> None:
    with pytest.raises(gp.InputError) as error:
        gp.regress(**{"X": FRAME, "y": LAW, "seconds": 0.1, **change})
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_a_row_of_other_columns_and_a_law_that_is_not_there_are_refused() -> None:
    found = gp.regress(FRAME, LAW, seconds=0.5)
    with pytest.raises(gp.InputError, match="no column 'load'"):
        found.predict(FRAME[["idle"]])
    with pytest.raises(gp.InputError, match="X: column 'oil temp' is not finite in row 0"):
        found.predict(FRAME[:1].assign(**{"oil temp": np.nan}))
    with pytest.raises(gp.InputError, match="law: 99, expected 0 to"):
        found.predict(FRAME, 99)


def test_a_prediction_is_nan_where_the_formula_is_not_defined() -> None:
    law = Law(parse("1/a + b"), 0.0, 0.0)
    predicted = Regression((law,), ("a", "b"), 1.0, 1.0).predict([[0.0, 1.0], [2.0, 1.0]])
    np.testing.assert_array_equal(predicted, [np.nan, 1.5])

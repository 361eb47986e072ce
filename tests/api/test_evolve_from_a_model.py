"""Test that evolution starts from named effects or from a saved model."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from fleet_cases import machines

import gpmodel as gp
from gpmodel.api.evolve import EvolutionResult
from gpmodel.report.page import pictures
from gpmodel.table.dataset import Dataset

ARM, BASE, JOINT = "irb6400r", "base_compliance", "joint_compliance J2"


@cache
def table() -> Dataset:
    """An arm whose base and joint 2 yield."""
    return machines(0, 1)["R-01"]


def evolved(of: Dataset | None = None, **asked: object) -> EvolutionResult:
    asked = {"strategies": (gp.Linear(),), "runs": 1, "population": 40, "generations": 2, "space": "slot", **asked}
    return gp.evolve(ARM, of or table(), workers=1, **asked)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "effects", [(BASE,), *(pytest.param(of, marks=pytest.mark.long) for of in ((), (BASE, JOINT)))]
)
def test_the_residual_is_that_of_the_model_with_its_effects(effects: tuple[str, ...]) -> None:
    report = evolved(effects=effects).record
    expected = gp.calibrate(ARM, table(), effects).record
    assert len(report.effects) == len(effects)
    assert report.ladder[-1].heldout.rms_mm == pytest.approx(expected.ladder[-1].heldout.rms_mm, rel=1e-6)
    assert report.verdict.startswith("Given ") == bool(effects)


@pytest.mark.long
@pytest.mark.parametrize("saved", [False, True])
def test_a_saved_model_is_what_its_effects_are(saved: bool, tmp_path: Path) -> None:
    model = gp.calibrate(ARM, table(), [BASE]).model
    model.save(tmp_path / "model.json")
    found = evolved(model=tmp_path / "model.json" if saved else model, effects=[JOINT])
    named = evolved(effects=[BASE, JOINT])
    assert [e.name for e in found.record.effects] == [e.name for e in named.record.effects]
    assert found.fit.error == pytest.approx(named.fit.error)
    assert [run.program for run in found.runs] == [run.program for run in named.runs]


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"model": "nowhere"}, "nowhere"),
        ({"effects": ["no_such"]}, "no_such"),
        ({"effects": [BASE, BASE]}, "appears twice"),
        ({"model": "that", "standard": ("J*",)}, "standard: patterns cannot be combined with a model"),
    ],
)
def test_what_is_no_model_or_effect_is_refused(asked: dict[str, object], message: str) -> None:
    with pytest.raises(gp.InputError, match=message):
        evolved(**asked)


@pytest.mark.long
def test_the_page_has_fitness_operators_and_the_best_program_over_its_inputs() -> None:
    asked = {"strategies": (gp.Linear.thesis(),), "runs": 1, "workers": 1}
    result = gp.evolve(ARM, table(), **asked, population=4000, generations=60, seed=2)
    best, report = result.best, result.record
    assert {"fitness", "operators", "compensation"} <= {p.name for p in pictures(report)}
    used = {name for counts in report.histograms[0].operators.values() for name in counts}
    assert all(name in result.summary() for name in used)
    gain = max(run.gain for run in result.runs if not run.shuffled)
    shift, error = np.array(best.values, dtype=float), _errors(result)
    assert 1.0 - np.linalg.norm(error - shift, axis=0).max() / np.linalg.norm(error, axis=0).max() == pytest.approx(
        gain, abs=1e-4
    )
    nothing = gp.evolve(ARM, table(), **asked, population=200, generations=3)
    assert max(run.gain for run in nothing.runs) == 0.0
    assert {"operators", "compensation"}.isdisjoint(p.name for p in pictures(nothing.record))


def _errors(result: EvolutionResult) -> np.ndarray:
    """Measured less modelled points (3, N) of the training poses, mm, in the root frame."""
    from gpmodel.application.compensator import cartesian_problem

    problem = cartesian_problem(result.fit, result.start.poses, result.start.train)
    return np.asarray(problem.measured - problem.inputs.select(("x", "y", "z")).values)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
def test_a_tree_is_never_worse_than_no_compensation(seed: int) -> None:
    found = gp.evolve(ARM, table(), strategies=(gp.Tree.thesis(),), runs=1, population=60, generations=2, workers=1,
                      seed=seed)  # fmt: skip
    assert len(found.runs) == 2
    assert all(run.gain >= 0.0 for run in found.runs)


@pytest.mark.first(1)
@pytest.mark.parametrize("asked", [{"space": "cartesian", "norm": "max"}, {"space": "cartesian", "norm": "rms"}, {}])
def test_gross_errors_are_left_out_of_training_and_held_out_poses(asked: dict[str, object]) -> None:
    data, clean = table(), evolved(**asked)
    train, held = clean.start.train[[3, 9]], np.setdiff1d(np.arange(len(data)), clean.start.train)[[1]]
    position = data.position.copy()
    position[[*train, *held], [0, 1, 2]] += [0.02, -0.035, 0.008]
    result = evolved(replace(data, position=position), **asked)
    assert result.record.data.outliers == tuple(sorted(data.row[[*train, *held]].tolist()))
    for kind in ("train", "heldout"):
        found, expected = (getattr(of.record.ladder[-1], kind).rms_mm for of in (result, clean))
        assert found == pytest.approx(expected, rel=0.15)
    if asked:
        assert all(run.heldout > -1.0 for run in result.record.runs if not run.shuffled)
    assert "3 of" in result.summary()

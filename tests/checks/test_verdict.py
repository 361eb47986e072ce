"""The sentence that a check ends with."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from cli_cases import robot

from gpmodel.api.check import check
from gpmodel.model.effect import effect_at
from gpmodel.model.error_model import ErrorModel, observe, prepare
from gpmodel.planning.simulate import Simulation
from gpmodel.table.dataset import Dataset


def longer(made: Simulation) -> Dataset:
    arm = made.model.mechanism
    model = ErrorModel(arm, (*made.model.effects, effect_at("longer", "J2.moving", "Tz")))
    tip = observe(model, prepare(arm, made.dataset), np.append(made.theta, 0.0496), made.placement).tip
    return replace(made.dataset, position=tip[:, :3, 3])


def noisy(made: Simulation) -> Dataset:
    off = np.random.default_rng(0).normal(0.0, 0.05, 60)[:, None] * np.array([1.0, 0.0, 0.0])
    return replace(made.dataset, position=made.dataset.position + off)


VERDICTS: dict[str, tuple[Callable[[Simulation], Dataset], tuple[str, ...]]] = {
    "sound": (lambda made: made.dataset, ()),
    "another arm": (longer, ("irb6400r is not described as it was measured",)),
    "50 mm of noise in x": (noisy, ("the standard model leaves too much",)),
    "none to hold out": (lambda made: made.dataset.subset(np.arange(12)), ("too few poses",)),
}


@pytest.mark.long
@pytest.mark.parametrize("case", VERDICTS)
def test_the_verdict_says_why_a_table_is_not_fit_to_calibrate_with(case: str) -> None:
    make, why = VERDICTS[case]
    arm, made = robot(60)
    judged = check(arm, make(made))
    assert judged.unfit == why
    assert any("yield under load" in remark.text for remark in judged.findings) is (make is noisy)
    verdict = judged.summary().splitlines()[-1]
    assert verdict.startswith(f"not fit to calibrate with: {why[0]}; " if why else "fit to calibrate with")


def test_a_soft_robot_is_fit_to_calibrate_with() -> None:
    arm, made = robot(60, effects=("base_compliance=2e-6",))
    judged = check(arm, made.dataset)
    assert judged.unfit == ()
    assert any("With base and joints that yield" in remark.text for remark in judged.findings)


def test_a_bad_robot_is_described_as_it_was_measured_though_parallel_joints_share_its_errors() -> None:
    arm, made = robot(60, 1, "ur3", geometry_sigma=1e-3)
    assert not check(arm, made.dataset).unfit

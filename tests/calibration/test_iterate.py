"""Where the iterations of a fit end."""

from dataclasses import replace

import numpy as np
import pytest
from effect_cases import NOISE, bare, measure, mechanism

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.iterate import STEP_TOLERANCE, Fitting, iterate
from gpmodel.calibration.linearise import linearise
from gpmodel.calibration.priors import GEOMETRY_REACH, beliefs
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import drive_effect
from gpmodel.model.error_model import ErrorModel, Placement, Poses, observe, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.table.bundles import sharing


@pytest.mark.parametrize("harmonics", [3, 30])
def test_a_fit_ends_where_a_step_on_columns_of_that_very_point_moves_nothing(harmonics: int) -> None:
    """Columns stay as they are over the last steps, and so many effects are solved by normal equations."""
    curves = tuple(
        drive_effect(f"{f} {k} {j.name}", j, Expression(f"{f}({k}*{j.name})"), prior=1e-4 / k)
        for j in mechanism("ur5").joints[1:3]
        for k in range(1, harmonics + 1)
        for f in ("sin", "cos")
    )
    truth = measure("ur5", curves[:6], 1e-4 * np.ones(6), 4, count=60)
    model = ErrorModel(truth.model.mechanism, (*truth.model.effects, *curves[6:]))
    fit = calibrate(model, truth.poses, robust=False)
    problem = linearise(model, truth.poses, fit.theta, fit.placement, fit.rotation_weight, np.ones(60, dtype=bool))
    free = np.concatenate([np.ones(problem.placement, dtype=bool), fit.kept])
    known = beliefs(model, problem, fit.theta, fit.placement, fit.kept)
    system = np.vstack([problem.columns, known.rows])[:, free]
    target = np.concatenate([problem.residual, known.pulls])
    scale = np.linalg.norm(system, axis=0)
    step = np.linalg.lstsq(system / scale, target, rcond=1e-12)[0] / scale
    assert fit.status == "converged"
    assert np.abs(problem.columns[:, free] @ step).max() < 2 * STEP_TOLERANCE


def close_to_the_axis(noise: float) -> tuple[ErrorModel, Poses, Placement]:
    """A robot whose tool point is close to the axis of its flange: a twist before it, the offset of the wrist and the
    length of the tool nearly stand for each other."""
    arm, rng = mechanism("ur10"), np.random.default_rng(0)
    model, data = ErrorModel(arm, geometric_effects(arm)), bare("ur10", 60)
    tool = np.eye(4)
    tool[:3, 3] = 1e-4, 3e-4, 0.068
    placement = Placement({"": np.eye(4)}, {"": tool}, {})
    truth = 3e-4 * rng.normal(size=len(model.effects))
    tips = observe(model, prepare(arm, data), truth, placement).tip[:, :3, 3]
    return model, prepare(arm, replace(data, position=tips + rng.normal(0.0, noise, tips.shape))), placement


@pytest.mark.parametrize("twist", [-0.27, 0.1, 0.4])
def test_a_fit_follows_a_valley_that_bends(twist: float) -> None:
    """From the best fit with a wrong twist the way is long, flat and curved."""
    model, poses, placement = close_to_the_axis(NOISE)
    names = [e.name for e in model.effects]
    kept = calibrate(model, poses, robust=False, condition_limit=100.0).kept
    kept[[names.index(f"wrist_{name}") for name in ("1_joint Tz", "2_joint Tx", "2_joint Rx")]] = True
    fitting = Fitting(model, poses, np.ones(len(poses), dtype=bool), 1.0, sharing(poses.dataset))
    start = np.where(np.array(names) == "wrist_2_joint Rx", twist, 0.0)
    astray = iterate(fitting, start, placement, kept & (start == 0.0))
    found = iterate(fitting, astray.theta, astray.placement, kept)
    assert found.status == "converged"
    assert np.sqrt(np.mean(found.problem.residual**2)) < NOISE
    assert abs(found.theta[names.index("wrist_2_joint Rx")]) < 0.01


def test_what_the_poses_hardly_show_stays_near_the_description() -> None:
    """By poses measured to a millimetre the twist is known to half a radian, by its description to ten milliradians."""
    model, poses, placement = close_to_the_axis(1e-3)
    fit = calibrate(model, poses, robust=False, condition_limit=1e4)
    at = [e.name for e in model.effects].index("wrist_2_joint Rx")
    assert fit.kept[at]
    assert abs(fit.theta[at]) < 3 * GEOMETRY_REACH
    assert fit.stderr[at] < 1.2 * GEOMETRY_REACH
    assert np.linalg.norm(fit.placement.tool[""][:3, 3] - placement.tool[""][:3, 3]) < 0.01

"""Where the iterations of a fit end."""

import numpy as np
import pytest
from effect_cases import measure, mechanism

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.iterate import STEP_TOLERANCE
from gpmodel.calibration.linearise import linearise
from gpmodel.calibration.priors import prior_rows, tool_rows
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import drive_effect
from gpmodel.model.error_model import ErrorModel


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
    rows, pull = prior_rows(model, fit.theta, problem, fit.kept)
    tool, tool_pull = tool_rows(problem, fit.placement)
    system = np.vstack([problem.columns, rows, tool])[:, free]
    target = np.concatenate([problem.residual, pull, tool_pull])
    scale = np.linalg.norm(system, axis=0)
    step = np.linalg.lstsq(system / scale, target, rcond=1e-12)[0] / scale
    assert fit.status == "converged"
    assert np.abs(problem.columns[:, free] @ step).max() < 2 * STEP_TOLERANCE

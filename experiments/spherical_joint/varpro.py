"""Variable projection: every pose's angles eliminated from the linear problem, then solved.

The engine's own linearisation does both, so each iteration is one Gauss-Newton step on what the angles leave.
Source: Golub and Pereyra (1973).
"""

import numpy as np

from experiments.spherical_joint.solution import Progress, Solution, error_of, truncated_step, verdict
from gpmodel.calibration.linearise import linearise
from gpmodel.calibration.placing import placement_after
from gpmodel.calibration.start import start_placement
from gpmodel.calibration.unmeasured_joints import check_points
from gpmodel.model.error_model import ErrorModel, Placement, Poses

ROUNDING = 1e-9


def variable_projection(
    model: ErrorModel, poses: Poses, *, start: Placement | None = None, limit: int = 50, tolerance: float = 1e-10
) -> Solution:
    """Registration, tooling ball and the model's effects from approximate angles and measured positions.

    start: registration and tooling ball to go on from; what the angles absorb, as the turn of the registration, stays
    as it is there. limit: iterations. tolerance: m, of the largest motion of a position. Raises InputError for fewer
    than 4 different poses or points in one plane.
    """
    check_points(poses.dataset)
    placement, theta = start or start_placement(poses), np.zeros(len(model.effects))
    use = np.ones(len(poses), dtype=bool)
    history: list[Progress] = []
    problem = linearise(model, poses, theta, placement, 1.0, use)
    ended = None
    while ended is None:
        step, moved = truncated_step(problem, ROUNDING)
        history.append(Progress(float(np.sqrt(np.mean(error_of(problem) ** 2))), moved))
        placement = placement_after(problem.observed, placement, step[: problem.placement])
        theta = theta + step[problem.placement :]
        problem = linearise(model, poses, theta, placement, 1.0, use)
        ended = verdict(history, tolerance, limit)
    return Solution(placement, theta, problem.poses, error_of(problem), tuple(history), *ended)

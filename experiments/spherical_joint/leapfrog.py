"""The leap-frog solver: parameters from the angles, angles from the parameters, in turn, until both stand still.

Source: Robertson (2003), Figures 3.16 and 3.17. The plain 1/S update diverges, because a pose's three angles move the
tooling ball in two directions only: both halves truncate small singular values.
"""

import numpy as np

from experiments.spherical_joint.solution import Progress, Solution, error_of, truncated_step, verdict
from gpmodel.calibration.linearise import linearise
from gpmodel.calibration.placing import placement_after
from gpmodel.calibration.start import start_placement
from gpmodel.calibration.unmeasured_joints import check_points, solve_joints
from gpmodel.model.error_model import ErrorModel, Poses
from joints.passive_joint import PassiveJoint

TRUNCATION = 1e-2


def leap_frog(
    joint: PassiveJoint,
    model: ErrorModel,
    poses: Poses,
    *,
    truncation: float = TRUNCATION,
    limit: int = 6000,
    tolerance: float = 1e-10,
) -> Solution:
    """Solve as variable projection does, by many cheap alternations.

    truncation: of the parameters' singular values. limit, tolerance: as in variable_projection. Raises InputError for
    fewer than 4 different poses or points in one plane.
    """
    check_points(poses.dataset)
    known = ErrorModel(joint.with_angles(measured=True), model.effects)
    placement, theta = start_placement(poses), np.zeros(len(model.effects))
    use = np.ones(len(poses), dtype=bool)
    history: list[Progress] = []
    current, ended = poses, None
    while ended is None:
        problem = linearise(known, current, theta, placement, 1.0, use)
        step, moved = truncated_step(problem, truncation)
        rms = float(np.sqrt(np.mean(error_of(problem) ** 2)))
        placement = placement_after(problem.observed, placement, step[: problem.placement])
        theta = theta + step[problem.placement :]
        before, current = current.dataset.q, solve_joints(model, current, theta, placement)
        swung = float(np.linalg.norm(joint.tooling_ball) * np.abs(current.dataset.q - before).max())
        history.append(Progress(rms, max(moved, swung)))
        ended = verdict(history, tolerance, limit)
    problem = linearise(known, current, theta, placement, 1.0, use)
    return Solution(placement, theta, current, error_of(problem), tuple(history), *ended)

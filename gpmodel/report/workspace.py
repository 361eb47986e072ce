"""How far effects move the tool anywhere it can be, not only where it was measured."""

from collections.abc import Sequence

import numpy as np

from gpmodel.application.exports.sample import at_joint_values
from gpmodel.application.matching import remembered
from gpmodel.application.model_file import saved_model
from gpmodel.application.usable import usable
from gpmodel.calibration.result import Calibration
from gpmodel.errors import InputError
from gpmodel.mechanism.workspace import random_poses
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import Poses, prepare
from gpmodel.report.fitted import statistics_mm, tool_displacements
from gpmodel.report.schema import ErrorsMm

POSES = 400
"""Random joint values within the limits: an RMS over them is known to 4 % (1 / √(2·400))."""


def over_the_workspace(final: Calibration, poses: Poses, groups: Sequence[Sequence[Effect]]) -> tuple[ErrorsMm, ...]:
    """RMS and maximum, mm, of what groups of effects of a fit move the tool by at joint values anywhere within the
    limits.

    Everything else is as in random rows of the table; laws that nobody named keep their value at the edge of the range
    they were fitted in, as `predict` has it. Nothing is said of a mechanism whose joints are not all measured, or where
    the model remembers rows that nobody says are in order.
    """
    if poses.dataset.joints_approximate:
        return (ErrorsMm(),) * len(groups)
    saved, rng = usable(saved_model(final, poses), as_measured=True), np.random.default_rng(0)
    try:
        data = remembered(saved, poses.dataset)
    except InputError:
        return (ErrorsMm(),) * len(groups)
    anywhere = at_joint_values(data, random_poses(saved.mechanism, POSES, rng), rng)
    return tuple(map(statistics_mm, tool_displacements(saved, prepare(saved.mechanism, anywhere), groups)))

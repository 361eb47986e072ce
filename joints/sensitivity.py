"""What each of the thirty parameters of the thesis does to the position of the tooling ball.

Columns are the engine's. With free angles each pose's own angle columns are eliminated first.
Source: Robertson (2003), Table 3.2.
"""

import numpy as np

from gpmodel.arrays import Array
from gpmodel.calibration.linearise import effect_columns
from gpmodel.calibration.unmeasured_joints import eliminate, joint_columns
from gpmodel.model.error_model import ErrorModel, Placement, observe, prepare
from gpmodel.table.dataset import unmeasured
from joints.kinematics import JOINTS, THESIS_PARAMETERS
from joints.passive_joint import PassiveJoint


def thesis_columns(joint: PassiveJoint, q: Array, *, angles_known: bool = True) -> Array:
    """Columns (M, 30) of the position at q (N, 3), m a unit; three rows a pose, fewer with free angles."""
    data = unmeasured(JOINTS, q)
    effects = tuple(p.effect for p in THESIS_PARAMETERS)
    model, poses = ErrorModel(joint, effects), prepare(joint, data)
    observed = observe(model, poses, np.zeros(len(effects)), Placement({"": np.eye(4)}, {"": np.eye(4)}, {}))
    columns = effect_columns(effects, model, poses, observed)[:, :3]
    if angles_known:
        return columns.reshape(3 * len(q), -1)
    return eliminate(columns, np.zeros(columns.shape[:2]), joint_columns(joint, observed)[:, :3])[0]

"""Exports held against `predict` on fresh poses."""

from dataclasses import dataclass, replace

import numpy as np

from gpmodel.application.exports.chain import chain_of
from gpmodel.application.exports.forward import Forward, forward_of
from gpmodel.application.exports.rigid import Rigid
from gpmodel.application.exports.sample import Place
from gpmodel.application.model_file import SavedModel
from gpmodel.arrays import Array
from gpmodel.mechanism.branches import branched
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.model.error_model import ErrorModel, observe, prepare
from gpmodel.numerics import se3
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.table.dataset import Dataset


@dataclass(frozen=True)
class Check:
    """Fresh poses, the inputs (N, k) a forward model reads there, and the points (N, 3) that `predict` gives, m."""

    forward: Forward
    dataset: Dataset
    inputs: Array
    points: Array

    @classmethod
    def against(cls, saved: SavedModel, place: Place, dataset: Dataset) -> "Check":
        """The points of the model without the errors of the instrument and of the session."""
        forward = forward_of(saved, place)
        poses = prepare(saved.mechanism, dataset)
        kept = forward.saved
        points = observe(kept.model, poses, kept.theta, kept.placement).tip[:, :3, 3]
        columns = [dataset.payload if n == "payload" else poses.states[n] for n in forward.inputs]
        return cls(forward, dataset, np.column_stack(columns), points)

    def errors(self, points: Array) -> tuple[float, float]:
        """RMS and largest distance, m, of points (N, 3) from those predicted."""
        off = np.linalg.norm(points - self.points, axis=1)
        return root_mean_square(off), float(off.max())


def read_back_arms(text: str, frames: str, rigid: Rigid, dataset: Dataset) -> Array:
    """The same of a URDF of several arms; frames: the link of each, in the order of the mechanism's own."""
    tree = branched(rigid.fit.model.mechanism)
    assert tree is not None
    mechanism = MechanismChoice("read_back.urdf", frames, description=text).load()
    own = dict(zip(tree.tips, frames.split(","), strict=True))
    tips = np.array([own.get(name, frames.split(",")[0]) for name in dataset.label("tip").tolist()])
    order = [dataset.joints.index(joint.name) for joint in mechanism.joints]
    names = tuple(joint.name for joint in mechanism.joints)
    moved = replace(dataset, joints=names, q=dataset.q[:, order], labels={**dataset.labels, "tip": tips})
    placement = replace(rigid.placement, anchors={})
    bare = ErrorModel(mechanism, ())
    poses = prepare(mechanism, replace(moved, observations=()))
    return observe(bare, poses, np.zeros(0), placement).tip[:, :3, 3]


def read_back(text: str, suffix: str, frame: str | None, rigid: Rigid, dataset: Dataset) -> Array:
    """Points (N, 3) in the instrument's frame of the mechanism in a file of that text, moved as the measured one is:
    a URDF counts the motions themselves where the table has those of a parallel bar."""
    mechanism = MechanismChoice(f"read_back{suffix}", frame, description=text).load()
    moved = dataset.q @ chain_of(rigid.fit.model.mechanism).motions.T
    q: Array = np.linalg.lstsq(chain_of(mechanism).motions, moved.T, rcond=None)[0].T.astype(float)
    flange = se3.chain(mechanism.transforms(q))[-1]
    placed = rigid.placement
    tool = np.stack([placed.tool[name] for name in dataset.label("tool").tolist()])
    register = np.stack([placed.registration[name] for name in dataset.label("setup").tolist()])
    return np.asarray((register @ flange @ tool)[:, :3, 3])

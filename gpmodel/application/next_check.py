"""Check a model pose by pose: select the pose to measure next, and decide when the check ends.

With n poses, each of the two tests of a model has the significance FALSE_ALARM · 6 / (π² k²), k = n - 5. All tests
together report a change for at most one unchanged machine in twenty (union bound, Σ 1/k² = π²/6). A check ends when a
change is significant, or when any change of a joint zero that moves the tool by more than a limit would be significant.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.application.exports.sample import measured_table
from gpmodel.application.model_file import SavedModel
from gpmodel.application.possible_changes import Visible, zero_of
from gpmodel.application.recheck import Session
from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.linearise import effect_columns
from gpmodel.formula.expression import ONE
from gpmodel.model.effect import drive_effect
from gpmodel.model.error_model import Poses, observe, prepare
from gpmodel.planning.poses import spread_among

FALSE_ALARM = 0.05
"""Probability that the check of an unchanged machine ends with a change, over any number of poses."""
FIRST = 6
"""Number of different poses before the first test. With one wrong measurement, five remain for registration and tool.
"""
SEEN = 1e-6
"""Least share of a joint zero's displacement that registration does not absorb. With a smaller share, the poses do not
determine the joint zero."""
SAME = 1e-4
"""Largest difference of joint values of one pose, rad or m."""


@dataclass(frozen=True)
class HiddenChange:
    """A joint whose zero may have changed without being detected. moves: largest resulting displacement of the tool, m,
    RMS over the poses."""

    joint: str
    moves: float


def significance(poses: int) -> float:
    """Return the significance level of each of the two tests for a number of poses."""
    look = max(poses - FIRST + 1, 1)
    return 0.5 * FALSE_ALARM * 6.0 / (math.pi * look) ** 2


@dataclass(frozen=True)
class _Columns:
    """Derivatives of the measured point at each pose by the registration and by the zero of each joint."""

    placed: Array
    zeros: Array

    @staticmethod
    def of(saved: SavedModel, poses: Poses) -> "_Columns":
        observed = observe(saved.model, poses, saved.theta, saved.placement)
        effects = tuple(drive_effect(zero_of(joint.name), joint, ONE) for joint in saved.mechanism.joints)
        points, axes = observed.tip[:, :3, 3], np.eye(3)
        turned = np.stack([np.cross(axis, points) for axis in axes], axis=2)
        placed = np.concatenate([np.broadcast_to(axes, turned.shape), turned], axis=2)
        return _Columns(placed, effect_columns(effects, saved.model, poses, observed)[:, :3])

    def part(self, k: int) -> "_Columns":
        """Return the columns (derivatives of the point) of pose number k."""
        return _Columns(self.placed[[k]], self.zeros[[k]])

    def beside(self, more: "_Columns") -> "_Columns":
        """Return the columns of the present poses and of further poses together."""
        return _Columns(np.concatenate([self.placed, more.placed]), np.concatenate([self.zeros, more.zeros]))

    @property
    def alone(self) -> Array:
        """Sum of squares of the displacements over the poses by each joint zero."""
        return np.asarray(np.sum(self.zeros**2, axis=(0, 1)))

    @property
    def information(self) -> Array:
        """Sum of squares of each joint zero's displacements after the registration is projected out."""
        placed, zeros = (part.reshape(-1, part.shape[2]) for part in (self.placed, self.zeros))
        basis = np.linalg.qr(placed)[0]
        return np.asarray(np.sum((zeros - basis @ (basis.T @ zeros)) ** 2, axis=0))


@dataclass(frozen=True)
class Pool:
    """Candidate poses of a check: the poses of the model's fit, which the arm can reach.

    session: the check so far; None with too few poses for a test. columns: derivatives of the point, with the session's
    registration.
    """

    saved: SavedModel
    session: Session | None
    poses: Poses
    columns: _Columns

    @staticmethod
    def of(saved: SavedModel, session: Session | None = None) -> "Pool":
        """Return the candidate poses; raise InputError if the model does not contain the table of its fit."""
        data, now = measured_table(saved), saved if session is None else session.saved
        if session is not None:
            here = {name: np.full(len(data), session.poses.dataset.label(name)[0]) for name in ("setup", "tool")}
            data = replace(data, labels={**data.labels, **here})
        poses = prepare(saved.mechanism, data)
        return Pool(saved, session, poses, _Columns.of(now, poses))

    @property
    def q(self) -> Array:
        """Joint values of the candidate poses, rad and m."""
        return self.poses.dataset.q

    def not_among(self, taken: Array) -> IntArray:
        """Return the numbers of the candidate poses not among `taken`; all numbers if every pose is among `taken`."""
        there = np.array([len(taken) > 0 and (np.abs(taken - one) < SAME).all(axis=1).any() for one in self.q])
        return np.flatnonzero(~there) if not there.all() else np.arange(len(self.q))

    @property
    def able(self) -> Mask:
        """Mask of the joints whose zero the candidate poses determine in addition to the registration."""
        return np.asarray(self.columns.information > SEEN * self.columns.alone)

    def unseen(self, visible: Sequence[Visible], limit: float) -> tuple[HiddenChange, ...]:
        """Return the determinable joints whose undetected zero shift could move the tool by more than `limit`, m."""
        levers = np.sqrt(self.columns.alone / len(self.q))
        moves = [(math.inf if v.size is None else v.size) * lever for v, lever in zip(visible, levers, strict=True)]
        hidden = zip(visible, moves, self.able, strict=True)
        return tuple(HiddenChange(v.joint, float(m)) for v, m, able in hidden if able and m > limit)

    def next(self, taken: Array) -> Array:
        """Return the joint values of the next pose to measure, none of the poses `taken`.

        The pose maximises the information on the least determined joint zero, relative to its displacement of the tool.
        Without a session, the pose farthest from `taken` is returned.
        """
        left = self.not_among(taken)
        if self.session is None:
            others = taken if len(taken) else None
            return np.asarray(self.q[left[spread_among(self.saved.mechanism, self.q[left], 1, others)[0]]])
        have = _Columns.of(self.session.saved, self.session.poses.subset(np.flatnonzero(self.session.use)))
        able, alone = self.able, self.columns.alone
        seen = np.array([have.beside(self.columns.part(int(k))).information[able] for k in left]) / alone[able]
        return np.asarray(self.q[left[int(np.argmax(seen.min(axis=1, initial=np.inf)))]])

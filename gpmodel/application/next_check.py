"""A check that goes on pose by pose: which pose is measured next, and when enough was seen.

A look at n poses spends FALSE_ALARM · 6 / (π² k²), k = n - 5, on its two tests, so that all looks together, however
many there are, call one machine in twenty changed that is not (union bound, Σ 1/k² = π²/6). A check ends where a change
is seen, or where a change of any joint's zero that moves the tool by more than a limit would have been.
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
"""Different poses before the first decision. If one of them is misread, five remain, which determine registration and
tool."""
SEEN = 1e-6
"""Least share of a joint zero's motion that registration does not absorb. Below it the poses do not show the zero."""
SAME = 1e-4
"""Largest difference of joint values of one pose, radians or metres."""


@dataclass(frozen=True)
class HiddenChange:
    """A joint whose zero may have changed unseen so much that the tool moves by this much, m, RMS."""

    joint: str
    moves: float


def significance(poses: int) -> float:
    """Significance of each of the two tests of a look at so many poses."""
    look = max(poses - FIRST + 1, 1)
    return 0.5 * FALSE_ALARM * 6.0 / (math.pi * look) ** 2


@dataclass(frozen=True)
class _Columns:
    """Columns of the measured point for the registration (P, 3, 6), and for the zero of each joint (P, 3, n)."""

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
        """One pose."""
        return _Columns(self.placed[[k]], self.zeros[[k]])

    def beside(self, more: "_Columns") -> "_Columns":
        """These poses and others."""
        return _Columns(np.concatenate([self.placed, more.placed]), np.concatenate([self.zeros, more.zeros]))

    @property
    def alone(self) -> Array:
        """Sum of squares (n,) of each zero's column."""
        return np.asarray(np.sum(self.zeros**2, axis=(0, 1)))

    @property
    def information(self) -> Array:
        """Part (n,) of it that registration does not absorb."""
        placed, zeros = (part.reshape(-1, part.shape[2]) for part in (self.placed, self.zeros))
        basis = np.linalg.qr(placed)[0]
        return np.asarray(np.sum((zeros - basis @ (basis.T @ zeros)) ** 2, axis=0))


@dataclass(frozen=True)
class Pool:
    """The poses of the fit, where the arm is known to go. columns: as the session has them, if there is one.

    session: the check so far; None of fewer poses than anything is judged by.
    """

    saved: SavedModel
    session: Session | None
    poses: Poses
    columns: _Columns

    @staticmethod
    def of(saved: SavedModel, session: Session | None = None) -> "Pool":
        """Raises InputError where the model does not hold the table of its fit."""
        data, now = measured_table(saved), saved if session is None else session.saved
        if session is not None:
            here = {name: np.full(len(data), session.poses.dataset.label(name)[0]) for name in ("setup", "tool")}
            data = replace(data, labels={**data.labels, **here})
        poses = prepare(saved.mechanism, data)
        return Pool(saved, session, poses, _Columns.of(now, poses))

    @property
    def q(self) -> Array:
        """Joint values (P, n)."""
        return self.poses.dataset.q

    def not_among(self, taken: Array) -> IntArray:
        """Return the indices of the poses that are none of those `taken` (M, n); all where none is left."""
        there = np.array([len(taken) > 0 and (np.abs(taken - one) < SAME).all(axis=1).any() for one in self.q])
        return np.flatnonzero(~there) if not there.all() else np.arange(len(self.q))

    @property
    def able(self) -> Mask:
        """Joints (n,) whose zero these poses show: the registration does not stand for it at every pose."""
        return np.asarray(self.columns.information > SEEN * self.columns.alone)

    def unseen(self, visible: Sequence[Visible], limit: float) -> tuple[HiddenChange, ...]:
        """Joints whose zero may move the tool by more than a limit, m, unseen; not those that no pose shows."""
        levers = np.sqrt(self.columns.alone / len(self.q))
        moves = [(math.inf if v.size is None else v.size) * lever for v, lever in zip(visible, levers, strict=True)]
        hidden = zip(visible, moves, self.able, strict=True)
        return tuple(HiddenChange(v.joint, float(m)) for v, m, able in hidden if able and m > limit)

    def next(self, taken: Array) -> Array:
        """Joint values (n,) of a pose that is not among those `taken` (M, n).

        After it the zero that was determined worst, by its motion of the tool, is determined best. Without a session it
        is the pose farthest from the poses already measured.
        """
        left = self.not_among(taken)
        if self.session is None:
            others = taken if len(taken) else None
            return np.asarray(self.q[left[spread_among(self.saved.mechanism, self.q[left], 1, others)[0]]])
        have = _Columns.of(self.session.saved, self.session.poses.subset(np.flatnonzero(self.session.use)))
        able, alone = self.able, self.columns.alone
        seen = np.array([have.beside(self.columns.part(int(k))).information[able] for k in left]) / alone[able]
        return np.asarray(self.q[left[int(np.argmax(seen.min(axis=1, initial=np.inf)))]])

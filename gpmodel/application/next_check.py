"""A check that goes on pose by pose: which pose is measured next, and when enough was seen.

A look at n poses spends FALSE_ALARM · 6 / (π² k²), k = n - 5, on its two tests, so that all looks together, however
many there are, call one machine in twenty changed that is not (union bound, Σ 1/k² = π²/6). A check ends where a change
is seen, or where a change of any joint's zero that moves the tool by more than a limit would have been.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.application.exports.sample import measured_table
from gpmodel.application.later import Session
from gpmodel.application.model_file import SavedModel
from gpmodel.application.possible_changes import zero_of
from gpmodel.application.verify import Verified
from gpmodel.arrays import Array
from gpmodel.calibration.linearise import effect_columns
from gpmodel.formula.expression import ONE
from gpmodel.model.effect import drive_effect
from gpmodel.model.error_model import Poses, observe, prepare
from gpmodel.planning.poses import spread_among

FALSE_ALARM = 0.05
"""Chance that a check of a machine that did not change ends with a change, however long it goes on."""
FIRST = 6
"""Different poses of the first look: one of them may be misread, and five still tell the registration and the tool."""
SEEN = 1e-6
"""Share of what the poses show of a zero that is left beside the registration, below which no pose shows it."""
SAME = 1e-4
"""Radians or metres between two poses that are one."""


@dataclass(frozen=True)
class HiddenChange:
    """A joint whose zero may have changed unseen so much that the tool moves by this much, m, RMS."""

    joint: str
    moves: float


def significance(poses: int) -> float:
    """Significance of each of the two tests of a look at so many poses."""
    look = max(poses - FIRST + 1, 1)
    return 0.5 * FALSE_ALARM * 6.0 / (math.pi * look) ** 2


def unseen(found: Verified, limit: float) -> tuple[HiddenChange, ...]:
    """Joints whose zero may move the tool by more than a limit, m, unseen; not those that the registration stands for
    at every pose. Raises InputError where the model does not hold the table of its fit."""
    session = found.session
    _, pool = _pool(session.saved, session)
    ever, levers = pool.information > SEEN * pool.alone, np.sqrt(pool.alone / len(pool.zeros))
    moves = [(math.inf if v.size is None else v.size) * lever for v, lever in zip(found.visible, levers, strict=True)]
    return tuple(
        HiddenChange(v.joint, float(m))
        for v, m, able in zip(found.visible, moves, ever, strict=True)
        if able and m > limit
    )


def next_pose(saved: SavedModel, session: Session | None, taken: Array) -> Array:
    """Joint values (n,), among the poses of the fit, where the arm is known to go, and not among those `taken` (M, n).

    After it the zero that is seen worst, in what it moves the tool by, is seen best; without a session, of fewer poses
    than anything is judged by, the one farthest from those taken. Raises InputError as `unseen`.
    """
    poses, pool = _pool(saved, session)
    q = poses.dataset.q
    there = np.array([len(taken) > 0 and (np.abs(taken - one) < SAME).all(axis=1).any() for one in q])
    left = np.flatnonzero(~there) if not there.all() else np.arange(len(q))
    if session is None:
        return np.asarray(q[left[spread_among(saved.mechanism, q[left], 1, taken if len(taken) else None)[0]]])
    have = _Columns.of(session.saved, session.poses.subset(np.flatnonzero(session.use)))
    able = pool.information > SEEN * pool.alone
    seen = np.array([have.beside(pool.part(int(k))).information[able] for k in left]) / pool.alone[able]
    return np.asarray(q[left[int(np.argmax(seen.min(axis=1, initial=np.inf)))]])


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
        """What is left (n,) of it beside the registration."""
        placed, zeros = (part.reshape(-1, part.shape[2]) for part in (self.placed, self.zeros))
        basis = np.linalg.qr(placed)[0]
        return np.asarray(np.sum((zeros - basis @ (basis.T @ zeros)) ** 2, axis=0))


def _pool(saved: SavedModel, session: Session | None) -> tuple[Poses, _Columns]:
    """The poses of the fit, as a later session has them."""
    data = measured_table(saved)
    if session is not None:
        now = {name: np.full(len(data), session.poses.dataset.label(name)[0]) for name in ("setup", "tool")}
        data, saved = replace(data, labels={**data.labels, **now}), session.saved
    poses = prepare(saved.mechanism, data)
    return poses, _Columns.of(saved, poses)

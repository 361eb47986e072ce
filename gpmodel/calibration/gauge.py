"""Choose which of several equivalent robot parameters are fixed at zero, in one order for every table."""

from collections.abc import Iterable

import numpy as np

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.linearise import Linearised
from gpmodel.calibration.overall_scale import LIMIT as SIZE_LIMIT
from gpmodel.calibration.overall_scale import scale_similarity, scale_unobservable
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel
from gpmodel.model.sites import Site, sites_of
from gpmodel.numerics import rank as ident
from gpmodel.table.blocks import FOLDS, SAME_JOINT, folds
from gpmodel.table.dataset import Dataset

MINIMUM_SHARE = 1e-3
"""Least part of a pose-dependent effect's motion that no other effect imitates, for the effect to be fitted."""

LARGEST_LIMIT = 1e4
"""Largest condition number of a fit without geometric constants."""


def still_joints(mechanism: Mechanism, dataset: Dataset) -> tuple[str, ...]:
    """Return the names of the joints that do not move over the poses of a table."""
    if not len(dataset):
        return ()
    still = np.ptp(dataset.q, axis=0) <= SAME_JOINT
    return tuple(j.name for j, s in zip(mechanism.joints, still, strict=True) if s and j.measured)


def at_fixed_joints(slots: Iterable[str], still: tuple[str, ...]) -> bool:
    """Return whether all given frames belong to joints that do not move; effects at such joints are redundant."""
    return {slot.rsplit(".", 1)[0] for slot in slots} <= set(still)


def moving_sites(mechanism: Mechanism, dataset: Dataset) -> tuple[Site, ...]:
    """Return the sites (frame and axis) of a mechanism, except at joints that do not move in a table."""
    still = still_joints(mechanism, dataset)
    return tuple(s for s in sites_of(mechanism) if not at_fixed_joints((slot for slot, _, _ in s.terms), still))


def inclusion_order(
    mechanism: Mechanism, effects: tuple[Effect, ...], still: tuple[str, ...] = (), growth: Array | None = None
) -> IntArray:
    """Return the indices of effects in the order in which a fit includes them: joint zeros, then lengths, then angles.

    Effects at a joint that does not move are omitted, because the link before the joint has equivalent parameters.
    growth: similarity of each effect to a uniform scaling of the mechanism; the most similar lengths come last.
    growth is None if a measurement determines the scale.
    """
    zeros = {(slot, axis) for joint in mechanism.joints for slot, axis, _ in joint.drive}
    kinds = []
    for i, effect in enumerate(effects):
        places = {(t.slot, t.axis) for t in effect.terms}
        if not at_fixed_joints(effect.slots, still):
            kind = 0 if places <= zeros else 1 if effect.unit == "m" else 2
            kinds.append((kind, growth[i] if growth is not None and kind == 1 else 0.0, i))
    return np.array([i for *_, i in sorted(kinds)], dtype=np.int64)


ENOUGH, LIMIT_OF_FEW = 1.5, 200.0
"""Measurements per unknown above which all constants are fitted, and condition limit for fewer measurements, if no
measurement determines the robot's scale. The condition limit is halved until a degree of freedom remains.
Cross-validation cannot choose the condition limit without a scale, because folds ignore the prior against overfitting
(of 20 tables with 40 touches on three balls, cross-validation left 4 with one constant)."""


def choose(
    model: ErrorModel, problem: Linearised, nominal: Linearised, theta: Array, condition_limit: float | None, seed: int
) -> tuple[Mask, float, tuple[ident.RankChoice, ...]]:
    """Return a mask of the effects to fit, the condition limit, and the cross-validation curve of the limit.

    problem: measurements linearised at the effects' values `theta`. nominal: linearised at zero, constant effects
    alone. Constant effects are ranked in `inclusion_order` by their nominal columns, because with a fitted error of a
    milliradian two parallel axes would appear distinguishable. Of the trial condition limits with a cross-validated
    error within one standard error of the smallest, the limit with the most constants is selected, so that tables of
    one machine fit equal constants. If no measurement determines the scale, the condition limit is 5000, or at most 200
    for few measurements, and the length most similar to a uniform scaling is fitted. Pose-dependent effects need a
    unique share of 0.001; effects with a prior are always fitted.
    Raises InputError for fewer measurements than unknowns, or for a single fold.
    """
    constant = np.array([e.constant for e in model.effects], dtype=bool)
    prior = np.array([np.isfinite(e.prior) for e in model.effects], dtype=bool)
    at, varying, fixed = np.flatnonzero(constant), np.flatnonzero(~constant & ~prior), problem.placement
    columns = problem.columns[:, fixed:]
    still = still_joints(model.mechanism, problem.poses.dataset)
    hidden = scale_unobservable(problem)
    lengths = np.array([e.unit == "m" for e in model.effects], dtype=bool)
    growth = (scale_similarity(model, problem) * lengths)[at] if hidden else None
    order = inclusion_order(model.mechanism, tuple(model.effects[i] for i in at), still, growth)
    ranking = ident.rank(nominal.columns[:, :fixed], nominal.columns[:, fixed:], order)
    curve: tuple[ident.RankChoice, ...] = ()
    limit = condition_limit or LARGEST_LIMIT
    if condition_limit is None and hidden:
        values = len(problem.residual)
        enough = values > ENOUGH * (len(ranking.kept(SIZE_LIMIT)) + fixed)
        limit = SIZE_LIMIT if enough else LIMIT_OF_FEW
        while limit > 1.0 and len(ranking.kept(limit)) + fixed >= values:
            limit /= 2.0
    elif condition_limit is None and len(at):
        fold = folds(problem.poses.dataset, FOLDS, np.random.default_rng(seed))[problem.pose_of_row]
        if not np.ptp(fold):
            raise InputError(
                f"{problem.poses.dataset.source}: all fitted poses belong to one group; expected at least 2 groups "
                "for the cross-validation of the condition limit, or a given condition limit"
            )
        local = nonzero_in_one_fold(problem.columns[:, :fixed], fold)
        beside = np.hstack([problem.columns[:, :fixed][:, ~local], columns[:, varying]])
        target = problem.residual + columns[:, at] @ theta[at] + columns[:, varying] @ theta[varying]
        taken = ident.orthonormal(problem.columns[:, :fixed][:, local])
        system, target = ident.remove(taken, np.hstack([beside, columns[:, at]])), ident.remove(taken, target)
        curve = ident.rank_curve(ranking, ident.folded(system, target, fold), beside.shape[1])
        best = min(curve, key=lambda c: c.cv_rms)
        good = (c for c in curve if c.cv_rms <= best.cv_rms + best.spread)
        limit = max(good, key=lambda c: c.rank).condition_limit
    kept = np.zeros(len(model.effects), dtype=bool)
    kept[at[ranking.kept(limit)]] = True
    late = ident.rank(np.hstack([problem.columns[:, :fixed], columns[:, kept]]), columns[:, varying])
    kept[varying[late.kept(1.0 / MINIMUM_SHARE)]] = True
    kept |= prior
    _enough(problem, int((kept & ~prior).sum()))
    if growth is not None and growth.any():
        kept[at[np.argmax(growth)]] = True
    return kept, limit, curve


def nonzero_in_one_fold(columns: Array, fold: IntArray) -> Mask:
    """Return a mask of derivatives (columns) that are nonzero in one fold only, as for a point touched once.

    No other fold determines a column that is zero outside one fold; the column is therefore projected out.
    """
    there = np.array([np.any(columns[fold == k] != 0.0, axis=0) for k in np.unique(fold)])
    return np.asarray(there.sum(axis=0) == 1)


def _enough(problem: Linearised, held: int) -> None:
    """Raise InputError if there are fewer measurements than unknown parameters."""
    fixed = problem.columns[:, : problem.placement]
    unknowns = (ident.orthonormal(fixed).shape[1] if problem.reduced else problem.placement) + held
    if len(problem.residual) < unknowns + (problem.reduced is None):
        raise InputError(
            f"{problem.poses.dataset.source}: {len(problem.residual)} measured values for {unknowns} unknowns; "
            "expected more poses than that or fewer parameters"
        )

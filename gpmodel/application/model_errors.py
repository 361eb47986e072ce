"""Distinguish errors of a model from changes of the machine since the fit of the model.

A later table with many poses shows small effects that the poses of the fit could not show, and that distorted the
geometry of the fit. Both tables are fitted together, with the columns K of the fitted model, F of the later
registration, and X of the changes:

    fit:  r = K δ + X u + e        later:  r' = F ρ + K' δ + X' (u + c) + e'

Only c is a change since the fit. If c = 0 is not rejected, the poses of the fit agree with u, or do not determine it:
the model is in error. Source: Rao (1973), chapter 4a.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.application.changed_model import with_changes
from gpmodel.application.extrapolation import in_order_of, rows_of_the_fit
from gpmodel.application.model_file import SavedModel
from gpmodel.application.named_changes import NamedChange
from gpmodel.application.possible_changes import LEAST, SET_UP, PossibleChange
from gpmodel.application.recheck import Recheck
from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.linearise import Linearised
from gpmodel.calibration.noise import blocks_of
from gpmodel.errors import InputError
from gpmodel.model.error_model import Poses
from gpmodel.numerics import rank
from gpmodel.numerics.interval import chance_of_ratio
from gpmodel.table.blocks import sharing
from gpmodel.table.units import clock_names


def since_the_fit(
    saved: SavedModel, near: Recheck, named: Sequence[NamedChange], tried: Sequence[PossibleChange], level: float
) -> tuple[NamedChange, ...]:
    """Mark the identified changes that are errors of the model, if the model lacks at least one of their effects.

    near: residuals of the later session. tried: all possible changes. level: significance level of the test of c = 0.
    """
    by_name = {change.name: change for change in tried}
    chosen = [by_name[change.name] for change in named]
    fit = rows_of_the_fit(saved, saved.placement) if any(_new_to_the_model(change) for change in chosen) else None
    if fit is None:
        return tuple(named)
    both = _Both.of(saved, near, fit, chosen)
    return tuple(replace(change, of_the_model=both.chance(k, near.freedom) >= level) for k, change in enumerate(named))


def _new_to_the_model(change: PossibleChange) -> bool:
    """Return whether a change adds an effect of the catalogue that the model does not contain, at all rows."""
    return change.kind == "catalogue" and bool(change.effects) and not change.rows


def _possible_before(poses: Poses, change: PossibleChange) -> bool:
    """Return whether a change of the machine may have been there at the poses of the fit: at all rows, with inputs that
    have values and do not order the poses of one session."""
    if change.kind == SET_UP or change.rows:
        return False
    read = {name for effect in change.effects for name in effect.inputs}
    try:
        for name in read:
            poses.states[name]
    except InputError:
        return False
    return not read & clock_names(poses.dataset.extra_units)


@dataclass(frozen=True)
class _Both:
    """Fit of the poses of a model and of later poses together, with the effects u of all changes.

    left: residual in units of the noise. pose: index of the pose of each row. changed: columns of each c, without the
    part that the fit explains; no columns for a change that the fit cannot contain.
    """

    left: Array
    pose: IntArray
    changed: tuple[Array, ...]

    @classmethod
    def of(cls, saved: SavedModel, near: Recheck, fit: Linearised, chosen: Sequence[PossibleChange]) -> "_Both":
        """Stack the rows of the fit, the rows of the later session, and the priors of the effects of the model."""
        session, steps = with_changes(near.session, near.problem, chosen)
        later, pose_id = session.problem, sharing(fit.poses.dataset)
        blocks, free = blocks_of(fit, pose_id), session.anew(later)
        ridge, means = _priors(saved, fit, near.spread.sigma)
        ends = np.cumsum([change.columns.shape[1] for change in chosen])[:-1]
        own = [near.blocks.means(part) for part in np.split(later.columns @ steps, ends, axis=1)]

        def stacked(first: Array, second: Array, third: Array) -> Array:
            return np.concatenate([blocks.means(first), second, third])

        def beside(first: Array, second: Array) -> Array:
            return stacked(first, second, np.zeros((len(means), second.shape[1])))

        def only_later(columns: Array) -> Array:
            return beside(np.zeros((len(fit.residual), columns.shape[1])), columns)

        there = [*later.placement_names, *(e.name for e in near.session.saved.model.effects)]
        before = [*fit.placement_names, *(e.name for e in saved.model.effects)]
        known = [k for k in range(len(there)) if not free[k]]
        common = near.blocks.means(in_order_of(before, [there[k] for k in known], later.columns[:, known]))
        columns = [stacked(fit.columns, common, ridge), only_later(near.blocks.means(later.columns[:, free]))]
        tested = [_possible_before(fit.poses, change) for change in chosen]
        for change, part, both in zip(chosen, own, tested, strict=True):
            if not both:
                columns.append(only_later(part))
            elif change.effects:
                columns.append(beside(fit.derivatives(change.effects, saved.model), part))
        span = rank.orthonormal(np.hstack(columns))
        left = rank.remove(span, stacked(fit.residual, near.blocks.means(later.residual), means))
        asked = (only_later(part)[:, : part.shape[1] * both] for part, both in zip(own, tested, strict=True))
        first = pose_id[fit.pose_of_row[np.unique(blocks.block, return_index=True)[1]]]
        further = near.pose + first.max() + 1
        prior = further.max() + 1 + np.arange(len(means))
        changed = tuple(_kept(part, span) for part in asked)
        return cls(left / near.spread.sigma, np.concatenate([first, further, prior]), changed)

    def chance(self, k: int, freedom: float) -> float:
        """Return the p-value of c = 0 for change number k, with the c of other changes free: 0 for a change that
        the fit cannot contain, 1 if no row determines c.

        The errors of a pose may depend on each other, and differ between poses: the p-value is the larger one of the F
        test and of a test with the covariance of the poses, Σ g gᵀ, g = Xᵀe / (1 - h), h the leverage of the pose (HC3
        of MacKinnon and White 1985, by poses).
        """
        if not self.changed[k].shape[1]:
            return 0.0
        others = rank.orthonormal(np.hstack([self.changed[k][:, :0], *self.changed[:k], *self.changed[k + 1 :]]))
        own, left = rank.orthonormal(_kept(self.changed[k], others)), rank.remove(others, self.left)
        part = own.T @ left
        if not len(part):
            return 1.0
        kept = np.maximum(1.0 - np.bincount(self.pose, np.sum(own**2, axis=1)), 1e-9)
        errors = own * (left - own @ part)[:, None]
        of_pose = np.stack([np.bincount(self.pose, column) / kept for column in errors.T], axis=1)
        wald = float(part @ np.linalg.pinv(of_pose.T @ of_pose, hermitian=True) @ part)
        return chance_of_ratio(min(wald, float(part @ part)) / len(part), len(part), freedom)


def _kept(columns: Array, span: Array) -> Array:
    """Return columns without their projection on a span; zero where only rounding errors remain."""
    left = rank.remove(span, columns)
    return np.where(np.linalg.norm(left, axis=0) > LEAST * np.linalg.norm(columns, axis=0), left, 0.0)


def _priors(saved: SavedModel, fit: Linearised, sigma: float) -> tuple[Array, Array]:
    """Return a row for each effect with a finite prior, and its right-hand side, in units of the weighted residual."""
    prior = np.array([effect.prior for effect in saved.model.effects])
    known = np.flatnonzero(np.isfinite(prior))
    ridge = np.zeros((len(known), fit.columns.shape[1]))
    ridge[np.arange(len(known)), fit.placement + known] = sigma / prior[known]
    return ridge, -sigma / prior[known] * saved.theta[known]

"""Refit a model to the poses of a check that identified a change of the machine, with the former model as prior.

Tool and effects have the prior x ~ N(m, Σ) of model.json. Changed parameters have the covariance Σ + D Dᵀ: one column
of D per parameter, which moves the tool by WIDE = 10 times the RMS error of the poses. With x = m + L u, L Lᵀ = Σ + D
Dᵀ, every Gauss-Newton step is

    [F  K L; 0  σ] (ρ, u) = (r, -σ u)         F, K, r, σ: as in `application.recheck`; the registration ρ has no prior
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.application.changed_model import with_changes
from gpmodel.application.kinematics import with_memory_columns
from gpmodel.application.model_file import Measured, SavedModel, needed
from gpmodel.application.next_check import Pool
from gpmodel.application.possible_changes import SET_UP, PossibleChange
from gpmodel.application.predict import point_columns
from gpmodel.application.recheck import PASSES, Recheck, Session, in_covariance
from gpmodel.application.verify import Verified
from gpmodel.arrays import Array, Mask, NotNegative
from gpmodel.calibration.linearise import Linearised
from gpmodel.calibration.noise import blocks_of
from gpmodel.calibration.overall_scale import without_frame
from gpmodel.calibration.result import Covariance
from gpmodel.mechanism.protocol import AXES
from gpmodel.model.effect import Term
from gpmodel.model.error_model import ErrorModel, observe
from gpmodel.model.observation import observations
from gpmodel.model.sites import names_of, translate
from gpmodel.numerics import rank
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.planning.design import Design, LOptimal, choose, deviations
from gpmodel.table.blocks import sharing
from gpmodel.table.dataset import Dataset

ENOUGH = 1.2
"""Ratio of the expected errors after refit and before the change at which no further pose is needed. With a ratio of
1.1, twice as many poses are needed."""
MOST_MORE = 30
"""Largest number of further poses for the refit of a changed model. A new calibration needs hardly more poses."""
WIDE = 10.0
"""Displacement of the tool by one prior standard deviation of a changed parameter, relative to the RMS error of the
poses. The registration absorbs up to nine tenths of a displacement; a tenth of the value shrinks the change by 1 %."""
UNKNOWN = 0.02
"""Standard deviation of a tool coordinate, m, above which the fit has not determined it. The prior has 1 m."""
MOST_CAUSES = 8
"""Largest number of alternatives to a change whose refitted models are compared; 95 % sets rarely have more."""
KEPT_LABELS = ("setup", "tool", "tip")
"""Label columns of the fitted table that are kept when its rows are joined to the rows of the check."""


@dataclass(frozen=True)
class Renewed:
    """A refitted parameter of a changed model, SI units: value and standard error, before and after the refit."""

    name: str
    unit: str
    before: tuple[float, float]
    after: tuple[float, float]


@dataclass(frozen=True)
class Repaired:
    """Model of a machine after a change. numbers: values of the changed parameters.

    expected, before: RMS error, m, of the point at the poses of the fit, without the part that a registration absorbs,
    now and before the change. `expected` includes that another change of the credible set may be the cause.
    more: joint values of further poses until the part of the expected error due to the parameters, which alone further
    poses reduce, is at most ENOUGH times that part before the change; None if 30 poses (MOST_MORE) do not suffice.
    apart: joint values of the pose at which the possible causes differ most; None if the cause is identified, that is,
    if causes alone raise the error before the change to at most ENOUGH times.
    """

    saved: SavedModel
    numbers: tuple[Renewed, ...]
    expected: NotNegative
    before: NotNegative
    more: Array | None
    apart: Array | None


@dataclass(frozen=True)
class _Fit:
    """Refitted model of a session. changed: columns D of the changed parameters. left: linear system of the last step.

    step: derivatives of all parameters of the model with respect to the unknowns of the system.
    """

    session: Session
    changed: Array
    problem: Linearised
    left: Array
    step: Array
    sigma: float

    @property
    def covariance(self) -> Array:
        """Covariance of registration, tool and effects after the refit."""
        size = np.linalg.norm(self.left, axis=0)
        size[size == 0.0] = 1.0
        root = self.sigma * (self.step / size) @ np.linalg.pinv(self.left / size, rcond=1e-12)
        return np.asarray(root @ root.T)


def repaired(found: Verified, pool: Pool) -> Repaired | None:
    """Refit a model to the poses of a check that identified a change.

    The refitted model is None if no change is identified, if the changes do not explain the poses, if the rows divide
    between two values of a constant, or if no measurement is in an instrument's frame.
    """
    data = found.session.poses.dataset
    divided = any(change.divides for change in found.changes)
    identified = found.verdict == "drifted" and found.changes and found.complete
    if not identified or divided or without_frame(observations(data)):
        return None
    near = found.near
    before, ((_, changes), *others) = near.session.saved, list(_causes(found))
    fit = _fitted(near, changes)
    lasting = _lasting(fit, changes)
    saved, own = _kept(fit, pool.saved, lasting), _tips(fit, changes, pool)
    off = [
        share**0.5 * (_tips(_fitted(near, cause), cause, pool) - own)
        for share, cause in others if all(pool.reads(change) for change in cause)
    ]  # fmt: skip
    ahead = _ahead(fit, saved, lasting, _determined(_before(before, fit.problem), fit.problem), pool, off)
    was = replace(before, placement=replace(before.placement, tool=pool.saved.placement.tool))
    called = [(c.effects[0].terms, c.name) for c in changes if len(c.effects) == 1]
    return Repaired(saved, tuple(_numbers(was, fit, lasting, called)), *ahead)


def _causes(found: Verified) -> Iterator[tuple[float, list[PossibleChange]]]:
    """Yield the identified changes, then the changes with one replaced by an alternative, each with its probability.

    Of each change, only the most probable alternatives (MOST_CAUSES) are included.
    """
    tried = {change.name: change for change in found.tried}
    named = [tried[c.name] for c in found.changes if c.name in tried]
    yield 1.0, named
    for k, change in enumerate(c for c in found.changes if c.name in tried):
        for rival, share in [*zip(change.rivals, change.shares[1:], strict=True)][:MOST_CAUSES]:
            yield share, [*named[:k], tried[rival], *named[k + 1 :]]


def _lasting(fit: _Fit, changes: Sequence[PossibleChange]) -> Mask:
    """Return a mask of the effects of the model without those of the set-up and of single rows."""
    aside = {e.name for change in changes if change.kind == SET_UP or change.rows for e in change.effects}
    return np.array([e.name not in aside for e in fit.session.saved.model.effects], dtype=bool)


def _tips(fit: _Fit, changes: Sequence[PossibleChange], pool: Pool) -> Array:
    """Return the points (N, 3) of the candidate poses by a refitted model."""
    saved = fit.session.saved
    theta = np.where(_lasting(fit, changes), saved.theta, 0.0)
    return np.asarray(observe(saved.model, pool.poses, theta, saved.placement).tip[:, :3, 3])


def _fitted(near: Recheck, changes: Sequence[PossibleChange]) -> _Fit:
    """Iterate to the posterior mode of the changed model's parameters, excluding outliers at each step."""
    session, changed = with_changes(near.session, near.problem, changes)
    sigma, total = near.spread.sigma, np.zeros(0)
    lever = np.sqrt(np.sum((session.problem.columns @ changed) ** 2, axis=0) / session.use.sum())
    changed = changed * WIDE * root_mean_square(near.session.errors) / np.maximum(lever, np.finfo(float).tiny)
    for _ in range(PASSES):
        problem = session.problem
        blocks, free = blocks_of(problem, sharing(session.poses.dataset)), session.anew(problem)
        step = np.hstack([np.eye(len(free))[:, free], _root(near.session.saved, problem, ~free), changed])
        if not total.size:
            total = np.zeros(step.shape[1] - free.sum())
        prior = np.hstack([np.zeros((len(total), free.sum())), sigma * np.eye(len(total))])
        left = np.vstack([blocks.means(problem.columns) @ step, prior])
        right = np.concatenate([blocks.means(problem.residual), -sigma * total])
        own = np.linalg.lstsq(left, right, rcond=1e-13)[0]
        total = total + own[free.sum() :]
        session = session.moved(problem, step @ own).without_outliers()
    return _Fit(session, changed, problem, left, step, sigma)


def _root(saved: SavedModel, problem: Linearised, held: Mask) -> Array:
    """Return a root L of the model's covariance of the columns `held`, in the order of all parameters."""
    covariance = _determined(_before(saved, problem), problem)
    covariance[~held] = covariance[:, ~held] = 0.0
    size = np.sqrt(np.diag(covariance))
    known = size > 0
    scaled = covariance[np.ix_(known, known)] / np.outer(size[known], size[known])
    root = np.zeros((len(size), known.sum()))
    root[known] = size[known, None] * rank.square_root(scaled)
    return root


def _determined(covariance: Array, problem: Linearised) -> Array:
    """Return the model's covariance conditional on the tool coordinates that the fit did not determine.

    An undetermined coordinate is, for example, the height of the tool of an arm with parallel axes. Predictions hardly
    depend on the height, but a step of the height by its standard deviation changes every lever.
    """
    tools = [k for k, name in enumerate(problem.placement_names) if name.startswith("tool")]
    for k in tools:
        if covariance[k, k] > UNKNOWN**2:
            covariance = covariance - np.outer(covariance[k], covariance[k]) / covariance[k, k]
            covariance[k] = covariance[:, k] = 0.0
    return covariance


def _before(saved: SavedModel, problem: Linearised) -> Array:
    """Return the model's covariance in the order of the unknowns of a linear problem; zero without an estimate in the
    model: for the registration and for effects of new changes."""
    at = in_covariance(saved, problem)
    at = np.append(at, np.full(problem.columns.shape[1] - len(at), -1))
    at[: problem.placement][[name.startswith("registration") for name in problem.placement_names]] = -1
    known, out = at >= 0, np.zeros((len(at), len(at)))
    out[np.ix_(known, known)] = saved.covariance.values[np.ix_(at[known], at[known])]
    return out


def _kept(fit: _Fit, before: SavedModel, lasting: Mask) -> SavedModel:
    """Return the model to save, with only the effects of the mask `lasting`.

    An effect that the model `before` contains keeps its definition (terms, unit, prior) in `before`.
    """
    now, data = fit.session.saved, fit.session.poses.dataset
    written = {effect.name: effect for effect in before.model.effects}
    rows = np.concatenate([np.ones(fit.problem.placement, dtype=bool), lasting])
    effects = tuple(written.get(e.name, e) for e, kept in zip(now.model.effects, lasting, strict=True) if kept)
    model, values = ErrorModel(now.mechanism, effects), fit.covariance
    fitted = np.isfinite(now.stderr) | fit.changed[fit.problem.placement :].any(axis=1)
    stderr = np.where(fitted, np.sqrt(np.diag(values)[fit.problem.placement :]), np.nan)
    read = needed(model, data)
    states = fit.session.poses.states
    new = {name for effect in effects for name in effect.inputs} - set(before.ranges)
    known = replace(
        now, model=model, theta=now.theta[lasting], stderr=stderr[lasting],
        covariance=Covariance(values[np.ix_(rows, rows)], fit.problem.placement_names,
                              fit.problem.observed.tip[:, :3, 3].mean(axis=0)),
        input_units={name: unit for name, unit in data.extra_units.items() if name in read},
        ranges={**before.ranges, **{n: (float(states[n].min()), float(states[n].max())) for n in new}},
    )  # fmt: skip
    return replace(known, measured=Measured(_both(before, known, data), np.zeros(0, dtype=np.int64)))


def _both(before: SavedModel, saved: SavedModel, data: Dataset) -> Dataset:
    """Return the rows of the check, followed by the poses of the fit without their outdated measurements."""
    data = with_memory_columns(saved, data)
    if before.measured is not None and not data.convention:
        data = replace(data, convention=before.measured.dataset.convention)
    if before.measured is None or data.observations or data.distances:
        return data
    old = with_memory_columns(before, before.measured.dataset)
    if not set(saved.input_units) <= set(old.extras):
        return data
    blank = np.full((len(old), 3), np.nan)
    old = replace(old, labels={**old.labels, "setup": np.full(len(old), data.label("setup")[0])})
    return replace(
        data, in_order=False, columns=data.columns or old.columns,
        q=np.vstack([data.q, old.q]), row=np.concatenate([data.row, old.row]),
        position=np.vstack([data.position, blank]), rotation=np.vstack([data.rotation, blank]),
        payload=np.concatenate([data.payload, old.payload]),
        labels={name: np.concatenate([data.label(name), old.label(name)]) for name in KEPT_LABELS},
        extras={n: np.concatenate([v, old.extras[n]]) for n, v in data.extras.items() if n in old.extras},
    )  # fmt: skip


def _numbers(
    before: SavedModel, fit: _Fit, lasting: Mask, called: Sequence[tuple[tuple[Term, ...], str]]
) -> Iterator[Renewed]:
    """Yield every changed parameter except the set-up: effects, and tool points in the axes of the flange.

    called: pairs of the terms of a change's effects and the name of the change.
    """
    now, problem = fit.session.saved, fit.problem
    count, names = problem.placement, problem.placement_names
    theta = np.append(before.theta, np.zeros(len(now.theta) - len(before.theta)))
    both, joints = (_before(before, problem), fit.covariance), names_of(fit.session.poses.dataset)
    old, new = (np.sqrt(np.diag(values)) for values in both)
    for k in np.flatnonzero(lasting & fit.changed[count:].any(axis=1)):
        effect, at = now.model.effects[k], count + k
        name = translate(next((name for terms, name in called if terms == effect.terms), effect.name), joints)
        yield Renewed(name, effect.unit, (float(theta[k]), float(old[at])), (float(now.theta[k]), float(new[at])))
    for label, frame in now.placement.tool.items():
        title = f"tool {label}".rstrip()
        own = [names.index(f"{title} {axis}") for axis in AXES[:3]]
        if not (fit.session.tool or fit.changed[own].any()):
            continue
        turn, was = frame[:3, :3], before.placement.tool[label]
        old, new = (np.sqrt(np.diag(turn @ values[np.ix_(own, own)] @ turn.T)) for values in both)
        for i, axis in enumerate("xyz"):
            values = (float(was[i, 3]), float(old[i])), (float(frame[i, 3]), float(new[i]))
            yield Renewed(f"{title} point {axis}", "m", *values)


def _ahead(
    fit: _Fit, saved: SavedModel, lasting: Mask, before: Array, pool: Pool, off: Sequence[Array]
) -> tuple[float, float, Array | None, Array | None]:
    """Return the expected error, m, now and before the change, further poses until their ratio is at most 1.2 (ENOUGH),
    and the pose at which the possible causes differ most.

    before: covariance of the former model. off: distances (N, 3) of the candidate points by the model of each rival
    from those by the named changes, times the root of the probability of the rival.
    """
    rows = np.concatenate([np.ones(fit.problem.placement, dtype=bool), lasting])
    observed = observe(saved.model, pool.poses, saved.theta, saved.placement)
    columns, count = point_columns(saved, pool.poses, observed), len(pool.q)
    own, step = columns.reshape(3 * count, -1).copy(), fit.step[rows]
    placed = [k for k, name in enumerate(fit.problem.placement_names) if name.startswith("registration")]
    basis = rank.orthonormal(own[:, placed])
    own[:, placed] = 0.0
    own = rank.remove(basis, own)
    was = float(np.sqrt(np.sum((own @ before[np.ix_(rows, rows)]) * own) / count))
    known, moved = fit.left.T @ fit.left / fit.sigma**2, own @ step
    scale = np.sqrt(np.diag(known))
    scale[scale == 0.0] = 1.0
    weight = LOptimal(moved.T @ moved / count / np.outer(scale, scale))
    question = Design(columns @ step / fit.sigma / scale, known / np.outer(scale, scale), weight)
    left = pool.not_among(fit.session.poses.dataset.q)
    order = left[choose(question.columns[left], question.known, min(MOST_MORE, len(left)), weight)]
    errors = deviations([question], order)
    enough = np.flatnonzero(errors <= ENOUGH * was)
    between = sum(float(np.sum(rank.remove(basis, one.ravel()) ** 2)) for one in off) / count
    apart, more = None, 3.0**0.5 * saved.discrepancy
    if between > (ENOUGH**2 - 1.0) * was**2:
        apart = pool.q[left[int(np.argmax(np.sum(np.square(off), axis=(0, 2))[left]))]]
    now, was = (float(np.sqrt(np.sum(np.square(v)))) for v in ((errors[0], between**0.5, more), (was, more)))
    return now, was, pool.q[order[: enough[0]]] if len(enough) else None, apart

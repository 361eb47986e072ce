"""Test a fitted model on later poses, and identify what changed if the test fails.

The registration is fitted again, because an instrument is never set up at an identical position. The verification does
not refit the tool point of the model.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.spatial import KDTree

from gpmodel.application.changed_model import with_changes
from gpmodel.application.divided_rows import divided
from gpmodel.application.kinematics import tips
from gpmodel.application.model_errors import since_the_fit
from gpmodel.application.model_file import SavedModel
from gpmodel.application.named_changes import MOST, SIGNIFICANCE, NamedChange, Visible, changes, suspected, visible
from gpmodel.application.possible_changes import PossibleChange, possible_changes
from gpmodel.application.recheck import Recheck, Session, kept_by, recheck, refitted, settled
from gpmodel.application.stacked_changes import Stack
from gpmodel.application.usable import at_end, out_of_range, usable
from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.checks.late import delayed, moved_by_rates, path_rates, zeros
from gpmodel.checks.rounding import computed, rounded
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import AXES
from gpmodel.model.error_model import ErrorModel, Placement, observe, turn_error
from gpmodel.model.observation import Orientation, observations
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.numerics.se3 import frame_of
from gpmodel.table.blocks import copies
from gpmodel.table.dataset import Dataset

Verdict = Literal["holds", "drifted", "another machine"]
HALF = 0.5
"""Largest error of a model that can be valid, relative to the error of the nominal model."""
UNEXPLAINED = 0.01
"""Largest share of chi-square that second-order terms of a crash cause. The identified changes of a machine are
complete if the remaining chi-square is not significant, or at most this share."""

COMPUTED = 0.02
"""Residual, in units of the noise of the fit, below which positions were computed from the model: no later instrument
has a fiftieth of the noise."""
EQUAL, UNMEASURED = 1e-9, 1e12
"""Largest difference, SI units, of values of one measurement that is written in other units, and the number in place of
a missing value. A measurement repeated on a machine differs by its noise, more than ten times as much."""
DIVISIONS = 3
"""Largest number of divisions of the rows that are sought for one table. Two suffice for nearly all tables."""
FAR = 5e-4
"""RMS residual, m, above which the tool point is fitted again, not corrected linearly. At half a millimetre on a 0.2 m
arm the second-order error of a rotation is a micrometre."""


@dataclass(frozen=True)
class Verified:
    """Result of testing a model on later poses.

    verdict: "holds", also if only the set-up moved during the session; "drifted"; "another machine", if the model is
    hardly better than nominal geometry and few changes do not explain the error.
    found: residuals with the model's tool point. near: residuals for the identification of changes, after refitting the
    tool point if it is far from the model's.
    alone: 3-D error, m, of nominal geometry with fitted registration and tool point.
    alone_turn: orientation error of nominal geometry, rad, NaN without measured orientation.
    outside: inputs beyond the model's ranges.
    instrument: True if the measurements contain the model's instrument errors; None for a model without them.
    tried: all tested changes. suspect: the most probable change if it is more probable than no change.
    explained: True if the residual without the changes is not significant. complete: True if it is not significant, or
    hardly a part of the residual, so that the model can be repaired.
    """

    verdict: Verdict
    found: Recheck
    near: Recheck
    alone: Array
    alone_turn: Array
    outside: tuple[str, ...]
    changes: tuple[NamedChange, ...]
    visible: tuple[Visible, ...]
    instrument: bool | None
    tried: tuple[PossibleChange, ...]
    suspect: PossibleChange | None
    explained: bool = False
    complete: bool = False

    @property
    def session(self) -> Session:
        """The fitted model with the registration of the later poses."""
        return self.found.session


def afterwards(saved: SavedModel, dataset: Dataset) -> IntArray:
    """Return the rows of a table that the model was not fitted to, without copies of rows; raise InputError if there
    are none."""
    every = np.flatnonzero(~copies(dataset))
    if saved.measured is None:
        return every
    known, here = saved.measured.dataset, {**dataset.readings, **dataset.distances}
    there = {**known.readings, **known.distances}
    shared = sorted(set(here) & set(there))
    fitted, rows = (
        np.nan_to_num(np.column_stack([d.q, d.position, d.rotation, *(v[name] for name in shared)]), nan=UNMEASURED)
        for d, v in ((known, there), (dataset, here))
    )
    apart = KDTree(fitted).query(rows, p=np.inf, distance_upper_bound=EQUAL)[0]
    fresh: IntArray = every[apart[every] > EQUAL]
    if not len(fresh):
        raise InputError(f"{dataset.source} is the table the model was fitted to; expected poses measured afterwards")
    return fresh


def verified(saved: SavedModel, dataset: Dataset, significance: float = SIGNIFICANCE) -> Verified:
    """Test a model on later poses `dataset`. significance: significance level of each of the two tests.

    A model is valid ("holds") if neither its whole residual nor a possible change is significant; see
    `application.recheck` and `application.possible_changes`. Raises InputError if the poses do not fit the model, are
    too few, or have mixed-up columns.
    """
    _check_units(saved, dataset)
    found, instrument = _with_or_without_the_instrument(saved, dataset)
    if (share := np.sqrt(found.chi_square / found.degrees)) < COMPUTED:
        raise InputError(
            f"{dataset.source}: the positions were computed, not measured: they differ from the predictions of "
            "the model by "
            f"{share:.2g} of the noise; expected positions measured afterwards"
        )
    alone = calibrate(ErrorModel(saved.mechanism, ()), found.session.poses)
    for text in computed(root_mean_square(alone.fitted_error), found.session.poses.dataset):
        raise InputError(f"{dataset.source}: {text}")
    placed = _near(found, alone.placement)
    judged = _Judged.of(placed, _offered(placed), significance)
    judged = _with_divided_rows(judged, found, significance)
    near, tried, named, left = judged.near, judged.tried, judged.named, judged.left
    moved = _moved_tools(saved, judged)
    session = found.session
    verdict: Verdict = "holds"
    named = since_the_fit(saved, near, named, tried.changes, significance)
    if moved or any(c.of_the_machine for c in named) or left.chance < significance:
        residual, unknowns = near.problem.residual, near.basis.shape[1]
        useless = np.linalg.norm(residual) / np.sqrt(len(residual) - unknowns) > HALF * alone.sigma
        verdict = "another machine" if useless and not judged.complete else "drifted"
    if verdict != "holds":
        for text in _faults_of_the_table(found):
            raise InputError(f"{dataset.source}: {text}")
    nominal = observe(alone.model, session.poses, alone.theta, alone.placement)
    return Verified(
        verdict=verdict,
        found=found,
        near=near,
        alone=alone.error,
        alone_turn=turn_error(nominal, session.poses.dataset),
        outside=_outside(session),
        changes=() if verdict == "another machine" else (*moved, *named),
        visible=visible(near, tried.changes, significance),
        instrument=instrument,
        tried=tried.changes,
        suspect=suspected(near, tried),
        explained=left.chance >= significance,
        complete=judged.complete,
    )


def _offered(found: Recheck) -> Stack:
    """Stack all possible changes at the whitened rows of a session."""
    return Stack.of(possible_changes(found), len(found.z))


@dataclass(frozen=True)
class _Judged:
    """Changes of a machine.

    near: residuals of the session. left: residuals without the selected changes `named`. nats: log posterior
    probability of the changes and of the outliers, each of which has a displacement of its own.
    """

    near: Recheck
    tried: Stack
    named: tuple[NamedChange, ...]
    left: Recheck
    nothing_else: bool
    nats: float

    @classmethod
    def of(cls, near: Recheck, tried: Stack, significance: float) -> "_Judged":
        """Select among the changes `tried` those that explain the residuals `near`."""
        nats, named, left = changes(near, tried, significance)
        excluded, rows = np.count_nonzero(~near.session.use), len(near.session.use)
        each = np.log(rows) + 0.5 * len(near.problem.residual) / (rows - excluded) * np.log(near.degrees)
        complete = left.chance >= significance and len(named) < MOST
        return cls(near, tried, named, left, complete, nats - excluded * each)

    @property
    def known(self) -> list[PossibleChange]:
        """Selected changes of all rows."""
        called = {change.name for change in self.named if not change.rows}
        return [change for change in self.tried.changes if change.name in called]

    @property
    def complete(self) -> bool:
        """True if the selected changes explain the residual."""
        left, near = (one.chi_square / one.degrees for one in (self.left, self.near))
        return self.nothing_else or left < UNEXPLAINED * near


def _with_divided_rows(judged: _Judged, found: Recheck, significance: float) -> _Judged:
    """Select the changes again, with a division of the rows between two values of a constant, if the changes of all
    rows do not explain the residuals, if they are several, or if rows are outliers.

    The division is sought without the changes of all rows, then with the changes that are selected given the division,
    until these changes stay the same.
    """
    if judged.left.chance >= significance and found.session.use.all() and len(judged.named) < 2:
        return judged
    known: Sequence[PossibleChange] = ()
    offered = {judged.near.session.use.tobytes(): judged.tried}
    for _ in range(DIVISIONS):
        further, division = judged.known, divided(judged.near, known)
        if division is not None:
            use = division.found.session.use.tobytes()
            offered[use] = offered[use] if use in offered else _offered(division.found)
            tried = _Judged.of(division.found, offered[use].plus(division.changes), significance)
            in_rows = [change.name for change in tried.named if change.rows]
            better = tried.complete and tried.nats > judged.nats and not division.scattered
            if better and in_rows and division.determines(in_rows) and _within_ranges(found, tried.named):
                return tried
            further = tried.known or further
        if [change.name for change in further] == [change.name for change in known]:
            break
        known = further
    return judged


def _within_ranges(found: Recheck, named: Sequence[NamedChange]) -> bool:
    """Return whether every division of the rows has a row within the ranges of the model: beyond, the model is none."""
    rows = found.session.poses.dataset.row.tolist()
    inside = {row for row, text in zip(rows, _outside(found.session), strict=True) if not text}
    return all(not inside.isdisjoint(change.rows) for change in named if change.rows)


def _outside(session: Session) -> tuple[str, ...]:
    """Return the inputs of each later pose that are beyond the ranges of the model."""
    return out_of_range(session.saved, session.poses.states.seen_at(session.observed.tip[:, :3, 3]))


def _check_units(saved: SavedModel, dataset: Dataset) -> None:
    """Raise InputError for measurements in a unit whose noise the model does not contain."""
    fitted = () if saved.measured is None else observations(saved.measured.dataset)
    read = {kind.unit: kind.name for kind in fitted if kind.readings.any()} or {"m": "positions"}
    for kind in observations(dataset):
        if kind.readings.any() and not isinstance(kind, Orientation) and kind.unit not in read:
            raise InputError(
                f"{dataset.source}: the model was fitted to {' and '.join(read.values())}, so that the "
                f"noise of {kind.name} is unknown; expected a table of the same instrument, or a model fitted to both"
            )


def _with_or_without_the_instrument(saved: SavedModel, dataset: Dataset) -> tuple[Recheck, bool | None]:
    """Return the later session without or with the instrument errors of the model, whichever fits better.

    The later session may use another instrument, or another position of the instrument.
    """
    without = recheck(settled(usable(saved), dataset, saved))
    if not any(e.of_the_instrument and v for e, v in zip(saved.model.effects, saved.theta, strict=True)):
        return without, None
    beside = recheck(settled(usable(saved, as_measured=True), dataset, saved))
    same = beside.chi_square < without.chi_square
    return (beside if same else without), same


def _near(found: Recheck, start: Placement) -> Recheck:
    """Refit the tool point of a later session if the error is too large for a linear test and the refit halves the
    error; otherwise return the session unchanged."""
    session = found.session
    far = root_mean_square(session.errors[session.use])
    if far < FAR:
        return found
    again = recheck(refitted(replace(session, saved=replace(session.saved, placement=start), tool=True)))
    return again if root_mean_square(again.session.errors[again.session.use]) < HALF * far else found


def _faults_of_the_table(found: Recheck) -> Iterator[str]:
    """Yield a sentence if rounded numbers or a delay of the positions explain the residual of a model."""
    session = found.session
    left = root_mean_square(session.errors[session.use]) * np.sqrt(len(found.z) / found.degrees)
    data = session.poses.dataset
    yield from rounded(session.saved.mechanism, session.observed, data, left, found.degrees)
    rate = path_rates(session.saved.mechanism, data)
    if rate is not None:
        rows = found.rows_of(zeros(session.saved.mechanism))
        column = found.whitened(moved_by_rates(rows, found.problem, rate)[:, None])
        late = float(column[:, 0] @ found.z / np.sum(column**2))
        share = np.sqrt(found.without(column).chi_square / found.chi_square)
        yield from filter(None, [delayed(late, data, share * left, left)])


@dataclass(frozen=True)
class _Placed:
    """Refitted registration and tools of a session, from a common fit with the selected changes.

    names: names of the parameters. step: change of the session's registration and tools, m, rad. covariance: of `step`.
    """

    names: tuple[str, ...]
    step: Array
    covariance: Array

    @classmethod
    def of(cls, judged: _Judged) -> "_Placed":
        """Fit registration, refitted tools and the selected changes by weighted least squares."""
        near, called = judged.near, {change.name for change in judged.named}
        session, changed = with_changes(
            near.session, near.problem, [c for c in judged.tried.changes if c.name in called]
        )
        problem = session.problem
        columns = np.hstack([problem.columns[:, session.anew(problem)], problem.columns @ changed])
        columns, residual = (near.spread.whiten(near.blocks.means(v)) for v in (columns, problem.residual))
        inverse = np.linalg.pinv(columns, rcond=1e-12)
        count = len(near.anew)
        return cls(near.anew, (inverse @ residual)[:count], (inverse @ inverse.T)[:count, :count])

    def displaced(self, name: str, key: str, before: Array, after: Array) -> NamedChange:
        """Return the displacement, m, of the frame `key`."""
        unit = np.eye(len(self.names))
        rows = unit[[self.names.index(f"{key} {axis}") for axis in AXES[:3]]]
        off = after[:3, :3].T @ (after[:3, 3] - before[:3, 3]) + rows @ self.step
        size = float(np.linalg.norm(off))
        stderr = float(np.sqrt(off @ rows @ self.covariance @ rows.T @ off)) / max(size, np.finfo(float).tiny)
        return NamedChange(name, "tool", size, stderr, "m", 0.0, ())


def _moved_tools(saved: SavedModel, judged: _Judged) -> tuple[NamedChange, ...]:
    """Return the displacements, m, of refitted tool points and of objects on links from their positions in the
    model."""
    session = judged.near.session
    if not session.tool:
        return ()
    now, placed = session.saved.placement, _Placed.of(judged)
    keys = {name: f"tool {name}".rstrip() for name in now.tool}
    moved = [
        placed.displaced(f"{keys[name]} point", keys[name], saved.placement.tool[name], now.tool[name])
        for name in now.tool
    ]  # fmt: skip
    for kind, key in kept_by(saved, session.poses.dataset):
        if kind.own[key] == AXES:
            before, after = (frame_of(placement.anchors[key]) for placement in (saved.placement, now))
            moved.append(placed.displaced(f"place of {key}", key, before, after))
    return tuple(change for change in moved if change.value > FAR and change.stderr)


def misses_of(session: Session, targets: Dataset) -> Array:
    """Return the distance of the measured points from the targets of a compensation, m.

    The targets are the points of the nominal arm with the model's tool at the joint values of `targets`, in the
    registration of the session.
    """
    saved = at_end(session.saved)
    labels = {**targets.labels, **{c: session.poses.dataset.label(c) for c in ("setup", "tool")}}
    root = tips(saved, replace(targets, labels=labels), nominal=True)[1].tip
    wanted = (saved.placement.roots(session.poses.dataset) @ root)[:, :3, 3]
    return np.asarray(np.linalg.norm(session.poses.dataset.position - wanted, axis=1))

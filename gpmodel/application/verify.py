"""Test a fitted model on later poses, and identify what changed if the test fails.

The registration is fitted again, because an instrument is never set up at an identical position. The verification does
not refit the tool point of the model.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from gpmodel.application.kinematics import tips
from gpmodel.application.model_file import SavedModel, counted
from gpmodel.application.named_changes import MOST, SIGNIFICANCE, NamedChange, Visible, changes, suspected, visible
from gpmodel.application.possible_changes import SET_UP, PossibleChange, possible_changes
from gpmodel.application.recheck import Recheck, Session, kept_by, recheck, settled
from gpmodel.application.usable import at_end, out_of_range, usable
from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.checks.readings import computed
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import AXES
from gpmodel.model.error_model import ErrorModel, Placement, observe, turn_error
from gpmodel.model.observation import observations
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.numerics.se3 import frame_of
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
    instrument: True if the measurements contain the instrument errors of the model; None if the model has none.
    tried: all tested changes. suspect: the most probable change, if a change is more probable than none.
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

    @property
    def session(self) -> Session:
        """The fitted model with the registration of the later poses."""
        return self.found.session


def afterwards(saved: SavedModel, dataset: Dataset) -> IntArray:
    """Return the rows of a table that the model was not fitted to; raise InputError if there are none."""
    every = np.arange(len(dataset))
    if saved.measured is None:
        return every
    known, here = saved.measured.dataset, {**dataset.readings, **dataset.distances}
    there = {**known.readings, **known.distances}
    shared = sorted(set(here) & set(there))
    fitted, rows = (
        [row.tobytes() for row in np.column_stack([d.q, d.position, d.rotation, *(v[name] for name in shared)]) + 0.0]
        for d, v in ((known, there), (dataset, here))
    )
    fresh = every[[row not in set(fitted) for row in rows]] if len(rows) else every
    if not len(fresh):
        raise InputError(f"{dataset.source} is the table the model was fitted to; expected poses measured afterwards")
    return fresh


def verified(saved: SavedModel, dataset: Dataset, significance: float = SIGNIFICANCE) -> Verified:
    """Test a model on later poses `dataset`. significance: significance level of each of the two tests.

    The model is valid ("holds") if neither the whole residual nor a possible change is significant; see
    `application.recheck` and `application.possible_changes`. Raises InputError if the poses do not fit the model, are
    too few, or have mixed-up columns.
    """
    found, instrument = _with_or_without_the_instrument(saved, _as_counted(saved, dataset))
    if (share := np.sqrt(found.chi_square / found.degrees)) < COMPUTED:
        raise InputError(
            f"{dataset.source}: the positions were computed, not measured: they differ from the predictions of "
            "the model by "
            f"{share:.2g} of the noise; expected positions measured afterwards"
        )
    alone = calibrate(ErrorModel(saved.mechanism, ()), found.session.poses)
    for text in computed(root_mean_square(alone.fitted_error), found.session.poses.dataset):
        raise InputError(f"{dataset.source}: {text}")
    near = _near(found, alone.placement)
    tried = possible_changes(near)
    moved = _moved_tools(saved, near) if near.session.tool else ()
    named, left = changes(near, tried, significance)
    session = found.session
    verdict: Verdict = "holds"
    of_the_machine = tuple(c for c in named if c.kind != SET_UP)
    if moved or of_the_machine or left.chance < significance:
        residual, unknowns = near.problem.residual, near.basis.shape[1]
        useless = np.linalg.norm(residual) / np.sqrt(len(residual) - unknowns) > HALF * alone.sigma
        nothing_else = left.chance >= significance and len(named) < MOST
        complete = nothing_else or left.chi_square / left.degrees < UNEXPLAINED * near.chi_square / near.degrees
        verdict = "another machine" if useless and not complete else "drifted"
    nominal = observe(alone.model, session.poses, alone.theta, alone.placement)
    points = session.observed.tip[:, :3, 3]
    return Verified(
        verdict=verdict,
        found=found,
        near=near,
        alone=alone.error,
        alone_turn=turn_error(nominal, session.poses.dataset),
        outside=out_of_range(session.saved, session.poses.states.seen_at(points)),
        changes=() if verdict == "another machine" else (*moved, *named),
        visible=visible(near, tried, significance),
        instrument=instrument,
        tried=tried,
        suspect=suspected(near, tried),
    )


def _as_counted(saved: SavedModel, dataset: Dataset) -> Dataset:
    """Return the table with pixels and angles weighed as in the table that the model was fitted to.

    Raises InputError for measurements in a unit whose noise the model does not contain.
    """
    fitted = () if saved.measured is None else observations(saved.measured.dataset)
    read = {kind.unit: kind.name for kind in fitted if kind.readings.any()} or {"m": "positions"}
    for kind in observations(dataset):
        if kind.readings.any() and kind.metres and kind.unit not in read:
            raise InputError(
                f"{dataset.source}: the model was fitted to {' and '.join(read.values())}, so that the "
                f"noise of {kind.name} is unknown; expected a table of the same instrument, or a model fitted to both"
            )
    return counted(dataset, {kind.name: kind.metres for kind in fitted if kind.metres})


def _with_or_without_the_instrument(saved: SavedModel, dataset: Dataset) -> tuple[Recheck, bool | None]:
    """Return the later session without or with the instrument errors of the model, whichever fits better.

    The later session may use another instrument, or another position of the instrument.
    """
    without = recheck(settled(usable(saved), dataset))
    if not any(e.of_the_instrument and v for e, v in zip(saved.model.effects, saved.theta, strict=True)):
        return without, None
    beside = recheck(settled(usable(saved, as_measured=True), dataset))
    same = beside.chi_square < without.chi_square
    return (beside if same else without), same


def _near(found: Recheck, start: Placement) -> Recheck:
    """Refit the tool point of a later session if the error is too large for a linear test and the refit halves the
    error; otherwise return the session unchanged."""
    session = found.session
    far = root_mean_square(session.errors[session.use])
    if far < FAR:
        return found
    again = recheck(settled(session.saved, session.poses.dataset, start))
    return again if root_mean_square(again.session.errors[again.session.use]) < HALF * far else found


def _moved_tools(saved: SavedModel, found: Recheck) -> tuple[NamedChange, ...]:
    """Return the displacements, m, of tool points and of objects on links relative to their positions in the model."""
    (names, covariance), now = found.anew, found.session.saved.placement
    moved = {f"tool{f' {n}' if n else ''}": (saved.placement.tool[n], frame) for n, frame in now.tool.items()}
    titles = {title: f"{title} point" for title in moved}
    for kind, key in kept_by(saved, found.session.poses.dataset):
        if kind.own[key] == AXES:
            moved[key] = frame_of(saved.placement.anchors[key]), frame_of(now.anchors[key])
            titles[key] = f"place of {key}"
    out = []
    for title, (before, after) in moved.items():
        at = [names.index(f"{title} {axis}") for axis in AXES[:3]]
        off, own = after[:3, :3].T @ (after[:3, 3] - before[:3, 3]), covariance[np.ix_(at, at)]
        size = float(np.linalg.norm(off))
        if size > FAR and own.any():
            out.append(NamedChange(titles[title], "tool", size, float(np.sqrt(off @ own @ off) / size), "m", 0.0, ()))
    return tuple(out)


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

"""Add possible changes of a machine to its model, and compute the motion of the tool by each change."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gpmodel.application.possible_changes import PossibleChange
from gpmodel.application.predict import point_columns
from gpmodel.application.recheck import Session
from gpmodel.arrays import Array
from gpmodel.calibration.linearise import Linearised
from gpmodel.calibration.result import Covariance
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses, observe


def with_changes(session: Session, problem: Linearised, changes: Sequence[PossibleChange]) -> tuple[Session, Array]:
    """Add possible changes of the machine to a model; return the model and one column D per parameter of the changes.

    The matrix D has its columns in the order of the changes.
    """
    saved, count = session.saved, problem.placement
    known, added = [effect.terms for effect in saved.model.effects], list[Effect]()
    columns: list[dict[int, float]] = []
    for change in changes:
        for effect in change.effects:
            if effect.terms not in known:
                known.append(effect.terms)
                added.append(effect)
            columns.append({count + known.index(effect.terms): 1.0})
        if change.kind == "size" and change.at:
            columns.append({k: float(saved.theta[k - count]) for k in change.at})
        else:
            columns += [{k: 1.0} for k in change.at]
    model = ErrorModel(saved.mechanism, (*saved.model.effects, *added))
    theta, stderr = (
        np.append(v, np.full(len(added), fill)) for v, fill in ((saved.theta, 0.0), (saved.stderr, np.nan))
    )
    changed = np.zeros((count + len(theta), len(columns)))
    for column, entries in enumerate(columns):
        changed[list(entries), column] = list(entries.values())
    return replace(session, saved=replace(saved, model=model, theta=theta, stderr=stderr)), changed


def motions(
    session: Session, problem: Linearised, changes: Sequence[PossibleChange], poses: Poses
) -> tuple[Array, Array]:
    """Return the derivatives (poses, 3, columns) of the measured point with respect to registration and possible
    changes."""
    changed, columns = with_changes(session, problem, changes)
    names = problem.placement_names
    size = problem.placement + len(changed.saved.theta)
    centre = problem.observed.tip[:, :3, 3].mean(axis=0)
    saved = replace(changed.saved, covariance=Covariance(np.zeros((size, size)), names, centre))
    every = point_columns(saved, poses, observe(saved.model, poses, saved.theta, saved.placement))
    placed = [k for k, name in enumerate(names) if name.startswith("registration")]
    return every[:, :, placed], every @ columns

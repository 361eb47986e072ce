"""What was found, fitted to all poses, the constants inside it as well."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from gpmodel.arrays import Mask
from gpmodel.calibration.result import Calibration, without_outlier_marks
from gpmodel.discovery.inner_constants import InnerChange, inner_changes
from gpmodel.discovery.refinement import WINDOW, profile, refined_fit
from gpmodel.discovery.result import FinalFit
from gpmodel.discovery.state import State
from gpmodel.evidence.residual import Residual, residual_of
from gpmodel.families.candidate import Candidate
from gpmodel.families.inner import FittedConstant
from gpmodel.model.error_model import ErrorModel
from gpmodel.table.split import JUDGED


def final_fit(state: State, fit: Calibration) -> FinalFit:
    """All that was found fitted to all poses, inner constants moved to where these have them most likely.

    Changes of the constants are further unknowns of the fit, so that every deviation knows of them.
    """

    def to_all(found: Sequence[Candidate], start: Calibration) -> Calibration:
        again = replace(without_outlier_marks(start), condition_limit=fit.condition_limit)
        return state.to_all(state.model(found), again)

    def left(there: Calibration) -> Residual:
        return residual_of(there, state.poses, state.criteria, JUDGED, beside)

    beside = _beside_events(state)

    refined, settled = refined_fit(to_all, left, {c.name: c for c in state.found}, to_all(state.found, fit))
    found = tuple(refined.values())
    changes = [inner_changes(c, settled, state.poses.states) for c in found]
    located = tuple(_located(c, partial(left, settled)) for c in found)
    whole, further = settled, tuple(change.effect for own in changes for change in own)
    if further or [c.name for c in located] != [c.name for c in found]:
        whole = state.to_all(ErrorModel(state.mechanism, (*state.model(located).effects, *further)), settled)
    known = [(*_known(own, whole), *_events(c)) for own, c in zip(changes, located, strict=True)]
    return FinalFit(whole, located, tuple(known))


def _beside_events(state: State) -> Mask:
    """The poses (N,) near an event: on the wrong side of it a good one looks like an outlier."""
    rows = state.poses.states["row"]
    inner = [c.inner for c in state.found if c.inner]
    events = [c.value for own in inner for c in own.constants if c.whole]
    return np.any([np.abs(rows - event) <= WINDOW for event in events], axis=0) if events else np.zeros(len(rows), bool)


def _known(changes: Sequence[InnerChange], fit: Calibration) -> Iterator[FittedConstant]:
    """The constants that a fit corrected, with their deviations."""
    at = {e.name: k for k, e in enumerate(fit.model.effects)}
    for change in changes:
        k, constant = at[change.effect.name], change.constant
        deviation = float(fit.stderr[k]) if fit.kept[k] else None
        yield FittedConstant(constant.name, constant.unit, constant.value + float(fit.theta[k]), deviation)


def _located(candidate: Candidate, left: Callable[[], Residual]) -> Candidate:
    """The candidate with the rows that its event may be, if it has one. left: what the model leaves."""
    inner = candidate.inner
    if inner is None or not any(c.whole for c in inner.constants):
        return candidate
    rows = profile(left().without(candidate.effects), inner)
    constants = tuple(replace(c, rows=rows.interval) if c.whole and rows else c for c in inner.constants)
    return candidate.at(replace(inner, constants=constants))


def _events(candidate: Candidate) -> Iterator[FittedConstant]:
    """The row of its event, if it has one, with those that may be it."""
    for constant in candidate.inner.constants if candidate.inner else ():
        if constant.rows:
            yield FittedConstant(constant.name, constant.unit, constant.value, None, *constant.rows)

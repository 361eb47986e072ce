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


def final_fit(state: State, fit: Calibration) -> FinalFit:
    """All that was found fitted to all poses, inner constants moved to where these have them most likely.

    Changes of the constants are further unknowns of the fit, so that every deviation knows of them.
    """

    def to_all(found: Sequence[Candidate], start: Calibration) -> Calibration:
        again = replace(without_outlier_marks(start), condition_limit=fit.condition_limit)
        return state.to_all(state.model(found), again)

    def left(there: Calibration) -> Residual:
        return residual_of(there, state.poses, state.criteria, state.seed, beside)

    beside = _beside_events(state)

    refined, settled = refined_fit(to_all, left, {c.name: c for c in state.found}, to_all(state.found, fit))
    found = tuple(refined.values())
    changes = [inner_changes(c, settled, state.poses.states) for c in found]
    events = [_event(c, partial(left, settled)) for c in found]
    told = tuple(_told(c, rows) for c, rows in zip(found, events, strict=True))
    whole, further = settled, tuple(change.effect for own in changes for change in own)
    if further or told != found:
        whole = state.to_all(ErrorModel(state.mechanism, (*state.model(told).effects, *further)), settled)
    known = [(*_known(own, whole), *rows) for own, rows in zip(changes, events, strict=True)]
    return FinalFit(whole, told, tuple(known))


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


def _event(candidate: Candidate, left: Callable[[], Residual]) -> tuple[FittedConstant, ...]:
    """The row of its event, if it has one, with those that may be it. left: what the model leaves."""
    event = next((c for c in candidate.inner.constants if c.whole), None) if candidate.inner else None
    rows = profile(left().without(candidate.effects), candidate.inner) if candidate.inner and event else None
    return (FittedConstant(event.name, event.unit, event.value, None, *rows.interval),) if event and rows else ()


def _told(candidate: Candidate, events: Sequence[FittedConstant]) -> Candidate:
    """The candidate with the interval of its event's row in its name and in those of its effects."""
    inner = candidate.inner
    if inner is None or not any(known.high != known.low for known in events):
        return candidate
    for constant, known in zip((c for c in inner.constants if c.whole), events, strict=True):
        rows = f"{constant.symbol} ({known.low} to {known.high})"
        template = tuple(replace(e, name=e.name.replace(constant.symbol, rows)) for e in inner.template)
        inner = replace(inner, name=inner.name.replace(constant.symbol, rows), template=template)
    return candidate.at(inner)

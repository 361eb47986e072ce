"""What was found, fitted to all poses, the constants inside it as well."""

from collections.abc import Sequence
from dataclasses import replace

from gpmodel.calibration.result import Calibration
from gpmodel.discovery.inner_constants import InnerChange, inner_changes
from gpmodel.discovery.refinement import profile, refined_fit
from gpmodel.discovery.residual import Residual, residual_of
from gpmodel.discovery.result import FinalFit, Known
from gpmodel.discovery.state import State
from gpmodel.families.candidate import Candidate
from gpmodel.model.error_model import ErrorModel


def final_fit(state: State, fit: Calibration) -> FinalFit:
    """All that was found fitted to all poses, inner constants moved to where these have them most likely.

    Changes of the constants are further unknowns of the fit, so that every deviation knows of them.
    """

    def to_all(found: Sequence[Candidate], start: Calibration) -> Calibration:
        return state.to_all(state.model(found), replace(start, condition_limit=fit.condition_limit))

    def left(there: Calibration) -> Residual:
        return residual_of(there, state.poses, state.criteria, state.seed)

    refined, settled = refined_fit(to_all, left, {c.name: c for c in state.found}, to_all(state.found, fit))
    found = tuple(refined.values())
    changes = [inner_changes(c, settled, state.poses.states) for c in found]
    further = tuple(change.effect for own in changes for change in own)
    whole = settled
    if further:
        whole = state.to_all(ErrorModel(state.mechanism, (*settled.model.effects, *further)), settled)
    events = [_events(left(settled), c) for c in found]
    known = [(*_known(own, whole), *rows) for own, rows in zip(changes, events, strict=True)]
    return FinalFit(whole, found, tuple(known))


def _known(changes: Sequence[InnerChange], fit: Calibration) -> list[Known]:
    """The constants that a fit corrected, with their deviations."""
    at = {e.name: k for k, e in enumerate(fit.model.effects)}
    out = []
    for change in changes:
        k, constant = at[change.effect.name], change.constant
        out.append(Known(constant.name, constant.unit, constant.value + float(fit.theta[k]), float(fit.stderr[k])))
    return out


def _events(left: Residual, candidate: Candidate) -> list[Known]:
    """The row of an event and those that may be it."""
    events = [c for c in candidate.inner.constants if c.whole] if candidate.inner else []
    rows = profile(left.without(candidate.effects), candidate.inner) if candidate.inner and events else None
    return [Known(c.name, c.unit, c.value, None, *rows.interval) for c in events if rows]

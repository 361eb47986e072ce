"""Fit the model with all found effects to all poses, including the constants inside formulas."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from gpmodel.arrays import Mask
from gpmodel.calibration.result import Calibration, without_outlier_marks
from gpmodel.discovery.refinement import STEP, WINDOW, InnerChange, inner_changes, moved, profile, refined_fit
from gpmodel.discovery.state import FinalFit, State
from gpmodel.evidence.residual import Residual, residual_of
from gpmodel.families.candidate import Candidate
from gpmodel.families.inner import Constant, FittedConstant
from gpmodel.families.outline import PRINTED, Outline, candidate_outline, in_words
from gpmodel.table.blocks import FOLD_SEED

STEPS = 6
"""Largest number of Gauss-Newton steps for the constants inside formulas."""
SETTLED = 0.1
"""Largest step of any constant inside a formula, in standard errors, at which the iteration ends: an error of 0.1
standard errors raises a mean square error by 1 %."""


def final_fit(state: State, fit: Calibration) -> FinalFit:
    """Fit all findings to all poses, including the constants inside their basis functions.

    Changes of the constants are unknowns of the fit, so that every standard error includes the uncertainty of the
    constants. Source: Seber and Wild (1989), 2.1.
    """

    def to_all(found: Sequence[Candidate], start: Calibration) -> Calibration:
        again = replace(without_outlier_marks(start), condition_limit=fit.condition_limit)
        return state.to_all(state.model(found), again)

    def left(there: Calibration) -> Residual:
        return residual_of(there, state.poses, state.criteria, FOLD_SEED, beside)

    beside = _beside_events(state)

    refined, settled = refined_fit(to_all, left, {c.name: c for c in state.found}, to_all(state.found, fit))
    located = tuple(_located(c, partial(left, settled)) for c in refined.values())
    theta = [settled.values_of(c.effects) for c in refined.values()]
    found, changes, whole = _settled(state, located, theta, settled)
    units = state.poses.states.units
    known = [(*constants_in_words(c, own, whole, units), *_events(c)) for c, own in zip(found, changes, strict=True)]
    moving = {c.name: tuple(change.effect for change in own) for c, own in zip(found, changes, strict=True)}
    return FinalFit(whole, found, tuple(known), moving)


def _settled(
    state: State, found: Sequence[Candidate], theta: list[list[float]], fit: Calibration
) -> tuple[tuple[Candidate, ...], list[tuple[InnerChange, ...]], Calibration]:
    """Fit the constants inside candidates to all poses by Gauss-Newton steps; return the candidates, changes and fit.

    Each Gauss-Newton step adds the fitted changes to the constants. After convergence the constants' changes are zero,
    with standard errors. Constants that do not converge keep their initial values, without standard errors. theta:
    coefficients of each candidate's effects in `fit`.
    """
    moving, here = tuple(found), fit
    for _ in range(STEPS):
        named = in_words(moving, state.poses.states.units)
        changes = [inner_changes(c, own, state.poses.states) for c, own in zip(named, theta, strict=True)]
        further = tuple(change.effect for own in changes for change in own)
        here = state.to_all(state.model(named, further), here)
        count = len(here.theta) - len(further)
        steps, deviations = (values[count:][here.free[count:]] for values in (here.theta, here.stderr))
        if np.all(np.abs(steps) <= SETTLED * deviations):
            settled = np.where(np.arange(len(here.theta)) < count, here.theta, 0.0)
            return named, changes, replace(here, theta=settled)
        theta = [here.values_of(c.effects) for c in named]
        moving = tuple(moved(c, _known(own, here)) for c, own in zip(moving, changes, strict=True))
    named = in_words(found, state.poses.states.units)
    return named, [()] * len(named), state.to_all(state.model(named), fit)


def _known(changes: Sequence[InnerChange], fit: Calibration) -> dict[Constant, float]:
    """Add the changes that a fit has estimated to the constants inside candidates."""
    steps = fit.values_of([change.effect for change in changes])
    return {c.constant: c.constant.value + step for c, step in zip(changes, steps, strict=True)}


def _beside_events(state: State) -> Mask:
    """Mark poses near an event in time, where a good pose on the wrong side of the event has a large residual."""
    rows = state.poses.states["row"]
    inner = [c.inner for c in state.found if c.inner]
    events = [c.value for own in inner for c in own.constants if c.whole]
    return np.any([np.abs(rows - event) <= WINDOW for event in events], axis=0) if events else np.zeros(len(rows), bool)


def _located(candidate: Candidate, left: Callable[[], Residual]) -> Candidate:
    """Add the 95 % confidence interval of the row of a candidate's event. left: function from a fit to its residual."""
    inner = candidate.inner
    if inner is None or not any(c.whole for c in inner.constants):
        return candidate
    rows = profile(left().without(candidate.effects), inner)
    constants = tuple(replace(c, rows=rows.interval) if c.whole and rows else c for c in inner.constants)
    return candidate.at(replace(inner, constants=constants))


def _events(candidate: Candidate) -> Iterator[FittedConstant]:
    """Yield the table row at which a candidate's event occurs, if any, with the confidence interval of the row."""
    for constant in candidate.inner.constants if candidate.inner else ():
        if constant.rows:
            yield FittedConstant(constant.name, constant.unit, constant.value, None, *constant.rows)


def constants_in_words(
    candidate: Candidate, changes: Sequence[InnerChange], fit: Calibration, units: Mapping[str, str]
) -> Iterator[FittedConstant]:
    """Yield the constants inside a candidate with their standard errors; for a bump or step its position and width.

    fit: fit to all poses, with the changes of the constants among its unknowns. units: unit of each input variable.
    """
    at = [e.name for e in fit.model.effects]
    own = [at.index(change.effect.name) for change in changes]
    constants, deviations = [change.constant for change in changes], np.where(fit.free[own], fit.stderr[own], np.inf)
    drawn = candidate_outline(candidate)
    if drawn is None:
        for constant, deviation in zip(constants, deviations.tolist(), strict=True):
            yield FittedConstant(
                constant.name, constant.unit, constant.value, deviation if deviation < np.inf else None
            )
        return
    factor, unit = PRINTED.get(units[drawn.of], (1.0, units[drawn.of]))
    slopes = np.array([_slope(candidate, constant) for constant in constants]).reshape(-1, 2)
    known = bool(changes) and bool(np.isfinite(deviations).all())
    covariance = fit.correlation[np.ix_(own, own)] * np.outer(deviations, deviations) if known else np.zeros((0, 0))
    spread = factor * np.sqrt(np.diag(slopes.T @ covariance @ slopes)) if known else (None, None)
    for name, value, deviation in zip(("position", "width"), (drawn.at, drawn.width), spread, strict=True):
        yield FittedConstant(name, unit, factor * value, None if deviation is None else float(deviation))


def _slope(candidate: Candidate, constant: Constant) -> tuple[float, float]:
    """Return the derivatives of position and width of a bump or step with respect to a constant in its formula."""
    beside = [candidate_outline(moved(candidate, {constant: constant.value * (1.0 + s)})) for s in (-STEP, STEP)]
    below, above = (o or Outline("", "", math.nan, math.nan) for o in beside)
    step = 2.0 * STEP * constant.value
    return (above.at - below.at) / step, (above.width - below.width) / step

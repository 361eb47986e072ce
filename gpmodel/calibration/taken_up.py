"""The gauge of the instrument: its effects act in the part that no rigid motion of the instrument takes up.

With D (M, K) the columns of the instrument's effects, P those of registrations and tools and G = P⁺ D, an error θ D of
the readings is P G θ + (D - P G) θ. The first part is where robot and tool are, the second the instrument's. A fit
leaves the split open: its readings say the sum alone.
"""

from dataclasses import replace

import numpy as np

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.iterate import Fitted, Fitting, iterate
from gpmodel.calibration.linearise import Linearised
from gpmodel.calibration.placing import placement_after
from gpmodel.model.effect import REGISTRATION, TOOL, Effect, TakenUp
from gpmodel.model.error_model import ErrorModel, Placement

STEPS = 10
"""Largest number of steps of the split; three are usual."""

SETTLED = 1e-8
"""Metres that a last step moves a reading by: what instruments resolve is a hundred times that."""

WEAKEST = 1e-3
"""Least singular value of the columns of registration and tool, of length one, along which they take up anything: a
millimetre of readings would be a metre of them."""


def with_taken_up(model: ErrorModel, known: ErrorModel) -> ErrorModel:
    """The model with its effects in the gauge that a known model has them in."""
    there = {(e.name, e.terms): e.taken_up for e in known.effects if e.taken_up}
    if not there:
        return model
    effects = tuple(replace(e, taken_up=there.get((e.name, e.terms), e.taken_up)) for e in model.effects)
    return replace(model, effects=effects)


def split(fitting: Fitting, fitted: Fitted, kept: Mask) -> tuple[Fitting, Fitted]:
    """The fit with the rigid part of its instrument's effects in registrations and tools, its readings the same.

    kept: effects (E,) that are fitted.
    """
    of_it = np.array([e.of_the_instrument for e in fitting.model.effects], dtype=bool)
    own = np.flatnonzero(of_it & kept & (fitted.theta != 0.0))
    if not len(own):
        return fitting, fitted
    theta, placement, problem, here = fitted.theta, fitted.placement, fitted.problem, fitting
    for _ in range(STEPS):
        rigid = np.flatnonzero(problem.rigid)
        moved, columns = _moved(here, problem, theta, placement, own), problem.columns[:, problem.placement + own]
        whole = _least(problem.columns[:, rigid], moved[:, None])[:, 0]
        if np.abs(problem.columns[:, rigid] @ whole).max(initial=0.0) < SETTLED:
            break
        shares = _least(problem.columns[:, rigid], columns)
        weight = np.maximum((theta[own] * np.linalg.norm(columns, axis=0)) ** 2, np.finfo(float).tiny)
        shares += np.outer(whole - shares @ theta[own], weight / weight.sum() / theta[own])
        step = np.zeros(problem.placement)
        step[rigid] = whole
        placement = placement_after(problem.observed, placement, step)
        effects = list(here.model.effects)
        for k, share in zip(own, shares.T, strict=True):
            effects[k] = _with(effects[k], problem, share)
        here = replace(here, model=replace(here.model, effects=tuple(effects)))
        problem = here.at(theta, placement)
    again = iterate(here, theta, placement, kept, problem)
    return here, replace(again, status=fitted.status)


def _moved(fitting: Fitting, problem: Linearised, theta: Array, placement: Placement, own: IntArray) -> Array:
    """Return the displacement of the readings by effects (M,), with minus without them; first order with free
    joints.
    """
    if problem.left is not None:
        return np.asarray(problem.columns[:, problem.placement + own] @ theta[own])
    without = theta.copy()
    without[own] = 0.0
    return fitting.beside(problem, without, placement).residual - problem.residual


def _least(columns: Array, target: Array) -> Array:
    """The least-squares solution (P, K) in columns (M, P) of length one, along those directions that do anything."""
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    return np.asarray(np.linalg.lstsq(columns / size, target, rcond=WEAKEST)[0] / size[:, None])


def _with(effect: Effect, problem: Linearised, share: Array) -> Effect:
    """The effect with further rigid motions (R,) taken up.

    Those of a problem turn about the middle of its points, those of an effect about the instrument's origin."""
    known = {(r.of, r.label): np.array(r.twist) for r in effect.taken_up}
    names = [problem.placement_names[k] for k in np.flatnonzero(problem.rigid)]
    centre, data = problem.observed.tip[:, :3, 3].mean(axis=0), problem.poses.dataset
    for of, word in ((REGISTRATION, "registration"), (TOOL, "tool")):
        for label in sorted({*data.label(of).tolist()}):
            at = [k for k, name in enumerate(names) if name.rpartition(" ")[0] == f"{word} {label}".rstrip()]
            twist = np.zeros(6)
            twist[: len(at)] = share[at]
            if of == REGISTRATION:
                twist[:3] -= np.cross(twist[3:], centre)
            if twist.any():
                known[of, label] = known.get((of, label), 0.0) + twist
    return replace(effect, taken_up=tuple(TakenUp(*key, tuple(twist.tolist())) for key, twist in known.items()))

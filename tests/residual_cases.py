"""Ninety poses of a robot with one catalogue effect that the model lacks, and what speaks for each candidate."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from effect_cases import bare, measure, mechanism, sized

from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import Residual, residual_of
from gpmodel.evidence.score import scores
from gpmodel.families import catalogue
from gpmodel.families.candidate import Candidate
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.sites import geometric_effects

NAMES = (
    "base compliance",
    "gear error, 2 per turn, J4",
    "coupling, J4 to J5",
    "axis wobble, J3 Rx",
    "backlash by approach, J3 (approach_J3)",
    "transmission ripple, 5 per turn, J2",
    "thermal drift of the zero, J3 (temperature)",
    "set-up moved after row 41, Tz",
)


def pool() -> tuple[Candidate, ...]:
    arm = mechanism("irb6400r")
    return catalogue.candidates(arm, prepare(arm, bare("irb6400r", 90, 5)).states)


@cache
def seen(planted: str, millimetres: float = 0.25) -> Residual:
    """The residual of ninety poses of a robot with one catalogue effect that the model lacks, or none."""
    data = bare("irb6400r", 90, 5)
    effects = next((c.effects for c in pool() if c.name == planted), ())
    theta = sized("irb6400r", effects, data, millimetres) if effects else ()
    truth = measure("irb6400r", effects, theta, 5, dataset=data)
    fit = calibrate(ErrorModel(truth.model.mechanism, geometric_effects(truth.model.mechanism)), truth.poses)
    return residual_of(fit, truth.poses, Criteria(), 0)


def best_nats(residual: Residual, pool: Sequence[Candidate], trials: Array) -> Array:
    """Return the largest gain (T,), nats, of any candidate on each of several residuals (M + B, T)."""
    return np.array([max(score.nats for score in scores(replace(residual, values=r), pool)) for r in trials.T])

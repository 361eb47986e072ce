"""Ninety poses of a robot with one catalogue effect that the model lacks, and the gain of each candidate."""

from collections.abc import Sequence
from functools import cache

import numpy as np
from effect_cases import bare, measure, mechanism, sized

from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import Residual, residual_of
from gpmodel.evidence.score import CHUNK, NOISE_STEPS, directions, mdl_gain
from gpmodel.evolution.description_length import fit_nats
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
    """Return the largest gain (T,), nats, of any candidate on each of several residuals (M + B, T).

    A twin of `scores` for many residuals at once: columns are projected and decomposed once.
    """
    energy, best = np.sum(trials**2, axis=0), np.full(trials.shape[1], -np.inf)
    for start in range(0, len(pool), CHUNK):
        some = pool[start : start + CHUNK]
        left, shares = residual.projected([e for c in some for e in c.effects])
        ends = np.cumsum([len(c.effects) for c in some])
        for c, end in zip(some, ends, strict=True):
            own = slice(end - len(c.effects), end)
            if shares[own].max() < residual.criteria.scored_share:
                continue
            if c.has_priors:
                u, s = directions(residual, c, left[:, own])
                parts, sigma2, s = (u.T @ trials) ** 2, energy / residual.freedom, s[:, None]
                for _ in range(NOISE_STEPS):
                    sigma2 = (energy - np.sum(s**2 / (s**2 + sigma2) * parts, axis=0)) / residual.freedom
                gain = np.sum(s**2 / (s**2 + sigma2) * parts, axis=0) / energy
                nats = fit_nats(gain, residual.freedom) - 0.5 * np.sum(np.log1p(s**2 / sigma2), axis=0) - c.cost
            else:
                span = np.linalg.svd(left[:, own], full_matrices=False)
                q = span[0][:, span[1] > 1e-10 * span[1][0]]
                gain = np.sum((q.T @ trials) ** 2, axis=0) / energy
                nats = mdl_gain(residual, gain, len(c.effects), c.cost)
            best = np.maximum(best, nats)
    return best

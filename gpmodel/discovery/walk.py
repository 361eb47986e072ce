"""A law in time must beat a random-walk drift of the instrument.

Steps, ramps and exponentials explain much of noise that wanders; a walk explains more, whether it is offered or not.
"""

import numpy as np

from gpmodel.evidence.dependence import reads_a_clock
from gpmodel.evidence.gain import best, fitted, with_own_noise
from gpmodel.evidence.residual import Residual
from gpmodel.evidence.score import directions, scores
from gpmodel.families.candidate import Candidate
from gpmodel.families.instrument import WAVES, instrument_walk
from gpmodel.model.states import States
from gpmodel.selection.group import CAP

FINEST = 32
"""Waves to which a walk is followed. The eight that a finding has leave a fortieth of its variance, in which a step
passes for more than what is left of the walk."""


def is_timed(candidate: Candidate, states: States) -> bool:
    """Whether it is a law of the rows or of the time; curves are none, of which a walk is one."""
    return candidate.kind != "curve" and reads_a_clock(candidate, states)


def beyond_a_walk(residual: Residual, candidate: Candidate) -> float | None:
    """Gain of a timed law beyond that of a random walk, nats, on a residual without either; None for any other."""
    states = residual.poses.states
    if not is_timed(candidate, states):
        return None
    mechanism, finest = residual.calibration.model.mechanism, max(WAVES, min(FINEST, len(states) // 4))
    walks = [walk for waves in {WAVES, finest} for walk in instrument_walk(mechanism, states, waves)]
    most = max((_nats(residual, walk) for walk in walks), default=None)
    return None if most is None else scores(residual, [candidate])[0].nats - most


def _nats(residual: Residual, walk: Candidate) -> float:
    """Gain of a walk at its most likely variance, nats, its standard deviations in proportion to its priors."""
    u, size = directions(residual, walk, residual.projected(walk.effects)[0])
    size = size[:, 0] / np.linalg.norm([e.prior for e in walk.effects])
    sigma2 = residual.sigma**2
    s, q = size[None] ** 2 / sigma2, size[None] * (u.T @ residual.values) / sigma2
    gains, variances = best(s, q, np.array([CAP]))
    own = with_own_noise(gains, fitted(variances, s, q), float(residual.freedom))
    return float(own[0]) - walk.cost

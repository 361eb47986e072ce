"""Errors of a sound machine: constants, compliances and smooth functions of the joints, however large.

A table in a wrong convention differs from the mechanism in another way: by an exact factor of a column, or by errors
that no smooth function of the joints explains.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from gpmodel.arrays import Array
from gpmodel.calibration.linearise import Linearised
from gpmodel.calibration.overall_scale import TOLERANCE
from gpmodel.calibration.result import Calibration, problem_at
from gpmodel.families.angle import harmonics, linear_curves, spectrum
from gpmodel.families.candidate import revolute
from gpmodel.families.catalogue import candidates, catalogue
from gpmodel.mechanism.protocol import AXES, Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import Poses
from gpmodel.model.sites import Site
from gpmodel.model.states import States
from gpmodel.numerics import rank
from gpmodel.numerics.variances import Mixed

YIELDING = ("base_compliance", "joint_compliance")
"""Families of errors of a sound robot with low stiffness: compliances."""
HEALTHY = (*YIELDING, "eccentricity")
"""Families of effects of any size in a sound table: loads and eccentric gears resemble a factor of a joint."""
ORDERS, CORNER = 4, 3.0
"""Number of harmonics of a smooth error of a joint, and the number of the harmonic from which its prior falls off."""
SMOOTH, NOISE = 5e-4, 1e-4
"""Usual size of a smooth error of a joint, rad or m, and usual noise, m. Either weighs as much as one measured value in
the estimated size."""


def smooth_errors(mechanism: Mechanism, states: States) -> Iterator[tuple[Effect, ...]]:
    """Yield the smooth errors of each joint: the effects along its drive, and the effects along all other axes."""
    for joint in revolute(mechanism):
        others = [Site(((f"{joint.name}.moving", axis, 1.0),)) for axis in AXES if axis != joint.drive[0][1]]
        for sites in ([Site(joint.drive)], [site for site in others if site.slot in mechanism.slots]):
            parts = (harmonics("", site, joint.name, "", spectrum(ORDERS, CORNER)) for site in sites)
            yield tuple(effect for part in parts for effect in part)
    for candidate in linear_curves(mechanism, states):
        size = np.sqrt(np.sum([effect.prior**2 for effect in candidate.effects]))
        yield tuple(replace(effect, prior=effect.prior / size) for effect in candidate.effects)


def mixed_model(fit: Calibration, poses: Poses, *, smooth: bool) -> tuple[Linearised, Array, Mixed]:
    """Return the linear problem at a fit of the standard model, its fixed part, and its model with random coefficients.

        r = P ρ + A θ + Σ_k C_k κ_k + e,   θ ~ N(0, τ² I),   κ_k ~ N(0, ω_k² I),   e ~ N(0, σ² I)

    r: measurements minus the nominal prediction, m. P: columns of registration, tool, compliances and
    eccentricities. A: columns of the constants. C_k: columns of smooth errors of the joints, without `smooth` none.
    The second result is an orthonormal basis of P, which is projected out of the model.
    """
    problem = problem_at(fit, poses)
    pool = candidates(fit.model.mechanism, poses.states, [f for f in catalogue if f.name in HEALTHY])
    healthy = problem.effect_rows([e for c in pool for e in c.effects], fit.model)
    placed, constants = problem.columns[:, : problem.placement], problem.columns[:, problem.placement :]
    taken = rank.orthonormal(np.hstack([placed, healthy]))
    groups = [constants]
    for effects in smooth_errors(fit.model.mechanism, poses.states) if smooth else ():
        groups.append(problem.effect_rows(effects, fit.model) * [effect.prior for effect in effects])
    usual = [TOLERANCE, *[SMOOTH] * (len(groups) - 1), NOISE]
    values = rank.remove(taken, problem.residual + constants @ fit.theta)
    count = len(values) - taken.shape[1]
    return problem, taken, Mixed.of([rank.remove(taken, part) for part in groups], usual, values, count)


def unexplained(fit: Calibration, poses: Poses) -> float:
    """Return the RMS 3-D error, m, that constants, compliances and smooth errors of the joints leave.

    fit: fit of the standard model.
    """
    sound = poses.subset(np.delete(np.arange(len(poses)), fit.outliers))
    noise = mixed_model(fit, sound, smooth=True)[2]
    return float(noise.deviations()[0][-1] * np.sqrt(len(noise.values) / len(sound)))

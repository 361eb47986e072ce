"""Damped Gauss-Newton: steps on the analytic columns, halved until the error falls."""

from dataclasses import dataclass

import numpy as np

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.linearise import Linearised, linearise, placement_after
from gpmodel.calibration.noise import decorrelated
from gpmodel.calibration.priors import TOOL_REACH, noise_sigma, off_mean, prior_rows, tool_rows
from gpmodel.model.error_model import ErrorModel, Placement, Poses
from gpmodel.numerics import rank as ident
from gpmodel.numerics.least_squares import solve

MAX_ITERATIONS = 30
MAX_HALVINGS = 10
STEP_TOLERANCE = 1e-9
"""Metres: a step that moves no reading by more ends the iterations; instruments resolve a hundred times that."""

REASONS = {
    "converged": f"the last step moved no pose by more than {STEP_TOLERANCE * 1e6:g} µm",
    "stalled": f"still moving after {MAX_ITERATIONS} iterations: poses too alike, or joint values wrong",
    "diverged": "steps grew: wrong joint units, signs or order, or too few poses",
}
"""Why iterations ended, by the status of the fit."""


@dataclass(frozen=True)
class Fitting:
    """What is fitted to what: the model, the poses, those that count (N,), and the weight of rotations, m.

    bundle: (N,) code of every pose, the same for repeats. ratio: variance of what these share over that of a
    measurement.
    """

    model: ErrorModel
    poses: Poses
    use: Mask
    rotation_weight: float
    bundle: IntArray
    ratio: float = 0.0

    def at(self, theta: Array, placement: Placement) -> Linearised:
        """The weighted linear problem at one point, its rows independent."""
        problem = linearise(self.model, self.poses, theta, placement, self.rotation_weight, self.use)
        return decorrelated(problem, self.bundle, self.ratio)

    def cost(self, problem: Linearised, theta: Array, placement: Placement, sigma: float) -> float:
        """Sum of squares, m², of the residual and of the pulls of the priors, weighted by σ, m."""
        prior = np.array([e.prior for e in self.model.effects])
        pulls = off_mean(self.model, theta) * sigma / prior
        tool = [frame[:3, 3] * sigma / TOOL_REACH for frame in placement.tool.values() if problem.left is None]
        return float(np.sum(problem.residual**2) + np.sum(pulls**2) + np.sum(np.square(tool)))


@dataclass(frozen=True)
class Fitted:
    """Where the iterations ended. status: a key of REASONS."""

    placement: Placement
    theta: Array
    problem: Linearised
    iterations: int
    status: str


def iterate(fitting: Fitting, theta: Array, placement: Placement, kept: Mask) -> Fitted:
    """Gauss-Newton from a point, over the placement and the effects that are `kept` (E,).

    A step that does not lower the cost is halved until it does. Where free joints are eliminated, the rows change with
    the point and costs cannot be compared: steps are taken whole.
    """
    problem = fitting.at(theta, placement)
    last = np.inf
    for iteration in range(1, MAX_ITERATIONS + 1):
        step = _step(fitting, problem, theta, placement, kept)
        moved = float(np.max(np.abs(problem.columns @ step), initial=0.0))
        if not np.isfinite(moved) or moved > 1e3 * max(last, 1.0):
            return Fitted(placement, theta, problem, iteration, "diverged")
        sigma = noise_sigma(fitting.model, problem)
        before = fitting.cost(problem, theta, placement, sigma)
        for halving in range(MAX_HALVINGS + 1):
            part = step / 2**halving
            tried = placement_after(fitting.poses, problem.observed, placement, part[: problem.placement])
            values = theta + part[problem.placement :]
            there = fitting.at(values, tried)
            whole = problem.left is not None or moved < STEP_TOLERANCE
            if whole or fitting.cost(there, values, tried, sigma) <= before:
                break
        else:
            return Fitted(placement, theta, problem, iteration, "stalled")
        placement, theta, problem, last = tried, values, there, moved
        if moved < STEP_TOLERANCE:
            return Fitted(placement, theta, problem, iteration, "converged")
    return Fitted(placement, theta, problem, MAX_ITERATIONS, "stalled")


def _step(fitting: Fitting, problem: Linearised, theta: Array, placement: Placement, kept: Mask) -> Array:
    """The whole step (K,): least squares over columns scaled to unit length, zero for what is not kept."""
    free = np.concatenate([np.ones(problem.placement, dtype=bool), kept])
    prior, pull = prior_rows(fitting.model, theta, problem, kept)
    tool, tool_pull = tool_rows(problem, placement)
    rows = np.vstack([prior, tool])[:, free]
    scale = np.hypot(problem.sizes[free], np.linalg.norm(rows, axis=0))
    scale[scale < ident.NEGLIGIBLE] = np.inf
    system = np.vstack([problem.columns[:, free], rows])
    system /= scale
    step = np.zeros(len(free))
    step[free] = solve(system, np.concatenate([problem.residual, pull, tool_pull])) / scale
    return step

"""Damped Gauss-Newton: steps on the analytic columns, halved until the error falls enough."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.linearise import Linearised, linearise, placement_after, residual_at
from gpmodel.calibration.noise import decorrelated, decorrelated_rows
from gpmodel.calibration.priors import TOOL_REACH, noise_sigma, off_mean, prior_rows, tool_rows
from gpmodel.model.error_model import ErrorModel, Placement, Poses
from gpmodel.numerics import rank as ident
from gpmodel.numerics.least_squares import MANY_COLUMNS, factored, solve

MAX_ITERATIONS = 30
MAX_HALVINGS = 10
REGAINED = 2
"""Halvings of the step before that the next one tries without: where a step is cut it is long before one is whole."""
SUFFICIENT = 0.5
"""Share of what the linear problem foresees of a step that the cost has to fall by (Armijo 1966). A step that only just
lowers it goes from side to side of a valley and down it by little."""
NEAR, BENT = 1e-6, 1e-4
"""Columns stay as they are over steps that move no reading by more, metres, while what they foresee of each is right to
such a share: of residuals of a tenth of a millimetre that moves where the iterations end by less than
STEP_TOLERANCE."""
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

    def beside(self, problem: Linearised, theta: Array, placement: Placement) -> Linearised:
        """The problem of a point with the residual at another one, its columns as they are. Not beside free joints."""
        there = residual_at(problem, self.model, theta, placement)
        return replace(there, residual=decorrelated_rows(there, there.residual, self.bundle, self.ratio))

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


def iterate(
    fitting: Fitting, theta: Array, placement: Placement, kept: Mask, problem: Linearised | None = None
) -> Fitted:
    """Gauss-Newton from a point, over the placement and the effects that are `kept` (E,). problem: at that point,
    where it is known.

    A step that does not lower the cost sufficiently is halved until it does. Where free joints are eliminated, the rows
    change with the point and costs cannot be compared: steps are taken whole.
    """
    problem = problem or fitting.at(theta, placement)
    last, cut, since, gram = np.inf, 0, 0.0, None
    for iteration in range(1, MAX_ITERATIONS + 1):
        if gram is None and problem.placement + kept.sum() >= MANY_COLUMNS:
            gram = problem.columns.T @ problem.columns
        step, fall = _step(fitting, problem, theta, placement, kept, gram)
        motion = problem.columns @ step
        moved = float(np.max(np.abs(motion), initial=0.0))
        if not np.isfinite(moved) or moved > 1e3 * max(last, 1.0):
            return Fitted(placement, theta, problem, iteration, "diverged")
        sigma = noise_sigma(fitting.model, problem)
        before = fitting.cost(problem, theta, placement, sigma)
        near = problem.left is None and since + moved < NEAR
        for halvings in range(max(0, cut - REGAINED), MAX_HALVINGS + 1):
            part = step / 2**halvings
            tried = placement_after(fitting.poses, problem.observed, placement, part[: problem.placement])
            values = theta + part[problem.placement :]
            there = fitting.beside(problem, values, tried) if near or halvings else fitting.at(values, tried)
            whole = problem.left is not None or moved < STEP_TOLERANCE
            if whole or fitting.cost(there, values, tried, sigma) <= before - SUFFICIENT * fall / 2**halvings:
                break
        else:
            return Fitted(placement, theta, problem, iteration, "stalled")
        near = near and _straight(problem.residual - there.residual, motion / 2**halvings)
        if there.columns is problem.columns and not near:
            there = fitting.at(values, tried)
        placement, theta, problem, last, cut = tried, values, there, moved, halvings
        since, gram = (since + moved, gram) if near else (0.0, None)
        if moved < STEP_TOLERANCE:
            return Fitted(placement, theta, problem, iteration, "converged")
    return Fitted(placement, theta, problem, MAX_ITERATIONS, "stalled")


def _straight(fallen: Array, foreseen: Array) -> bool:
    """Whether a residual (M,) fell by what its columns foresaw, so that they still hold."""
    return bool(np.abs(fallen - foreseen).max() <= BENT * np.abs(foreseen).max())


def _step(
    fitting: Fitting, problem: Linearised, theta: Array, placement: Placement, kept: Mask, gram: Array | None
) -> tuple[Array, float]:
    """The whole step (K,): least squares over columns scaled to unit length, zero for what is not kept; and what it
    takes off the cost of the linear problem, m².

    gram: products (K, K) of the columns where these are so many that the normal equations are solved.
    """
    free = np.concatenate([np.ones(problem.placement, dtype=bool), kept])
    prior, pull = prior_rows(fitting.model, theta, problem, kept)
    tool, tool_pull = tool_rows(problem, placement)
    rows = np.vstack([prior, tool])[:, free]
    scale = np.hypot(problem.sizes[free], np.linalg.norm(rows, axis=0))
    scale[scale < ident.NEGLIGIBLE] = np.inf
    rows /= scale
    pulls = np.concatenate([pull, tool_pull])
    step = np.zeros(len(free))
    if gram is None:
        system = np.vstack([problem.columns[:, free] / scale, rows])
        right = np.concatenate([problem.residual, pulls])
        scaled = solve(system, right)
        step[free] = scaled / scale
        return step, float((system @ scaled) @ right)
    inner = gram[np.ix_(free, free)] / np.outer(scale, scale)
    inner[np.diag_indices_from(inner)] += np.sum(rows[: len(pull)] ** 2, axis=0)
    inner += rows[len(pull) :].T @ rows[len(pull) :]
    right = (problem.columns.T @ problem.residual)[free] / scale + rows.T @ pulls
    scaled = linalg.cho_solve(factored(inner), right, check_finite=False)
    step[free] = scaled / scale
    return step, float(scaled @ right)

"""Damped Gauss-Newton: each step is corrected for curvature and halved until the cost falls enough."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.linearise import Linearised, Weighting, linearise, linearise_about, residual_at
from gpmodel.calibration.noise import decorrelate
from gpmodel.calibration.priors import TOOL_REACH, JointPriors, fit_priors, noise_sigma, off_mean
from gpmodel.calibration.start import placement_after
from gpmodel.errors import OpenLoopsError
from gpmodel.model.error_model import ErrorModel, Placement, Poses
from gpmodel.model.observation import Weights
from gpmodel.model.observed import Observed
from gpmodel.numerics import rank as ident
from gpmodel.numerics.least_squares import MANY_COLUMNS, solve


@dataclass(frozen=True)
class LinearStep:
    """Least-squares problem of one Gauss-Newton step: columns `free`, each divided by its norm `scale`, and priors.

    priors: rows of the priors on the scaled columns.
    pulls: right side of the equations of the priors.
    readings: equations of the priors on approximate joint values.
    factor: Cholesky factor of the normal equations if there are many columns, else None.
    geometry: equations of the priors on geometric constants, in terms of all effects.
    sigma: noise of one component, m, that scales the priors of the effects.
    """

    problem: Linearised
    free: Mask
    scale: Array
    priors: Array
    pulls: Array
    readings: JointPriors
    factor: tuple[Array, bool] | None
    geometry: Array
    sigma: float

    def solved(self, residual: Array, pulls: Array) -> tuple[Array, float]:
        """Solve for the step of all unknowns (zero if not fitted) and the predicted decrease of cost, m²."""
        step = np.zeros(len(self.free))
        if self.factor is None:
            system = np.vstack([self.problem.columns[:, self.free] / self.scale, self.priors])
            right = np.concatenate([residual, pulls])
            scaled = solve(system, right)
            fall = float((system @ scaled) @ right)
        else:
            right = (self.problem.columns.T @ residual)[self.free] / self.scale + self.priors.T @ pulls
            scaled = linalg.cho_solve(self.factor, right, check_finite=False)
            fall = float(scaled @ right)
        step[self.free] = scaled / self.scale
        return step, fall


def linear_step(
    model: ErrorModel, problem: Linearised, theta: Array, placement: Placement, kept: Mask, gram: Array | None
) -> LinearStep:
    """Return the least-squares problem of a step of registration, tool and the effects of the mask `kept`.

    gram: inner products of the columns, to solve the normal equations; None to solve by QR decomposition.
    """
    free = problem.free(kept)
    priors, sigma = fit_priors(model, problem, theta, placement, kept), noise_sigma(model, problem)
    rows = priors.rows[:, free]
    readings = JointPriors.select(problem, rows, free, sigma)
    rows = np.vstack([rows, readings.rows(problem)[:, free]])
    scale = np.hypot(problem.sizes[free], np.linalg.norm(rows, axis=0))
    scale[scale < ident.NEGLIGIBLE] = np.inf
    rows /= scale
    factor = None
    if gram is not None:
        inner = gram[np.ix_(free, free)] / np.outer(scale, scale)
        inner[np.diag_indices_from(inner)] += np.sum(rows[: priors.single] ** 2, axis=0)
        inner += rows[priors.single :].T @ rows[priors.single :]
        factor = ident.factored(inner)
    pulls = np.concatenate([priors.rhs, readings.rhs(problem)])
    return LinearStep(problem, free, scale, rows, pulls, readings, factor, priors.geometry, sigma)


MAX_ITERATIONS = 30
"""Largest number of steps of a calibration; six to ten are usual."""
MAX_HALVINGS = 10
"""Largest number of halvings of a Gauss-Newton step. At a thousandth of a step, rounding decides if the cost falls."""
REGAINED = 2
"""Number by which the first halvings of a line search are fewer than the halvings of the last step."""
SUFFICIENT = 0.5
"""Least decrease of the cost, as a share of the decrease that the linear problem predicts (Armijo 1966). Steps with a
smaller decrease oscillate across a valley."""
CORRECTIONS = 2
"""Largest number of corrections of a step by the error of its linear prediction before the step is halved. In a curved
valley, which nearly equivalent parameters (twist, offset and tool) cause, a straight step is too short."""
RESCALED, SCALE_SETTLED = 5, 1e-3
"""Largest number of solutions of one linear problem, and relative change of its residual that leaves the scale of the
priors. Solving takes a tenth of the time of new derivatives."""
NEAR, BENT = 1e-6, 1e-4
"""Largest displacement of a measurement, m, and largest relative error of the predicted displacement, with which the
next step reuses the derivatives. With residuals of 0.1 mm, the fit changes by less than a nanometre."""
STEP_TOLERANCE = 1e-9
"""Displacement by a step, m, at which the iterations end: a hundredth of an instrument's resolution."""
FREE_JOINTS_TOLERANCE = 1e-8
"""Displacement by a step, m, at which the iterations end if joint values are eliminated. Smaller steps oscillate:
errors of the joint values rotate the columns by a second-order amount."""

REASONS = {
    "converged": f"the last step moved no pose by more than {STEP_TOLERANCE * 1e6:g} µm",
    "stalled": f"not converged after {MAX_ITERATIONS} iterations: poses too similar, or wrong joint values",
    "diverged": "diverged: wrong joint units, signs or order, or too few poses",
}
"""Explanation of each status with which the Gauss-Newton iterations end."""


@dataclass(frozen=True)
class Fitting:
    """Data of a fit: the model, the poses, the mask `use` of fitted poses, and the weights of the kinds of
    measurements, m per unit.

    block: index of the pose of every row, equal for repeats.
    ratio: variance shared by the repeats of a pose over the variance of one measurement.
    noise_shape: covariance (3, 3) of the coordinates of a position relative to their mean variance; None: equal noise.
    """

    model: ErrorModel
    poses: Poses
    use: Mask
    weights: Weights
    block: IntArray
    ratio: float = 0.0
    noise_shape: Array | None = None

    @property
    def weighting(self) -> Weighting:
        """Weights of the measurements."""
        return Weighting(self.weights, self.use, self.noise_shape)

    def linearised(self, theta: Array, placement: Placement) -> Linearised:
        """Linearise the weighted measurements at given parameter values, repeats taken as independent."""
        return linearise(self.model, self.poses, theta, placement, self.weighting)

    def at(self, theta: Array, placement: Placement) -> Linearised:
        """Linearise the measurements at given parameter values, with decorrelated repeats of a pose."""
        return self._independent(self.linearised(theta, placement))

    def linearised_about(self, observed: Observed, placement: Placement) -> Linearised:
        """Linearise about given predictions, with decorrelated repeats; all joints must be measured."""
        return self._independent(linearise_about(observed, self.model, self.poses, placement, self.weighting))

    def with_residual_at(self, problem: Linearised, theta: Array, placement: Placement) -> Linearised:
        """Return the linear problem with old derivatives, and the residual at the parameter values `theta` and
        `placement`."""
        there = residual_at(problem, self.model, theta, placement)
        decorrelate(there, there.residual, self.block, self.ratio)
        return there

    def _independent(self, problem: Linearised) -> Linearised:
        for values in (problem.columns, problem.residual):
            decorrelate(problem, values, self.block, self.ratio)
        return problem

    def cost(self, problem: Linearised, theta: Array, placement: Placement, at: LinearStep) -> float:
        """Return the cost of parameter values, m²: sum of squares of the residual and of the priors.

        at: step whose noise scales the priors, so that costs at several parameter values are comparable.
        """
        prior = np.array([e.prior for e in self.model.effects])
        pulls = off_mean(self.model, theta) * at.sigma / prior
        tool = [frame[:3, 3] * at.sigma / TOOL_REACH for frame in placement.tool.values()]
        geometry = at.geometry @ theta
        read = at.readings.rhs(problem)
        return float(sum(np.sum(np.square(part)) for part in (problem.residual, pulls, tool, geometry, read)))


@dataclass(frozen=True)
class Iterate:
    """Current parameter values of Gauss-Newton iterations. Old derivatives of close values may be reused."""

    placement: Placement
    theta: Array
    problem: Linearised


@dataclass(frozen=True)
class Fitted(Iterate):
    """Last parameter values of the Gauss-Newton iterations. status: status such as "converged" (REASONS)."""

    status: str


@dataclass(frozen=True)
class _Step:
    """Step of the linear problem in a Gauss-Newton iteration.

    step: change of all parameters, m and rad. fall: predicted decrease of the cost, m².
    motion: predicted displacement of the measurements, m. joint_change: predicted change of the joint-value rows, m.
    """

    linear: LinearStep
    step: Array
    fall: float
    motion: Array
    joint_change: Array

    @property
    def moved(self) -> float:
        """Largest displacement of a measured point by the step, as predicted by the linear problem, m."""
        return float(max(np.max(np.abs(moved), initial=0.0) for moved in (self.motion, self.joint_change)))

    @property
    def negligible(self) -> bool:
        """True if the Gauss-Newton step is below the tolerance, so that it is accepted whatever the cost."""
        return self.moved < (STEP_TOLERANCE if self.linear.problem.reduced is None else FREE_JOINTS_TOLERANCE)


def iterate(
    fitting: Fitting, theta: Array, placement: Placement, kept: Mask, problem: Linearised | None = None
) -> Fitted:
    """Iterate Gauss-Newton over registration, tool and the effects of the mask `kept`.

    problem: linearised measurements at the initial values, if known.
    A step that does not lower the cost enough is corrected by the error of its linear prediction, then halved. With
    unmeasured joints a step is only halved, since eliminating joint values makes the rows depend on the parameters.
    """
    here = Iterate(placement, theta, problem or fitting.at(theta, placement))
    last, cut, since, gram = np.inf, 0, 0.0, None
    for _ in range(MAX_ITERATIONS):
        if gram is None and here.problem.placement + kept.sum() >= MANY_COLUMNS:
            gram = here.problem.columns.T @ here.problem.columns
        step = _step(fitting, here, kept, gram)
        if not np.isfinite(step.moved) or step.moved > 1e3 * max(last, 1.0):
            return Fitted(**vars(here), status="diverged")
        there, cut = _lower(fitting, here, step, max(0, cut - REGAINED))
        if there is None:
            return Fitted(**vars(here), status="stalled")
        last, free = step.moved, here.problem.reduced is not None
        near = not free and since + last < NEAR
        off = here.problem.residual - there.problem.residual - (foreseen := step.motion / 2**cut)
        near = near and bool(np.abs(off).max() <= BENT * np.abs(foreseen).max())
        since, gram = (since + last, gram) if near else (0.0, None)
        if not near and not free:
            theta, placement, observed = there.theta, there.placement, there.problem.observed
            del here, there, step  # with thousands of poses, three problems exceed the memory
            there = Iterate(placement, theta, fitting.linearised_about(observed, placement))
        here = there
        if last < STEP_TOLERANCE:
            return Fitted(**vars(here), status="converged")
    return Fitted(**vars(here), status="stalled")


def _step(fitting: Fitting, here: Iterate, kept: Mask, gram: Array | None) -> _Step:
    """Return the Gauss-Newton step. If the model has many parameters, the residual after the step scales the priors."""
    problem, model = here.problem, fitting.model
    for _ in range(RESCALED):
        linear = linear_step(model, problem, here.theta, here.placement, kept, gram)
        whole, fall = linear.solved(problem.residual, linear.pulls)
        motion = problem.columns @ whole
        sigma = float(np.sqrt(np.mean((problem.residual - motion) ** 2)))
        if gram is None or fitting.model.noise is not None or abs(sigma - linear.sigma) <= SCALE_SETTLED * sigma:
            break
        model = replace(model, noise=sigma)
    return _Step(linear, whole, fall, motion, linear.readings.rows(problem) @ whole)


def _lower(fitting: Fitting, here: Iterate, step: _Step, cut: int) -> tuple[Iterate | None, int]:
    """Return the first point along a step that lowers the cost enough, and the number of halvings of the step.

    The search along the step begins after `cut` halvings. Without a point that lowers the cost enough, return None. A
    step after which a kinematic loop cannot close is also too long. Derivatives are reused if all joints are measured.
    """
    before = fitting.cost(here.problem, here.theta, here.placement, step.linear)
    count, free = here.problem.placement, here.problem.reduced is not None
    for halvings in range(cut, MAX_HALVINGS + 1):
        part, foreseen = step.step / 2**halvings, here.problem.residual - step.motion / 2**halvings
        enough = before - SUFFICIENT * step.fall / 2**halvings
        for corrections in range(1 if free else CORRECTIONS + 1):
            tried = placement_after(here.problem.observed, here.placement, part[:count])
            values = here.theta + part[count:]
            try:
                problem = fitting.at(values, tried) if free else fitting.with_residual_at(here.problem, values, tried)
            except OpenLoopsError:
                break
            if step.negligible or fitting.cost(problem, values, tried, step.linear) <= enough:
                return Iterate(tried, values, problem), halvings
            if not free and corrections < CORRECTIONS:
                part = part + step.linear.solved(problem.residual - foreseen, np.zeros_like(step.linear.pulls))[0]
    return None, MAX_HALVINGS

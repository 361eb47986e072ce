"""A Gaussian process told the inputs and the place of a law, and not its form: what could be explained without a law.

    y = G beta + S phi(z) + noise,   phi ~ GP(0, s^2 k),   k Gaussian with a length an input

y: coordinates that a geometric fit leaves; G: its columns, whose beta nobody knows; S: motion of the tool by a unit
twist at the place, one column a pose.  Lengths, s and the noise by marginal likelihood and its gradient (Rasmussen,
Williams 2006, chapter 5) of what is left of y beside G, in the N directions that S has there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize
from threadpoolctl import threadpool_limits

from experiments.blind.oracle import CUT, Fit, fit, jacobian, register, truncated
from experiments.blind.robot import Sheet, world_of
from experiments.blind.simulator import Array
from experiments.random_laws.robot import Robot, columns_of

STARTS = (0.4, 1.5)
SHORTEST, LONGEST = 0.05, 20.0


@dataclass(frozen=True)
class Rows:
    """Rows of N poses: geometry (3N, P), motion (N, 3) by a unit twist, inputs (N, D) within [-1, 1]."""

    geometry: Array
    motion: Array
    inputs: Array


def rows_of(robot: Robot, model: Fit, sheet: Sheet) -> Rows:
    """The columns of a fit, and those of the law's place and inputs."""
    law, place, arm = robot.law, robot.place, robot.machine.arm
    assert law
    assert place
    unit = place.motion(arm, np.ones(len(sheet.q)))
    matrix = jacobian(arm, model.placement, model.tool, np.append(model.amounts, 0.0), sheet.q, [unit])
    columns = columns_of(world_of(arm, sheet.q, sheet.extra, sheet.row, robot.machine.tool))
    return Rows(matrix[:, :-1], matrix[:, -1].reshape(-1, 3), np.column_stack(law.scaled(columns)))


@dataclass(frozen=True)
class Problem:
    """response (N,) and how phi at the poses (N,) acts on it (N, N); rest: squared response in `spare` directions that
    have noise alone; squares (D, N, N): squared differences of the inputs."""

    response: Array
    acts: Array
    rest: float
    spare: int
    squares: Array

    def kernel(self, parameters: Array) -> Array:
        """s^2 k (N, N); parameters: logarithms of the noise, of s and of the lengths."""
        return kernel(self.squares, parameters)

    def solved(self, parameters: Array) -> tuple[Array, Array]:
        """Covariance (N, N) of the response as a Cholesky factor, and its inverse times the response (N,)."""
        own = self.acts @ self.kernel(parameters) @ self.acts.T
        own[np.diag_indices_from(own)] += np.exp(2 * parameters[0])
        factor = cho_factor(own, lower=True)[0]
        return factor, cho_solve((factor, True), self.response)

    def cost(self, parameters: Array) -> tuple[float, Array]:
        """Negative logarithm of the marginal likelihood, and its gradient."""
        try:
            factor, weights = self.solved(parameters)
        except np.linalg.LinAlgError:
            return 1e12, np.zeros(len(parameters))
        noise = np.exp(2 * parameters[0])
        cost = 0.5 * (self.response @ weights + self.rest / noise) + self.spare * parameters[0]
        cost += np.log(np.diag(factor)).sum()
        pull = cho_solve((factor, True), np.eye(len(weights))) - np.outer(weights, weights)
        inside = (self.acts.T @ pull @ self.acts) * self.kernel(parameters)
        by_length = [
            0.5 * np.sum(inside * s) / np.exp(2 * p) for s, p in zip(self.squares, parameters[2:], strict=True)
        ]
        by_noise = noise * np.trace(pull) + self.spare - self.rest / noise
        return float(cost), np.array([by_noise, inside.sum(), *by_length])


def kernel(squares: Array, parameters: Array) -> Array:
    """s^2 k from squared differences (D, N, M)."""
    lengths = np.exp(2 * parameters[2:])[:, None, None]
    return np.asarray(np.exp(2 * parameters[1] - 0.5 * np.sum(squares / lengths, axis=0)))


def squares_between(first: Array, second: Array) -> Array:
    """(D, N, M) squared differences of inputs (N, D) and (M, D)."""
    return np.asarray((first.T[:, :, None] - second.T[:, None, :]) ** 2)


def problem_of(rows: Rows, left: Array) -> Problem:
    """Build the problem from the residual of a fit (3N,), with the geometry projected out."""
    count = len(rows.inputs)
    scale = np.linalg.norm(rows.geometry, axis=0)
    u, s, _ = np.linalg.svd(rows.geometry / np.where(scale > 0, scale, 1.0), full_matrices=False)
    taken = u[:, s > CUT * s[0]]
    acting = np.zeros((3 * count, count))
    acting.reshape(count, 3, count)[np.arange(count), :, np.arange(count)] = rows.motion
    acting -= taken @ (taken.T @ acting)
    left = left - taken @ (taken.T @ left)
    directions, triangle = np.linalg.qr(acting)
    response = directions.T @ left
    spare = max(2 * count - taken.shape[1], 1)
    rest = max(float(left @ left - response @ response), 0.0)
    return Problem(response, triangle, rest, spare, squares_between(rows.inputs, rows.inputs))


def surface(robot: Robot) -> Array:
    """(M, 3) m, where the fresh poses are."""
    arm, train, fresh = robot.machine.arm, robot.train, robot.fresh
    with threadpool_limits(1, "blas"):
        model = fit(arm, train.q, train.measured, [], register(arm, train.q, train.measured))
        left = (train.measured - model.predict(train.q, [])).ravel()
        here, there = rows_of(robot, model, train), rows_of(robot, model, fresh)
        problem = problem_of(here, left)
        noise, size = np.log(left.std()), np.log(left.std() / here.motion.std())
        bounds = [(noise - 4, noise + 1), (size - 3, size + 5)]
        bounds += [(np.log(SHORTEST), np.log(LONGEST))] * len(problem.squares)
        starts = [[noise - 1, size + 1, *[np.log(length)] * len(problem.squares)] for length in STARTS]
        fits = [minimize(problem.cost, x, jac=True, method="L-BFGS-B", bounds=bounds) for x in starts]
        best = min(fits, key=lambda found: float(found.fun)).x
        weights = problem.acts.T @ problem.solved(best)[1]
        at_train = problem.kernel(best) @ weights
        at_fresh = kernel(squares_between(there.inputs, here.inputs), best) @ weights
        amounts = truncated(here.geometry, left - (here.motion * at_train[:, None]).ravel())
        moved = (there.geometry @ amounts).reshape(-1, 3) + there.motion * at_fresh[:, None]
    return np.asarray(model.predict(fresh.q, []) + moved)

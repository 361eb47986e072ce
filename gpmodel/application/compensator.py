"""Define problems of genetic programming for a residual: a compensator of the tool point, or programs at sites."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.result import Calibration, resolved
from gpmodel.discovery.explore import posed
from gpmodel.discovery.search import Search
from gpmodel.discovery.targets import readable_inputs
from gpmodel.errors import InputError
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import residual_of
from gpmodel.evolution.problems import COORDINATES, CartesianProblem, Inputs, Problem
from gpmodel.formula.program import Program
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.error_model import Poses, observe
from gpmodel.model.sites import sites_of


@dataclass(frozen=True)
class TrainingProblem:
    """Genetic programming on training poses. heldout: share of the held-out error that a program removes, or None."""

    problem: Problem
    heldout: Callable[[Program], float] | None


MILLIMETRE = 1e3
"""Conversion factor, mm per m. Compensators use millimetres, so that errors are of order one, like the values of sin,
cos, atan and the constants in Robertson (2003), Table 5.1."""


def cartesian_task(
    fit: Calibration, poses: Poses, train: IntArray, held: IntArray, norm: str = "max"
) -> TrainingProblem:
    """Return the problem of a Cartesian compensator on training poses, with its score on held-out poses."""
    problem = cartesian_problem(fit, poses, train, norm)
    if not len(held):
        return TrainingProblem(problem, None)
    other = cartesian_problem(fit, poses, held, norm)

    def heldout(program: Program) -> float:
        if not program.outputs:
            return 0.0
        return 1.0 - other.norm_of(program.evaluate(other.inputs.mapping())) / other.initial_norm

    return TrainingProblem(problem, heldout)


def slot_task(fit: Calibration, mechanism: Mechanism, seen: Poses, seed: int) -> TrainingProblem:
    """Return the problem of programs at all sites (frame and axis) of a mechanism, with the penalties of `discover`."""
    residual = residual_of(fit, seen, Criteria(), seed)
    return TrainingProblem(posed(residual, sites_of(mechanism), Search(), np.arange(len(residual.poses)))[0], None)


def cartesian_problem(fit: Calibration, poses: Poses, rows: IntArray, norm: str = "max") -> CartesianProblem:
    """Return the problem of a compensator from modelled to measured points, mm: Fig 5.2 of Robertson (2003).

    Points are in the mechanism's root frame. Program inputs are, as in Table 5.1, the point, the joint values, and
    every varying column. rows: numbers of the poses. Raises InputError if no pose has all three coordinates."""
    rows = rows[np.isfinite(poses.dataset.position[rows]).all(axis=1)]
    if not len(rows):
        raise InputError(f"{poses.dataset.source}: no pose has x, y and z; expected all three for a compensator")
    chosen = resolved(fit, poses.subset(rows))
    tip = observe(fit.model, chosen, fit.theta, fit.placement).tip[:, :3, 3]
    register = fit.placement.roots(chosen.dataset)
    model, measured = (MILLIMETRE * _in_root(register, points) for points in (tip, chosen.dataset.position))
    readable, _ = readable_inputs(poses.states, rows)
    table = {*poses.dataset.joints, *poses.dataset.extras} - set(COORDINATES)
    kept = [name for name in readable.names if name in table]
    values = np.vstack([model, readable.select(kept).values])
    return CartesianProblem(Inputs((*COORDINATES, *kept), values), measured, norm)


def _in_root(register: Array, points: Array) -> Array:
    """Transform points, m, from the instrument's frame to the mechanism's root frame."""
    moved = np.einsum("nji,nj->ni", register[:, :3, :3], points - register[:, :3, 3])
    return np.ascontiguousarray(moved.T)

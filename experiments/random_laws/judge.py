"""Compare a method on one robot with exact positions, the geometry alone and an oracle."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize
from threadpoolctl import threadpool_limits

import gpmodel as gp
from experiments.blind.files import table, urdf
from experiments.blind.grading import nodes
from experiments.blind.oracle import CUT, Fit, fit, jacobian, register, rms_mm, truncated
from experiments.blind.robot import Sheet, world_of
from experiments.blind.simulator import Array
from experiments.methods.plug import Files, Method, asked, geometry, predicted
from experiments.methods.rows import Row, explained
from experiments.random_laws.law import Place, places
from experiments.random_laws.robot import Robot, columns_of, make
from gpmodel.api.table import dataset_of
from gpmodel.errors import GpModelError, InputError
from gpmodel.model.error_model import prepare
from gpmodel.model.states import States
from gpmodel.report.schema_search import EffectRecord

CLOCKS = ("row", "time")
ALIKE = 0.95
"""Inputs whose columns correlate by more are one input; places that move the tool so much alike are one place."""


def stands_for(found: str, true: str, states: States) -> bool:
    """Return whether an input is the true one, or proportional to it over the poses."""
    if found == true:
        return True
    try:
        pair = np.array([states[found], states[true]])
    except InputError:
        return False
    return bool(np.ptp(pair, axis=1).min() > 0 and abs(np.corrcoef(pair)[0, 1]) > ALIKE)


def alike(first: Array, second: Array) -> float:
    """Cosine between two motions of the tool (N, 3), pose by pose, each pose weighted by both sizes."""
    sizes = np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
    return float(np.abs(np.sum(first * second, axis=1)).sum() / max(sizes.sum(), 1e-300))


def same_place(finding: EffectRecord, robot: Robot) -> bool:
    """Return whether a finding acts at the site of the formula, or moves the tool alike."""
    place = Place(finding.slot, finding.axis)
    if robot.place is None or place not in places(robot.machine.arm):
        return False
    columns = [p.column(robot.machine.arm, robot.machine.tool, robot.fresh.q) for p in (place, robot.place)]
    return alike(*columns) > ALIKE


def graded(findings: tuple[EffectRecord, ...], robot: Robot, states: States) -> dict[str, Any]:
    """inputs_right: every true input is read; inputs_needless: others that are; place_right: of one finding at least;
    false: findings that read no true input, on an innocent robot all but those that follow a tracker that walks."""
    found = [f for f in findings if f.kept]
    true = robot.law.inputs if robot.law else CLOCKS if robot.machine.case.walk_mm else ()
    read = sorted({name for f in found for name in f.inputs})
    right = {name: [t for t in true if stands_for(name, t, states)] for name in read}
    out = {
        "false": sum(not any(right[name] for name in f.inputs) for f in found),
        "found": [said(f) for f in found],
    }
    if robot.law:
        out |= {
            "inputs_right": all(any(t in r for r in right.values()) for t in true),
            "inputs_needless": sum(not r for r in right.values()),
            "place_right": any(same_place(f, robot) for f in found),
        }
    return out


def said(finding: EffectRecord) -> dict[str, Any]:
    """A finding in short; nodes: of its law, as they are counted for the blind robots."""
    return {
        "name": finding.name, "place": f"{finding.slot} {finding.axis}", "law": finding.basis,
        "inputs": len(finding.inputs), "nodes": nodes(finding.basis), "named": bool(finding.catalogue),
        "found_by": finding.found_by,
    }  # fmt: skip


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
    """(M, 3) m, where the fresh poses are.

        y = G beta + S phi(z) + noise,   phi ~ GP(0, s^2 k),   k Gaussian with a length an input

    y: coordinates that a geometric fit leaves; G: its columns, whose beta nobody knows; S: motion of the tool by a unit
    twist at the place, one column a pose.  Lengths, s and the noise by marginal likelihood and its gradient (Rasmussen,
    Williams 2006, chapter 5) of what G does not explain of y, in the N directions that S has there.
    """
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


def write(robot: Robot, folder: Path) -> Files:
    """table.csv, robot.urdf and poses.csv, which has no positions."""
    folder.mkdir(parents=True, exist_ok=True)
    machine = robot.machine
    files = folder / "table.csv", folder / "robot.urdf", folder / "poses.csv"
    files[0].write_text(table(machine.arm, robot.train, robot.train.measured, machine.case.labelled))
    files[1].write_text(urdf(machine.arm))
    files[2].write_text(table(machine.arm, robot.fresh, None))
    return files


def oracle(robot: Robot, files: Files) -> tuple[Array, States]:
    """Told the law and its place, its amount solved with the geometry; and the columns of the fresh poses."""
    law, place = robot.law, robot.place
    told = [gp.effect_at("told", place.slot, place.axis, law, family="told")] if law and place else []
    model = gp.calibrate(files[1], files[0], told, holdout=0.0).model
    poses = dataset_of(files[2], model.mechanism, need_measurement=False)
    return predicted(model, files[2]), prepare(model.mechanism, poses).states


def drawn(robot: Robot) -> Row:
    """Describe the robot."""
    case, law, place = robot.machine.case, robot.law, robot.place
    return {
        "arm": case.arm, "poses": len(robot.train.q), "noise_mm": case.noise_mm, "kind": robot.kind,
        "size_mm": robot.size_mm, "law": str(law or ""), "law_nodes": nodes(law.text) if law else 0,
        "inputs": list(law.inputs if law else ()),
        "place": f"{place.slot} {place.axis}" if place else "",
    }  # fmt: skip


def judge(seed: int, factors: int | str, index: int, method: Method, folder: Path) -> Row:
    """Errors are 3-D rms in mm at the fresh poses against exact positions.

    of_surface: the share explained with a Gaussian process that is told inputs and place in the oracle's stead.
    """
    robot = make(seed, factors, index)
    shutil.rmtree(folder, ignore_errors=True)
    files = write(robot, folder)
    row: Row = {"seed": seed, "factors": factors, "index": index, **drawn(robot)}
    true = robot.fresh.clean
    try:
        told, states = oracle(robot, files)
        bounds = rms_mm(geometry(*files) - true), rms_mm(told - true)
    except (GpModelError, np.linalg.LinAlgError) as failure:
        return {**row, "failed": f"{type(failure).__name__}: {failure}"}
    scored, answer = asked(method, files, true, bounds)
    row |= {"geometry_mm": bounds[0], "oracle_mm": bounds[1], **scored}
    if answer is not None and robot.law:
        row["surface_mm"] = rms_mm(surface(robot) - true)
        row["of_surface"] = explained(bounds[0], row["error_mm"], row["surface_mm"])
    if answer is None or answer.findings is None:
        return row
    return {**row, **graded(answer.findings, robot, states)}

"""Measure outlying machines, means and spreads of fleets of sound machines.

The geometric errors of a machine are those of its type and a normal deviation; type and machine are drawn by the blind
simulator, which shares no code with the product.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from typing import Any

import numpy as np

from experiments.blind.case import Case
from experiments.blind.generate import first_table, standing
from experiments.blind.machine import Machine
from experiments.blind.robot import world_of
from experiments.blind.session import Route
from experiments.coverage.truth import ARMS, STRATA, frame, mechanism_of, poses_at
from gpmodel.api.fleet import fleet
from gpmodel.api.table import read_table
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration, problem_at
from gpmodel.hierarchy.record import FleetPart
from gpmodel.model.error_model import ErrorModel
from gpmodel.model.sites import geometric_effects

SIZES = (5, 6, 8, 12)
WAYS = ("60 poses", "120 poses", "repeats, labelled", "outliers", "noise by distance")
SPREAD = 0.3e-3
"""Standard deviation of every error between machines, m and rad."""
STEP = 1e-5
"""Change of an error by which its part in every fitted number is found, m and rad."""
Row = dict[str, Any]


def fleet_asked(number: int) -> Row:
    """One fleet: who stands out, and the deviations of its means in their ±, of its spreads in their intervals."""
    started, rng = time.process_time(), np.random.default_rng([number, 30])
    way, arm = WAYS[number % len(WAYS)], ARMS[rng.integers(len(ARMS))]
    case, size = Case(f"fleet, {way}, {arm}", arm, **STRATA[way]), SIZES[rng.integers(len(SIZES))]
    typical, _, _ = standing(case, number)
    machines = [replace(standing(case, 1000 * number + k)[0], errors=_drawn(typical, rng)) for k in range(size)]
    with tempfile.TemporaryDirectory() as folder:
        mechanism = mechanism_of(typical, folder)
    tables = {f"m{k}": frame(m, first_table(m, [], rng)) for k, m in enumerate(machines)}
    found = fleet(mechanism, tables, (), holdout=0.0, seed=0).record
    mean, spread = _truth(typical, mechanism, found, tables["m0"])
    known = {p.name: p for p in found.effects}
    return {
        "machine": number, "stratum": way, "arm": arm, "size": size,
        "outliers": [[k, part.name, round(part.chances[k], 5)] for k, part in found.outliers()],
        "mean": [round(float((p.mean - mean[n]) / p.stderr), 2) for n, p in known.items() if p.stderr],
        "spread": [int(p.low <= spread[n] <= p.high) for n, p in known.items()],
        "seconds": round(time.process_time() - started, 2),
    }  # fmt: skip


def _drawn(typical: Machine, rng: np.random.Generator) -> np.ndarray:
    return np.asarray(typical.errors + SPREAD * rng.normal(size=typical.errors.shape))


def _truth(typical: Machine, mechanism: Any, found: FleetPart, table: Any) -> tuple[dict[str, float], dict[str, float]]:
    """Mean and spread of every number of the fleet, by name: what exact positions of the typical machine give, and how
    a change of each error moves them."""
    rng = np.random.default_rng(1)
    later = typical.under(outliers=0.0, repeats=1, order="independent")
    sheet = later.measured([], *later.drawn(400, rng), rng)
    poses = poses_at(mechanism, read_table(table, mechanism), sheet)
    names = {p.name for p in found.effects}
    held = tuple(e for e in geometric_effects(mechanism) if e.name in names)
    fit = calibrate(ErrorModel(mechanism, held), poses, condition_limit=1e9, robust=False)
    steps = _steps(typical, sheet.q)
    by_error = np.array([_moved(fit, poses, there - sheet.clean) for there in steps]) / STEP
    spread = SPREAD * np.sqrt(np.sum(by_error**2, axis=0))
    names_held = [e.name for e in held]
    return dict(zip(names_held, fit.theta, strict=True)), dict(zip(names_held, spread, strict=True))


def _steps(typical: Machine, q: np.ndarray) -> list[np.ndarray]:
    """Points (N, 3) of the typical machine with one of its errors larger by STEP, one array an error."""
    row = np.zeros(len(q))
    world = world_of(typical.arm, q, {}, row, typical.tool, typical.placement)
    out = []
    for k in range(typical.errors.size):
        errors = typical.errors.copy()
        errors.flat[k] += STEP
        machine = replace(typical.under(outliers=0.0, repeats=1), errors=errors)
        out.append(machine.measured([], Route(q, np.arange(len(q))), world, np.random.default_rng(0)).clean)
    return out


def _moved(fit: Calibration, poses: Any, change: np.ndarray) -> np.ndarray:
    """Change (E,) of the fitted numbers by a change (N, 3) of the positions."""
    problem = problem_at(fit, poses)
    scale = np.linalg.norm(problem.columns, axis=0)
    scale[scale == 0] = np.inf
    observed = np.zeros(problem.weights.shape)
    observed[:, :3] = change
    solved = np.linalg.lstsq(problem.columns / scale, problem.weigh(observed), rcond=1e-10)[0]
    return np.asarray((solved / scale)[problem.placement :])

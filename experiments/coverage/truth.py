"""Compute the true values of a machine for the unknowns of a fit, and new test poses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from io import StringIO
from typing import Any

import numpy as np
import pandas as pd

from experiments.blind.case import Case, effect
from experiments.blind.files import table, urdf
from experiments.blind.generate import first_table, standing
from experiments.blind.machine import Machine
from experiments.blind.robot import Sheet
from gpmodel.api.arguments import load_mechanism
from gpmodel.calibration.iterate import Fitting, iterate
from gpmodel.calibration.priors import GEOMETRY_REACH, TOOL_REACH
from gpmodel.calibration.result import Calibration, problem_at, uncertainty
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.error_model import Placement, Poses, prepare
from gpmodel.table.dataset import Dataset

STRATA: dict[str, dict[str, Any]] = {
    "30 poses": {"poses": 30, "noise_mm": 0.03},
    "60 poses": {"poses": 60, "noise_mm": 0.05},
    "120 poses": {"poses": 120, "noise_mm": 0.03},
    "400 poses": {"poses": 400, "noise_mm": 0.03},
    "repeats, labelled": {"poses": 180, "repeats": 3, "labelled": True, "noise_mm": 0.015, "shared_mm": 0.04},
    "repeats, jitter": {"poses": 150, "repeats": 3, "noise_mm": 0.02, "shared_mm": 0.03},
    "heavy tails": {"poses": 100, "noise_mm": 0.05, "noise": "student"},
    "outliers": {"poses": 80, "noise_mm": 0.03, "outliers": 0.04},
    "clusters": {"poses": 200, "noise_mm": 0.02, "order": "clusters", "shared_mm": 0.03},
    "drift": {"poses": 100, "noise_mm": 0.03, "walk_mm": 0.05},
    "noise by distance": {"poses": 80, "noise_mm": 0.04, "noise": "distance", "tracker": "levelled"},
    "narrow": {"poses": 90, "noise_mm": 0.03, "narrow": 0.35},
}
ARMS = ("ur_like", "irb_like", "puma_like", "staubli_like", "kuka_like", "seven_axes", "cobot_ten", "welder",
        "four_axes", "rail_kuka", "scara", "gantry")  # fmt: skip
_SIX = frozenset(ARMS[:8])
EFFECTS = {
    "compliance": (effect("compliance", 0.2, joint=3), "joint compliance, J3"),
    "ratio": (effect("gear_ratio", 0.15, joint=3), "gear ratio, J3"),
    "coupling": (effect("coupling", 0.15, source=4, joint=5), "coupling, J4 to J5"),
    "eccentric": (effect("harmonic", 0.2, joint=3, per_turn=1), "eccentricity, 1 per turn, J3"),
    "base": (effect("base_compliance", 0.2), "base compliance"),
}
"""Undeclared effects beyond geometry, and the catalogue's name of each."""


def machine_of(number: int) -> tuple[str, Case, str]:
    """Stratum, case, and the catalogue's name of the effect that the machine has, empty for none."""
    stratum = list(STRATA)[number % len(STRATA)]
    rng = np.random.default_rng([number, 20])
    arm = ARMS[rng.integers(len(ARMS))]
    kind = str(rng.choice(list(EFFECTS))) if arm in _SIX and rng.uniform() < 0.6 else ""
    undeclared, name = EFFECTS.get(kind, (None, ""))
    case = Case(f"{stratum}, {arm}, {kind}", arm, effects=(undeclared,) if undeclared else (), **STRATA[stratum])
    return stratum, case, name


STUDENT = 3.0
"""Degrees of freedom of the simulator's heavy tails, whose scale is its noise over the root of them."""


def least(fit: Calibration, poses: Poses, case: Case, sheet: Sheet) -> np.ndarray:
    """Covariance (K, K) of registration, tool and effects, zero where not held, of an efficient estimate.

    Least variances: diag (Cᵀ Σ⁻¹ C + Λ)⁻¹ with the true covariance Σ of the readings, C what every unknown does to them
    and Λ the little that is believed beforehand; of Student's t with f degrees and scale s the information of a reading
    is (f + 1) / (f + 3) / s². Readings that failed are left out, as an oracle would. Source: Cramér and Rao.
    """
    problem = problem_at(fit, poses)
    free = np.concatenate([np.ones(problem.placement, dtype=bool), fit.free])
    columns = problem.columns[:, free].reshape(len(poses), 3, -1)
    good = np.setdiff1d(np.arange(len(poses)), sheet.outliers)
    information = sum(
        columns[good, axis].T @ np.linalg.solve(covariance(case, sheet)[np.ix_(good, good)], columns[good, axis])
        for axis in range(3)
    )
    believed = np.where(np.arange(problem.columns.shape[1]) < problem.placement, np.inf, GEOMETRY_REACH)
    believed[[k for k, n in enumerate(problem.placement_names) if n.startswith("tool T")]] = TOOL_REACH
    out = np.zeros((len(free), len(free)))
    out[np.ix_(free, free)] = np.linalg.inv(information + np.diag(believed[free] ** -2.0))
    return out


def covariance(case: Case, sheet: Sheet) -> np.ndarray:
    """(N, N) of one coordinate of the readings, m²."""
    distance = np.linalg.norm(sheet.clean, axis=1)
    own = np.full(len(distance), case.noise_mm**2)
    if case.noise == "distance":
        own = own * (distance / distance.mean()) ** 2
    if case.noise == "student":
        own = own / STUDENT * (STUDENT + 3.0) / (STUDENT + 1.0)
    out = np.diag(own) + case.shared_mm**2 * (sheet.pose[:, None] == sheet.pose)
    if case.walk_mm:
        walk = np.minimum.outer(np.arange(len(own)), np.arange(len(own))) + 1.0
        centred = walk - walk.mean(axis=0) - walk.mean(axis=1)[:, None] + walk.mean()
        out += case.walk_mm**2 / 3.0 * centred / np.trace(centred) * len(own)
    return 1e-6 * out


NEW = 1000
"""Poses on which a statement of accuracy is asked."""


@dataclass(frozen=True)
class Hall:
    """A machine with its user's description of it, measured twice, and NEW other poses of it."""

    machine: Machine
    amounts: list[float]
    mechanism: Mechanism
    sheets: tuple[Sheet, Sheet]
    new: Sheet

    @property
    def tables(self) -> tuple[pd.DataFrame, ...]:
        """Both measured sheets as a user has them."""
        return tuple(frame(self.machine, sheet) for sheet in self.sheets)


@dataclass(frozen=True)
class Exact:
    """theta (E,), placement and the numbers of the placement by name: of the fit that exact positions would give."""

    theta: np.ndarray
    placement: Placement
    placed: dict[str, float]


def hall(case: Case, number: int, folder: object) -> Hall:
    """The machine of a case, its tables as a user reads them."""
    machine, amounts, rng = standing(case, number)
    sheets = first_table(machine, amounts, rng), first_table(machine, amounts, rng)
    later = machine.under(outliers=0.0, repeats=1, order="independent", walk_mm=0.0)
    new = later.measured(amounts, *later.drawn(NEW, rng), rng)
    return Hall(machine, amounts, mechanism_of(machine, folder), sheets, new)


def mechanism_of(machine: Machine, folder: object) -> Mechanism:
    """The description that a user has, by way of its file."""
    path = f"{folder}/robot.urdf"
    with open(path, "w", encoding="utf-8") as file:
        file.write(urdf(machine.arm))
    return load_mechanism(path)


def frame(machine: Machine, sheet: Sheet) -> pd.DataFrame:
    """A measured sheet as a user's table."""
    return pd.read_csv(StringIO(table(machine.arm, sheet, sheet.measured, machine.case.labelled)), dtype=str)


def poses_at(mechanism: Mechanism, like: Dataset, sheet: Sheet) -> Poses:
    """Poses of a sheet where they truly are, in the set-up and with the tool of another table of the machine."""
    count = len(sheet.q)
    plain = replace(
        like, q=sheet.q, position=sheet.clean, rotation=np.full((count, 3), np.nan), row=np.arange(count),
        payload=np.zeros(count), distances={}, labels={}, extras={}, extra_units={},
    )  # fmt: skip
    return prepare(mechanism, plain)


def exact(fit: Calibration, poses: Poses) -> Exact:
    """Where the same unknowns end on poses that are measured without error."""
    use, alone = np.ones(len(poses), dtype=bool), np.arange(len(poses))
    fitting = Fitting(replace(fit.model, noise=None), poses, use, fit.weights, alone)
    found = iterate(fitting, fit.theta, fit.placement, fit.free)
    placed = uncertainty(fitting, found, fit.free).placement_numbers
    return Exact(found.theta, found.placement, {p.name: p.value for p in placed})

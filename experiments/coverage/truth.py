"""Truth of a machine in the gauge of a fit, and new poses for tests."""

from __future__ import annotations

from dataclasses import dataclass, replace
from io import StringIO

import numpy as np
import pandas as pd

from experiments.blind.case import Case
from experiments.blind.description import urdf
from experiments.blind.files import table
from experiments.blind.generate import first_table, standing
from experiments.blind.machine import Machine
from experiments.blind.robot import Sheet
from gpmodel.api.arguments import load_mechanism
from gpmodel.calibration.iterate import Fitting, iterate
from gpmodel.calibration.result import Calibration, uncertainty
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.error_model import Placement, Poses, prepare
from gpmodel.table.dataset import Dataset

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
    fitting = Fitting(replace(fit.model, noise=None), poses, use, fit.rotation_weight, alone)
    found = iterate(fitting, fit.theta, fit.placement, fit.kept)
    placed = uncertainty(fitting, found, fit.kept).placed
    return Exact(found.theta, found.placement, {p.name: p.value for p in placed})

"""Simulate machines of one type: common errors, spread, and one worn machine."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from experiments.blind.arms import ARMS
from experiments.blind.case import Case, effect
from experiments.blind.generate import standing
from experiments.blind.machine import Machine, stand
from experiments.blind.robot import Sheet
from experiments.blind.session import Route
from experiments.blind.simulator import Array

CASE = Case("fleet", "irb_like", 60, 0.03, effects=(effect("base_compliance", 0.5), effect("compliance", 0.3, joint=2)))
NAMED = ("base_compliance", "joint_compliance J2")
COMMON, OWN = 2e-4, 1e-4
"""Standard deviations of a constant error, m and rad: of the type, and of a machine about it."""
SPREAD, WORN = 0.15, 2.5
"""Spread of a compliance between machines, as a fraction of its mean, and softness of joint 2 of the worn machine as
a multiple.
"""


@dataclass(frozen=True)
class Built:
    """A machine and the amounts of its effects."""

    machine: Machine
    amounts: list[float]

    def sheet(self, count: int, rng: np.random.Generator) -> Sheet:
        """Random poses, measured."""
        return self.machine.measured(self.amounts, *self.machine.drawn(count, rng), rng)

    def sheet_at(self, q: Array, rng: np.random.Generator) -> Sheet:
        """Given poses, measured."""
        chosen = Route(q, np.arange(len(q)))
        return self.machine.measured(self.amounts, chosen, self.machine.world_at(chosen, rng), rng)


def built(seed: int, worn: int | None = None) -> Iterator[Built]:
    """One machine of the type after the other; that of number `worn` has a soft joint 2."""
    first, amounts, rng = standing(CASE, seed)
    common = COMMON * rng.normal(size=first.errors.shape)
    number = 0
    while True:
        errors = common + OWN * rng.normal(size=common.shape)
        soft = 1.0 + SPREAD * rng.normal(size=len(amounts))
        soft[1] *= WORN if number == worn else 1.0
        machine = replace(stand(CASE, ARMS[CASE.arm], rng), errors=errors, shapes=first.shapes)
        yield Built(machine, [float(a * f) for a, f in zip(amounts, soft, strict=True)])
        number += 1


def mean_amounts(seed: int) -> list[float]:
    """Return the mean compliances of the type, rad/Nm."""
    return standing(CASE, seed)[1]


def table(sheet: Sheet, positions: Array | None = None) -> pd.DataFrame:
    """Poses as their user has them, with positions where they are given."""
    frame = pd.DataFrame({f"J{k} [deg]": v for k, v in enumerate(np.degrees(sheet.q).T, 1)})
    return (
        frame
        if positions is None
        else frame.assign(**{f"{a} [mm]": 1e3 * v for a, v in zip("xyz", positions.T, strict=True)})
    )

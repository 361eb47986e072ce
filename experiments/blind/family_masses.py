"""Weak drives on robots whose masses are missing, wrong, or known through measured torques; all drives weak."""

from __future__ import annotations

from dataclasses import replace

from experiments.blind.case import Case, Undeclared
from experiments.blind.case import effect as _e


def _weak(kind: str = "compliance", **sizes: float) -> tuple[Undeclared, ...]:
    return tuple(_e(kind, size, joint=int(name[1:])) for name, size in sizes.items())


OPEN = [
    Case("massless_irb", "irb_like", 150, 0.04, _weak("compliance_unknown", J2=0.25, J3=0.15), masses="none"),
    Case("massless_ur", "ur_like", 150, 0.03, _weak("compliance_unknown", J2=0.20), masses="none"),
    Case(
        "wrong_masses_kuka", "kuka_like", 200, 0.04, _weak("compliance_reweighed", J2=0.25, J3=0.20),
        masses="wrong", wrong=(3, 6),
    ),
    Case(
        "measured_torque_2", "staubli_like", 120, 0.03, _weak("compliance_measured", J2=0.20),
        masses="none", columns=("torque_J2", "torque_J3"),
    ),
    Case("seven_weak", "seven_tilted", 200, 0.03, _weak(**{f"J{j}": 0.08 for j in range(1, 8)})),
]  # fmt: skip
ASIDE = [
    Case(
        "massless_kuka", "kuka_like", 150, 0.04, _weak("compliance_unknown", J2=0.20, J3=0.20, J5=0.08), masses="none",
    ),
    Case("massless_ten", "cobot_ten", 200, 0.04, _weak("compliance_unknown", J3=0.25, J4=0.10), masses="none"),
    Case(
        "wrong_masses_ur", "ur_like", 150, 0.03, _weak("compliance_reweighed", J2=0.20, J3=0.15),
        masses="wrong", wrong=(2, 3),
    ),
    Case(
        "wrong_masses_welder", "welder", 150, 0.04, _weak("compliance_reweighed", J2=0.25, J5=0.10),
        masses="wrong", wrong=(3, 5),
    ),
    Case(
        "measured_torque_three", "puma_like", 150, 0.03,
        (*_weak("compliance_measured", J2=0.15, J3=0.15), _e("harmonic", 0.08, joint=1, per_turn=1)),
        masses="wrong", wrong=(2, 3), columns=("torque_J2", "torque_J3", "torque_J5"),
    ),
    Case(
        "seven_weak_150", "seven_tilted", 150, 0.03,
        _weak(J1=0.15, J2=0.10, J3=0.10, J4=0.12, J5=0.06, J6=0.06, J7=0.05),
    ),
]  # fmt: skip

CASES = [
    *(replace(case, family="masses") for case in OPEN),
    *(replace(case, family="masses", aside=True) for case in ASIDE),
]

"""Robots whose masses are missing, wrong or measured through torques, and robots on linear axes."""

from __future__ import annotations

from dataclasses import replace

from experiments.blind.case import Case, Undeclared
from experiments.blind.case import effect as _e


def _weak(kind: str, **sizes: float) -> tuple[Undeclared, ...]:
    return tuple(_e(kind, size, joint=int(name[1:])) for name, size in sizes.items())


OPEN_MASSES = [
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
    Case("seven_weak", "seven_tilted", 200, 0.03, _weak("compliance", **{f"J{j}": 0.08 for j in range(1, 8)})),
]  # fmt: skip
ASIDE_MASSES = [
    Case("massless_kuka", "kuka_like", 150, 0.04, _weak("compliance_unknown", J2=0.20, J3=0.20, J5=0.08), masses="none"),
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
    Case("six_weak_and_one", "seven_tilted", 150, 0.03, _weak("compliance", J1=.15, J2=.1, J3=.1, J4=.12, J5=.06, J6=.06, J7=.05)),
]  # fmt: skip

OPEN_LINEAR = [
    Case("rail_straightness", "rail_kuka", 150, 0.04, (_e("guideway", 0.15, joint=1, axis=0), _e("guideway", 0.10, joint=1, axis=4))),
    Case("gantry_screws", "gantry", 120, 0.03, (_e("gear_ratio", 0.15, joint=1), _e("gear_ratio", 0.10, joint=2), _e("cyclic", 0.06, joint=3, lead=0.01))),
    Case("gantry_guides", "gantry", 200, 0.03, (_e("guideway", 0.12, joint=1, axis=5), _e("guideway", 0.10, joint=2, axis=0))),
    Case("scara_cyclic", "scara", 100, 0.02, (_e("cyclic", 0.08, joint=3, lead=0.02), _e("harmonic", 0.10, joint=2, per_turn=1))),
    Case("ripple_101", "kuka_like", 200, 0.03, (_e("harmonic", 0.12, joint=2, per_turn=101.37),)),
]  # fmt: skip
ASIDE_LINEAR = [
    Case("lift_tilt", "lift_ur", 150, 0.03, (_e("guideway", 0.15, joint=1, axis=3), _e("gear_ratio", 0.10, joint=1))),
    Case("rail_screw", "rail_kuka", 150, 0.04, (_e("gear_ratio", 0.15, joint=1), _e("cyclic", 0.10, joint=1, lead=0.04), _e("compliance", 0.20, joint=4))),
    Case("gantry_sag", "gantry", 150, 0.04, (_e("sag", 0.15, joint=2), _e("guideway", 0.10, joint=1, axis=1, waves=3), _e("cyclic", 0.06, joint=1, lead=0.032))),
    Case("scara_straightness", "scara", 120, 0.02, (_e("guideway", 0.08, joint=3, axis=0), _e("guideway", 0.06, joint=3, axis=4))),
    Case("ripple_two", "welder", 250, 0.04, (_e("harmonic", 0.10, joint=3, per_turn=121.6), _e("harmonic", 0.10, joint=1, per_turn=77.45))),
]  # fmt: skip

CASES = [
    *(replace(case, family="masses") for case in OPEN_MASSES),
    *(replace(case, family="masses", aside=True) for case in ASIDE_MASSES),
    *(replace(case, family="linear") for case in OPEN_LINEAR),
    *(replace(case, family="linear", aside=True) for case in ASIDE_LINEAR),
]

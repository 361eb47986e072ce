"""Robots on linear axes, and the ripple of motors that make no whole number of turns to one of their joint."""

from __future__ import annotations

from dataclasses import replace

from experiments.blind.case import Case
from experiments.blind.case import effect as _e

OPEN = [
    Case(
        "rail_straightness", "rail_kuka", 150, 0.04,
        (_e("guideway", 0.15, joint=1, axis=0), _e("guideway", 0.10, joint=1, axis=4)),
    ),
    Case(
        "gantry_screws", "gantry", 120, 0.03,
        (_e("gear_ratio", 0.15, joint=1), _e("gear_ratio", 0.10, joint=2), _e("cyclic", 0.06, joint=3, lead=0.01)),
    ),
    Case(
        "gantry_guides", "gantry", 200, 0.03,
        (_e("guideway", 0.12, joint=1, axis=5), _e("guideway", 0.10, joint=2, axis=0)),
    ),
    Case(
        "scara_cyclic", "scara", 100, 0.02,
        (_e("cyclic", 0.08, joint=3, lead=0.02), _e("harmonic", 0.10, joint=2, per_turn=1)),
    ),
    Case("ripple_101", "kuka_like", 200, 0.03, (_e("harmonic", 0.12, joint=2, per_turn=101.37),)),
]  # fmt: skip
ASIDE = [
    Case(
        "lift_tilt", "lift_ur", 150, 0.03,
        (_e("guideway", 0.15, joint=1, axis=3), _e("gear_ratio", 0.10, joint=1)),
    ),
    Case(
        "rail_screw", "rail_kuka", 150, 0.04,
        (
            _e("gear_ratio", 0.15, joint=1), _e("cyclic", 0.10, joint=1, lead=0.04),
            _e("compliance", 0.20, joint=4),
        ),
    ),
    Case(
        "gantry_sag", "gantry", 150, 0.04,
        (
            _e("sag", 0.15, joint=2), _e("guideway", 0.10, joint=1, axis=1, waves=3),
            _e("cyclic", 0.06, joint=1, lead=0.032),
        ),
    ),
    Case(
        "scara_straightness", "scara", 120, 0.02,
        (_e("guideway", 0.08, joint=3, axis=0), _e("guideway", 0.06, joint=3, axis=4)),
    ),
    Case(
        "ripple_two", "welder", 250, 0.04,
        (_e("harmonic", 0.10, joint=3, per_turn=121.6), _e("harmonic", 0.10, joint=1, per_turn=77.45)),
    ),
]  # fmt: skip

CASES = [
    *(replace(case, family="linear") for case in OPEN),
    *(replace(case, family="linear", aside=True) for case in ASIDE),
]

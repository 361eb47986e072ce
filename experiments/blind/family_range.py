"""Robots measured on a part of one joint's range, with fresh poses inside and outside it."""

from __future__ import annotations

from dataclasses import replace

from experiments.blind.case import Case
from experiments.blind.case import effect as _e

OPEN = [
    Case("part_eccentric", "kuka_like", 120, 0.03, (_e("harmonic", 0.12, joint=2, per_turn=1),), trained=(2, 0.0, 0.6)),
    Case("part_weak", "irb_like", 120, 0.04, (_e("compliance", 0.15, joint=3),), trained=(3, 0.0, 0.6)),
    Case("part_curve", "ur_like", 200, 0.03, (_e("curve", 0.15, joint=1, harmonics=4),), trained=(1, 0.0, 0.6)),
    Case("part_windup", "puma_like", 120, 0.03, (_e("windup", 0.12, joint=2),), trained=(2, 0.0, 0.5)),
]
ASIDE = [
    Case("part_gear", "staubli_like", 120, 0.03, (_e("harmonic", 0.10, joint=4, per_turn=2),), trained=(4, 0.0, 0.5)),
    Case("part_weak_2", "welder", 120, 0.04, (_e("compliance", 0.15, joint=2),), trained=(2, 0.0, 0.5)),
    Case(
        "part_product", "seven_axes", 150, 0.03, (_e("product", 0.15, first=2, second=4, joint=5),),
        trained=(2, 0.0, 0.6),
    ),
    Case("part_rail", "rail_kuka", 150, 0.04, (_e("guideway", 0.12, joint=1, axis=0, waves=1),), trained=(1, 0.0, 0.7)),
]  # fmt: skip

CASES = [
    *(replace(case, family="range") for case in OPEN),
    *(replace(case, family="range", aside=True) for case in ASIDE),
]

"""List robots with several effects, and cobots with an error curve on every joint."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

from experiments.blind.case import Case, Undeclared
from experiments.blind.case import effect as _e


def _eccentric(joints: int, together: float) -> tuple[Undeclared, ...]:
    return tuple(_e("harmonic", together / sqrt(joints), joint=j, per_turn=1) for j in range(1, joints + 1))


def _curves(joints: int, each: float) -> tuple[Undeclared, ...]:
    return tuple(_e("curve", each, joint=j) for j in range(1, joints + 1))


_FOUR_IRB = (
    _e("base_compliance", 0.25),
    _e("compliance", 0.20, joint=2),
    _e("harmonic", 0.15, joint=1, per_turn=1),
    _e("harmonic", 0.10, joint=4, per_turn=2),
)
_FIVE_KUKA = (
    _e("compliance", 0.20, joint=3),
    _e("harmonic", 0.12, joint=2, per_turn=1),
    _e("harmonic", 0.08, joint=5, per_turn=2),
    _e("coupling", 0.08, source=4, joint=5),
    _e("thermal_link", 0.12, joint=2),
)
_SIX_STAUBLI = (
    _e("compliance", 0.15, joint=2),
    _e("compliance", 0.12, joint=3),
    _e("harmonic", 0.10, joint=1, per_turn=2),
    _e("harmonic", 0.08, joint=4, per_turn=1),
    _e("coupling", 0.08, source=5, joint=6),
    _e("thermal_arm", 0.12),
)
_SIX_TEN = (
    _e("base_compliance", 0.15),
    _e("compliance", 0.20, joint=3),
    _e("harmonic", 0.12, joint=2, per_turn=1),
    _e("harmonic", 0.06, joint=4, per_turn=1),
    _e("harmonic", 0.08, joint=1, per_turn=3),
    _e("gear_ratio", 0.08, joint=5),
)
_FOUR_UR = (
    _e("compliance", 0.15, joint=2),
    _e("harmonic", 0.12, joint=1, per_turn=1),
    _e("harmonic", 0.10, joint=3, per_turn=2),
    _e("gravity_backlash", 0.10, joint=3),
)
_FIVE_PUMA = (
    _e("compliance", 0.15, joint=3),
    _e("payload_deflection", 0.15, joint=2),
    _e("approach", 0.10, joint=1),
    _e("harmonic", 0.08, joint=5, per_turn=1),
    _e("coupling", 0.08, source=4, joint=6),
)
_SIX_WELDER = (
    _e("base_compliance", 0.20),
    _e("compliance", 0.15, joint=2),
    _e("cross_bending", 0.12, joint=3),
    _e("harmonic", 0.12, joint=3, per_turn=1),
    _e("harmonic", 0.08, joint=6, per_turn=2),
    _e("thermal_link", 0.12, joint=3),
)
_SIX_SEVEN = (
    _e("compliance", 0.12, joint=2),
    _e("compliance", 0.12, joint=4),
    _e("harmonic", 0.10, joint=3, per_turn=1),
    _e("harmonic", 0.08, joint=5, per_turn=2),
    _e("harmonic", 0.08, joint=7, per_turn=1),
    _e("base_compliance", 0.10),
)

OPEN = [
    Case("four_150", "irb_like", 150, 0.04, _FOUR_IRB),
    Case("five_150", "kuka_like", 150, 0.04, _FIVE_KUKA, columns=("temperature", "humidity"), outliers=0.02),
    Case("six_150", "staubli_like", 150, 0.03, _SIX_STAUBLI, columns=("temperature",)),
    Case("four_800", "irb_like", 800, 0.04, _FOUR_IRB, noise="distance"),
    Case("six_800", "cobot_ten", 800, 0.05, _SIX_TEN),
    Case("eccentric_all_150", "puma_like", 150, 0.04, _eccentric(6, 0.07)),
    Case("eccentric_all_800", "ur_like", 800, 0.04, _eccentric(6, 0.07)),
]
ASIDE = [
    Case("four_ur_150", "ur_like", 150, 0.03, _FOUR_UR),
    Case("five_puma_150", "puma_like", 150, 0.03, _FIVE_PUMA, columns=("payload", "approach_J1", "operator")),
    Case("six_welder_150", "welder", 150, 0.05, _SIX_WELDER, columns=("temperature",)),
    Case("six_seven_150", "seven_axes", 150, 0.03, _SIX_SEVEN, outliers=0.02),
    Case("five_puma_800", "puma_like", 800, 0.04, _FIVE_PUMA, columns=("payload", "approach_J1")),
    Case("six_welder_800", "welder", 800, 0.05, _SIX_WELDER, columns=("temperature", "humidity"), noise="distance"),
    Case("eccentric_all_kuka_150", "kuka_like", 150, 0.05, _eccentric(6, 0.087)),
    Case("eccentric_all_ten_800", "cobot_ten", 800, 0.04, _eccentric(6, 0.07)),
]
OPEN_CURVES = [
    Case("curves_ur", "ur_like", 400, 0.03, _curves(6, 0.08)),
    Case("curves_seven", "seven_axes", 400, 0.03, _curves(7, 0.06)),
]
ASIDE_CURVES = [
    Case("curves_ten", "cobot_ten", 400, 0.04, _curves(6, 0.08)),
    Case("curves_staubli", "staubli_like", 400, 0.02, _curves(6, 0.05), outliers=0.02),
    Case("curves_and_weak", "ur_like", 400, 0.03, (*_curves(6, 0.06), _e("compliance", 0.15, joint=2))),
]

CASES = [
    *(replace(case, family="several") for case in OPEN),
    *(replace(case, family="several", aside=True) for case in ASIDE),
    *(replace(case, family="curves") for case in OPEN_CURVES),
    *(replace(case, family="curves", aside=True) for case in ASIDE_CURVES),
]

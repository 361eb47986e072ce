"""Robots with a memory: rows in the order of measurement, and no column for what matters but time and temperature."""

from __future__ import annotations

from dataclasses import replace

from experiments.blind.case import Case
from experiments.blind.case import effect as _e

_CLOCK = ("time", "room")

OPEN = [
    Case("last_move_3", "puma_like", 150, 0.03, (_e("last_move", 0.15, joint=3),)),
    Case("last_move_two", "kuka_like", 200, 0.04, (_e("last_move", 0.20, joint=2), _e("last_move", 0.10, joint=1))),
    Case("hysteresis_2", "staubli_like", 250, 0.03, (_e("hysteresis", 0.15, joint=2),), order="walk"),
    Case("friction_2", "irb_like", 200, 0.04, (_e("friction_windup", 0.20, joint=2),), order="walk"),
    Case("lag_link", "irb_like", 200, 0.04, (_e("lagging_structure", 0.15, joint=2),), columns=_CLOCK, minutes=300),
    Case(
        "lag_base", "kuka_like", 150, 0.04, (_e("lagging_structure", 0.15, joint=1, what="tilts"),),
        columns=_CLOCK, minutes=240,
    ),
    Case("settling_2", "ur_like", 150, 0.03, (_e("settling", 0.12, joint=2),), columns=("time",), minutes=180),
    Case(
        "move_and_weak", "staubli_like", 200, 0.03,
        (_e("last_move", 0.10, joint=2), _e("compliance", 0.15, joint=3), _e("harmonic", 0.10, joint=1, per_turn=1)),
    ),
]  # fmt: skip
ASIDE = [
    Case("last_move_2", "ur_like", 150, 0.03, (_e("last_move", 0.20, joint=2),)),
    Case("last_move_wrist", "irb_like", 200, 0.04, (_e("last_move", 0.12, joint=5), _e("last_move", 0.15, joint=3))),
    Case("hysteresis_1", "seven_axes", 250, 0.03, (_e("hysteresis", 0.12, joint=1),), order="walk"),
    Case("hysteresis_3", "kuka_like", 200, 0.03, (_e("hysteresis", 0.20, joint=3, elements=2),), order="walk"),
    Case("friction_3", "welder", 200, 0.04, (_e("friction_windup", 0.20, joint=3),)),
    Case(
        "lag_shoulder", "staubli_like", 150, 0.03, (_e("lagging_structure", 0.12, joint=1, what="tilts"),),
        columns=("time", "room", "humidity"), minutes=300,
    ),
    Case("lag_forearm", "puma_like", 200, 0.03, (_e("lagging_structure", 0.15, joint=3),), columns=_CLOCK, minutes=240),
    Case(
        "settling_3", "cobot_ten", 150, 0.04, (_e("settling", 0.15, joint=3, axis=2),),
        columns=("time",), minutes=200,
    ),
    Case(
        "move_lag_ripple", "kuka_like", 300, 0.04,
        (
            _e("last_move", 0.15, joint=2), _e("lagging_structure", 0.12, joint=2),
            _e("harmonic", 0.10, joint=4, per_turn=2),
        ),
        columns=_CLOCK, minutes=300,
    ),
]  # fmt: skip

CASES = [
    *(replace(case, family="memory", in_order=True) for case in OPEN),
    *(replace(case, family="memory", in_order=True, aside=True) for case in ASIDE),
]

"""Robots that have nothing, under an instrument that has: an effect of the robot is wrong."""

from __future__ import annotations

from dataclasses import replace

from experiments.blind.case import Case
from experiments.blind.case import effect as _e

_DRIFT = _e("instrument_drift", 0.12)

OPEN = [
    Case("range_offset", "kuka_like", 120, 0.03, (_e("range_offset", 0.12),)),
    Case("range_scale", "irb_like", 100, 0.03, (_e("range_scale", 0.0, amount=80e-6),)),
    Case("azimuth", "ur_like", 120, 0.03, (_e("azimuth_eccentric", 0.12),)),
    Case("smooth_field", "staubli_like", 450, 0.03, (_e("instrument_field", 0.10),)),
    Case("tracker_walk", "puma_like", 120, 0.03, walk_mm=0.10),
    Case("tracker_drift", "irb_like", 120, 0.03, (_DRIFT,), in_order=True),
]
ASIDE = [
    Case("elevation_index", "welder", 120, 0.03, (_e("elevation_index", 0.08),)),
    Case("range_scale_seven", "seven_axes", 120, 0.03, (_e("range_scale", 0.0, amount=60e-6),)),
    Case("azimuth_and_offset", "kuka_like", 150, 0.03, (_e("azimuth_eccentric", 0.10), _e("range_offset", 0.08))),
    Case("smooth_field_ten", "cobot_ten", 450, 0.03, (_e("instrument_field", 0.12),)),
    Case("tracker_walk_ur", "ur_like", 150, 0.03, walk_mm=0.08),
    Case("tracker_walk_seven", "seven_axes", 300, 0.03, walk_mm=0.15, columns=("time",)),
    Case("tracker_drift_ten", "cobot_ten", 120, 0.03, (_DRIFT,), columns=("time",), in_order=True),
]

CASES = [
    *(replace(case, family="instrument", tracker="levelled") for case in OPEN),
    *(replace(case, family="instrument", tracker="levelled", aside=True) for case in ASIDE),
]

"""Robots that have nothing, measured as it happens; instruments that have; and ranges that end before the poses do."""

from __future__ import annotations

from dataclasses import replace

from experiments.blind.case import Case
from experiments.blind.case import effect as _e

OPEN_INSTRUMENT = [
    Case("range_offset", "kuka_like", 120, 0.03, (_e("range_offset", 0.12),)),
    Case("range_scale", "irb_like", 100, 0.03, (_e("range_scale", 0.0, amount=80e-6),)),
    Case("azimuth", "ur_like", 120, 0.03, (_e("azimuth_eccentric", 0.12),)),
    Case("smooth_field", "staubli_like", 450, 0.03, (_e("instrument_field", 0.10),)),
    Case("tracker_walk", "puma_like", 120, 0.03, walk_mm=0.10),
    Case("tracker_drift", "irb_like", 120, 0.03, (_e("instrument_drift", 0.12),), in_order=True),
]
ASIDE_INSTRUMENT = [
    Case("elevation_index", "welder", 120, 0.03, (_e("elevation_index", 0.12),)),
    Case("scale_on_a_rail", "rail_kuka", 150, 0.04, (_e("range_scale", 0.0, amount=60e-6),)),
    Case("azimuth_and_offset", "kuka_like", 150, 0.03, (_e("azimuth_eccentric", 0.10), _e("range_offset", 0.08))),
    Case("smooth_field_ten", "cobot_ten", 450, 0.03, (_e("instrument_field", 0.12),)),
    Case("tracker_walk_ur", "ur_like", 150, 0.03, walk_mm=0.08),
    Case("tracker_walk_seven", "seven_axes", 300, 0.03, walk_mm=0.15, columns=("time",)),
    Case(
        "tracker_drift_ten", "cobot_ten", 120, 0.03, (_e("instrument_drift", 0.10),), columns=("time",), in_order=True
    ),
]

OPEN_INNOCENT = [
    Case("plain_cobot", "cobot_ten", 150, 0.05),
    Case("repeats_labelled", "irb_like", 180, 0.015, repeats=3, labelled=True, shared_mm=0.04),
    Case("repeats_jitter", "ur_like", 180, 0.01, repeats=3, shared_mm=0.04),
    Case("clusters", "kuka_like", 120, 0.03, order="clusters", shared_mm=0.02),
    Case("student", "puma_like", 100, 0.04, noise="student"),
    Case("narrow", "staubli_like", 100, 0.03, narrow=0.15),
    Case("two_move", "irb_like", 90, 0.03, moving=(2, 3)),
    Case("walk_order", "ur_like", 150, 0.03, order="walk", columns=("time", "room")),
]
ASIDE_INNOCENT = [
    Case("plain_rail", "rail_kuka", 150, 0.04, columns=("temperature", "humidity")),
    Case("repeats_labelled_puma", "puma_like", 180, 0.02, repeats=3, labelled=True, shared_mm=0.05),
    Case("repeats_jitter_kuka", "kuka_like", 180, 0.02, repeats=3, shared_mm=0.05),
    Case("clusters_seven", "seven_axes", 200, 0.03, order="clusters", shared_mm=0.03),
    Case("student_welder", "welder", 150, 0.05, noise="student", columns=("operator",)),
    Case("narrow_ten", "cobot_ten", 120, 0.03, narrow=0.2),
    Case("two_move_ur", "ur_like", 90, 0.03, moving=(1, 4)),
    Case("gantry_plain", "gantry", 120, 0.03, columns=("time", "room")),
]

OPEN_RANGE = [
    Case(
        "part_eccentric_2", "kuka_like", 120, 0.03, (_e("harmonic", 0.12, joint=2, per_turn=1),), trained=(2, 0.0, 0.6)
    ),
    Case("part_weak_3", "irb_like", 120, 0.04, (_e("compliance", 0.15, joint=3),), trained=(3, 0.0, 0.6)),
    Case("part_curve_1", "ur_like", 200, 0.03, (_e("curve", 0.15, joint=1, harmonics=4),), trained=(1, 0.0, 0.6)),
    Case("part_windup_2", "puma_like", 120, 0.03, (_e("windup", 0.12, joint=2),), trained=(2, 0.0, 0.5)),
]
ASIDE_RANGE = [
    Case("part_gear_4", "staubli_like", 120, 0.03, (_e("harmonic", 0.10, joint=4, per_turn=2),), trained=(4, 0.0, 0.5)),
    Case("part_weak_2", "welder", 120, 0.04, (_e("compliance", 0.15, joint=2),), trained=(2, 0.0, 0.5)),
    Case(
        "part_product",
        "staubli_like",
        150,
        0.03,
        (_e("product", 0.15, first=2, second=4, joint=5),),
        trained=(2, 0.0, 0.6),
    ),
    Case("part_rail", "rail_kuka", 150, 0.04, (_e("guideway", 0.15, joint=1, axis=0),), trained=(1, 0.0, 0.6)),
]

CASES = [
    *(replace(case, family="instrument", tracker="levelled") for case in OPEN_INSTRUMENT),
    *(replace(case, family="instrument", tracker="levelled", aside=True) for case in ASIDE_INSTRUMENT),
    *(replace(case, family="innocent") for case in OPEN_INNOCENT),
    *(replace(case, family="innocent", aside=True) for case in ASIDE_INNOCENT),
    *(replace(case, family="range") for case in OPEN_RANGE),
    *(replace(case, family="range", aside=True) for case in ASIDE_RANGE),
]

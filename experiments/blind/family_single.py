"""List robots with one effect, two effects or none, measured at about eighty poses."""

from __future__ import annotations

from experiments.blind.case import Case
from experiments.blind.case import effect as _e

OPEN = [
    Case("base", "irb_like", 80, 0.04, (_e("base_compliance", 0.30),)),
    Case("compliance_2", "kuka_like", 80, 0.04, (_e("compliance", 0.25, joint=2),), masses_off=0.1),
    Case("bending_5", "irb_like", 90, 0.05, (_e("compliance", 0.20, joint=5),)),
    Case("cross_bending_3", "kuka_like", 90, 0.03, (_e("cross_bending", 0.15, joint=3),)),
    Case("eccentric_1", "ur_like", 60, 0.03, (_e("harmonic", 0.20, joint=1, per_turn=1),)),
    Case("gear_4_twice", "staubli_like", 80, 0.02, (_e("harmonic", 0.12, joint=4, per_turn=2),)),
    Case("ripple_2_seven", "seven_axes", 120, 0.03, (_e("harmonic", 0.15, joint=2, per_turn=7),)),
    Case("wrist_coupling", "puma_like", 80, 0.03, (_e("coupling", 0.15, source=4, joint=5),)),
    Case("ratio_3", "kuka_like", 80, 0.03, (_e("gear_ratio", 0.20, joint=3),), columns=("humidity",)),
    Case("thermal_arm", "kuka_like", 90, 0.04, (_e("thermal_arm", 0.15),), columns=("temperature", "humidity")),
    Case("drift", "staubli_like", 80, 0.03, (_e("drift", 0.12),)),
    Case("setup_step", "irb_like", 90, 0.04, (_e("step", 0.30, where="setup"),)),
    Case("approach_3", "puma_like", 80, 0.03, (_e("approach", 0.15, joint=3),), columns=("approach_J3",)),
    Case("backlash_2", "staubli_like", 90, 0.03, (_e("gravity_backlash", 0.15, joint=2),)),
    Case("payload_2", "irb_like", 90, 0.04, (_e("payload_deflection", 0.25, joint=2),), columns=("payload",)),
    Case("bump_2", "puma_like", 100, 0.03, (_e("bump", 0.15, joint=2),)),
    Case("windup_3", "kuka_like", 120, 0.04, (_e("windup", 0.20, joint=3),), noise="distance"),
    Case("product_2_4", "staubli_like", 120, 0.03, (_e("product", 0.15, first=2, second=4, joint=5),)),
    Case(
        "base_and_ripple",
        "irb_like",
        120,
        0.04,
        (_e("base_compliance", 0.30), _e("harmonic", 0.12, joint=4, per_turn=2)),
        outliers=0.02,
    ),
    Case("threshold_5", "puma_like", 80, 0.05, (_e("compliance", 0.05, joint=5),)),
    Case("null_ur", "ur_like", 60, 0.03),
    Case("null_outliers", "irb_like", 90, 0.05, outliers=0.02),
    Case("null_columns", "kuka_like", 80, 0.03, columns=("humidity", "operator", "temperature")),
    Case("null_seven", "seven_axes", 100, 0.03, noise="distance"),
]

ASIDE = [
    Case("base_7", "seven_axes", 100, 0.03, (_e("base_compliance", 0.15),), aside=True),
    Case("compliance_3", "ur_like", 80, 0.03, (_e("compliance", 0.20, joint=3),), outliers=0.02, aside=True),
    Case("bending_5_stiff", "kuka_like", 80, 0.04, (_e("compliance", 0.15, joint=5),), noise="distance", aside=True),
    Case("eccentric_3", "irb_like", 80, 0.04, (_e("harmonic", 0.20, joint=3, per_turn=1),), aside=True),
    Case("gear_1_twice", "ur_like", 70, 0.02, (_e("harmonic", 0.20, joint=1, per_turn=2),), aside=True),
    Case("ripple_5_three", "staubli_like", 90, 0.03, (_e("harmonic", 0.12, joint=5, per_turn=3),), aside=True),
    Case("coupling_five_six", "puma_like", 80, 0.02, (_e("coupling", 0.10, source=5, joint=6),), aside=True),
    Case("ratio_2", "four_axes", 60, 0.03, (_e("gear_ratio", 0.15, joint=2),), aside=True),
    Case(
        "thermal_link", "irb_like", 80, 0.04, (_e("thermal_link", 0.10, joint=2),), columns=("temperature",), aside=True
    ),
    Case("warm_up_row", "puma_like", 90, 0.03, (_e("warm_up", 0.12, joint=2, by="row"),), aside=True),
    Case(
        "warm_up_time", "kuka_like", 90, 0.04, (_e("warm_up", 0.20, joint=2, by="time"),), columns=("time",), aside=True
    ),
    Case("tool_slip", "ur_like", 80, 0.03, (_e("step", 0.20, where="tool"),), aside=True),
    Case(
        "approach_2",
        "four_axes",
        60,
        0.04,
        (_e("approach", 0.15, joint=2),),
        columns=("approach_J2", "operator"),
        aside=True,
    ),
    Case("hardening_2", "kuka_like", 120, 0.03, (_e("hardening", 0.25, joint=2),), aside=True),
    Case("spring_2", "irb_like", 80, 0.04, (_e("spring", 0.20, joint=2),), aside=True),
    Case("dead_zone_2", "staubli_like", 120, 0.03, (_e("dead_zone", 0.20, joint=2),), aside=True),
    Case("difference_2_3", "kuka_like", 90, 0.03, (_e("difference", 0.15, first=2, second=3, joint=3),), aside=True),
    Case(
        "payload_and_approach",
        "puma_like",
        120,
        0.03,
        (_e("payload_deflection", 0.20, joint=3), _e("approach", 0.10, joint=2)),
        columns=("payload", "approach_J2", "humidity"),
        aside=True,
    ),
    Case("threshold_ripple", "kuka_like", 80, 0.04, (_e("harmonic", 0.05, joint=4, per_turn=2),), aside=True),
    Case("threshold_base", "staubli_like", 80, 0.05, (_e("base_compliance", 0.06),), aside=True),
    Case("null_puma", "puma_like", 80, 0.04, noise="distance", aside=True),
    Case("null_outliers_ur", "ur_like", 80, 0.03, outliers=0.02, columns=("operator",), aside=True),
    Case("null_payload", "irb_like", 90, 0.04, columns=("payload", "approach_J3"), aside=True),
    Case("null_four", "four_axes", 60, 0.03, columns=("humidity", "time"), aside=True),
]

CASES = OPEN + ASIDE

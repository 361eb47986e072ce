"""List all blind robots by name."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from experiments.blind import family_many, family_single
from experiments.blind.case import Case, Undeclared
from experiments.blind.case import effect as _e

__all__ = ["CASES", "FAMILIES", "Case"]

_CLOCK = ("time", "room")

MEMORY = [
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
MEMORY_ASIDE = [
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
"""Robots with a memory: rows in the order of measurement, and no column for what matters but time and temperature."""


def _weak(kind: str = "compliance", **sizes: float) -> tuple[Undeclared, ...]:
    return tuple(_e(kind, size, joint=int(name[1:])) for name, size in sizes.items())


MASSES = [
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
MASSES_ASIDE = [
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
"""Weak drives on robots whose masses are missing, wrong, or known through measured torques; all drives weak."""

LINEAR = [
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
LINEAR_ASIDE = [
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
"""Robots on linear axes, and the ripple of motors that make no whole number of turns to one of their joint."""

_DRIFT = _e("instrument_drift", 0.12)

INSTRUMENT = [
    Case("range_offset", "kuka_like", 120, 0.03, (_e("range_offset", 0.12),)),
    Case("range_scale", "irb_like", 100, 0.03, (_e("range_scale", 0.0, amount=80e-6),)),
    Case("azimuth", "ur_like", 120, 0.03, (_e("azimuth_eccentric", 0.12),)),
    Case("smooth_field", "staubli_like", 450, 0.03, (_e("instrument_field", 0.10),)),
    Case("tracker_walk", "puma_like", 120, 0.03, walk_mm=0.10),
    Case("tracker_drift", "irb_like", 120, 0.03, (_DRIFT,), in_order=True),
]
INSTRUMENT_ASIDE = [
    Case("elevation_index", "welder", 120, 0.03, (_e("elevation_index", 0.08),)),
    Case("range_scale_seven", "seven_axes", 120, 0.03, (_e("range_scale", 0.0, amount=60e-6),)),
    Case("azimuth_and_offset", "kuka_like", 150, 0.03, (_e("azimuth_eccentric", 0.10), _e("range_offset", 0.08))),
    Case("smooth_field_ten", "cobot_ten", 450, 0.03, (_e("instrument_field", 0.12),)),
    Case("tracker_walk_ur", "ur_like", 150, 0.03, walk_mm=0.08),
    Case("tracker_walk_seven", "seven_axes", 300, 0.03, walk_mm=0.15, columns=("time",)),
    Case("tracker_drift_ten", "cobot_ten", 120, 0.03, (_DRIFT,), columns=("time",), in_order=True),
]
"""Robots that have nothing, under an instrument that has: an effect of the robot is wrong."""

INNOCENT = [
    Case("plain_cobot", "cobot_ten", 150, 0.05),
    Case("repeats_labelled", "irb_like", 180, 0.015, repeats=3, labelled=True, shared_mm=0.04),
    Case("repeats_jitter", "ur_like", 180, 0.01, repeats=3, shared_mm=0.04),
    Case("clusters", "kuka_like", 120, 0.03, order="clusters", shared_mm=0.02),
    Case("student", "puma_like", 100, 0.04, noise="student"),
    Case("narrow", "staubli_like", 100, 0.03, narrow=0.15),
    Case("two_move", "irb_like", 90, 0.03, moving=(2, 3)),
    Case("small_moves", "ur_like", 150, 0.03, order="walk", columns=_CLOCK),
]
INNOCENT_ASIDE = [
    Case("plain_rail", "rail_kuka", 150, 0.04, columns=("temperature", "humidity")),
    Case("repeats_labelled_puma", "puma_like", 180, 0.02, repeats=3, labelled=True, shared_mm=0.05),
    Case("repeats_jitter_kuka", "kuka_like", 180, 0.02, repeats=3, shared_mm=0.05),
    Case("clusters_seven", "seven_axes", 200, 0.03, order="clusters", shared_mm=0.03),
    Case("student_welder", "welder", 150, 0.05, noise="student", columns=("operator",)),
    Case("narrow_ten", "cobot_ten", 120, 0.03, narrow=0.2),
    Case("two_move_ur", "ur_like", 90, 0.03, moving=(1, 4)),
    Case("plain_gantry", "gantry", 120, 0.03, columns=_CLOCK),
]
"""Robots that have nothing, measured as it happens: repeats, clusters, heavy tails, few joints, little room."""

RANGE = [
    Case("part_eccentric", "kuka_like", 120, 0.03, (_e("harmonic", 0.12, joint=2, per_turn=1),), trained=(2, 0.0, 0.6)),
    Case("part_weak", "irb_like", 120, 0.04, (_e("compliance", 0.15, joint=3),), trained=(3, 0.0, 0.6)),
    Case("part_curve", "ur_like", 200, 0.03, (_e("curve", 0.15, joint=1, harmonics=4),), trained=(1, 0.0, 0.6)),
    Case("part_windup", "puma_like", 120, 0.03, (_e("windup", 0.12, joint=2),), trained=(2, 0.0, 0.5)),
]
RANGE_ASIDE = [
    Case("part_gear", "staubli_like", 120, 0.03, (_e("harmonic", 0.10, joint=4, per_turn=2),), trained=(4, 0.0, 0.5)),
    Case("part_weak_2", "welder", 120, 0.04, (_e("compliance", 0.15, joint=2),), trained=(2, 0.0, 0.5)),
    Case(
        "part_product", "seven_axes", 150, 0.03, (_e("product", 0.15, first=2, second=4, joint=5),),
        trained=(2, 0.0, 0.6),
    ),
    Case("part_rail", "rail_kuka", 150, 0.04, (_e("guideway", 0.12, joint=1, axis=0, waves=1),), trained=(1, 0.0, 0.7)),
]  # fmt: skip
"""Robots measured on a part of one joint's range, with fresh poses inside and outside it."""


def _both(opened: Sequence[Case], aside: Sequence[Case], **of: Any) -> Iterator[Case]:
    yield from (replace(case, **of) for case in opened)
    yield from (replace(case, aside=True, **of) for case in aside)


_EVERY = (
    *family_single.CASES,
    *family_many.CASES,
    *_both(MEMORY, MEMORY_ASIDE, family="memory", in_order=True),
    *_both(MASSES, MASSES_ASIDE, family="masses"),
    *_both(LINEAR, LINEAR_ASIDE, family="linear"),
    *_both(INSTRUMENT, INSTRUMENT_ASIDE, family="instrument", tracker="levelled"),
    *_both(INNOCENT, INNOCENT_ASIDE, family="innocent"),
    *_both(RANGE, RANGE_ASIDE, family="range"),
)
CASES: dict[str, Case] = {case.name: case for case in _EVERY}
FAMILIES: tuple[str, ...] = tuple(dict.fromkeys(case.family for case in CASES.values()))

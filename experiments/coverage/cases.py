"""Robots of the blind simulator by what is asked of them: one effect of known size, several, or nothing."""

from __future__ import annotations

from experiments.blind.case import Case, effect
from experiments.blind.cases import CASES

_EFFECTS = {
    "compliance": ("kuka_like", effect("compliance", 0.2, joint=3), "joint compliance, J3"),
    "ratio": ("staubli_like", effect("gear_ratio", 0.15, joint=3), "gear ratio, J3"),
    "coupling": ("puma_like", effect("coupling", 0.15, source=4, joint=5), "coupling, J4 to J5"),
    "eccentric": ("irb_like", effect("harmonic", 0.2, joint=3, per_turn=1), "eccentricity, 1 per turn, J3"),
}
_SHARED = {"poses": 180, "repeats": 3, "shared_mm": 0.04}
_MEASURED = {
    "single": {"poses": 80, "noise_mm": 0.03},
    "labelled": {**_SHARED, "noise_mm": 0.015, "labelled": True},
    "jitter": {**_SHARED, "noise_mm": 0.01},
    "repeated": {"poses": 180, "repeats": 3, "noise_mm": 0.03, "labelled": True},
}
DECLARED = {f"{kind} {how}": name for kind, (_, _, name) in _EFFECTS.items() for how in _MEASURED}
"""The catalogue's name of the one effect that a robot of the family `known` has."""


_ROWS = (
    Case("walk", "kuka_like", 120, 0.03, walk_mm=0.06),
    Case("walk_in_order", "irb_like", 150, 0.03, walk_mm=0.06, columns=("time", "room"), order="walk"),
)
"""Innocent robots under a tracker that wanders at random: neighbouring rows err alike."""

_CLUSTERED = (
    Case("twelve_clusters", "irb_like", 120, 0.02, order="clusters", shared_mm=0.05),
    Case("twenty_clusters", "ur_like", 200, 0.02, order="clusters", shared_mm=0.05),
)
"""Innocent robots measured in clusters of ten neighbouring poses that err alike, and no label says so."""


def _named(names: str) -> dict[str, Case]:
    return {name: CASES[name] for name in names.split()}


FAMILIES: dict[str, dict[str, Case]] = {
    "known": {
        f"{kind} {how}": Case(f"{kind} {how}", arm, effects=(undeclared,), **measured)
        for kind, (arm, undeclared, _) in _EFFECTS.items()
        for how, measured in _MEASURED.items()
    },
    "independent": _named("null_ur null_outliers null_columns null_seven plain_cobot"),
    "dependent": _named("repeats_labelled repeats_jitter clusters student narrow two_move small_moves"),
    "instrument": _named("range_offset range_scale azimuth smooth_field tracker_walk tracker_drift"),
    "independent_aside": _named("null_puma null_outliers_ur null_payload null_four plain_rail plain_gantry"),
    "dependent_aside": _named(
        "repeats_labelled_puma repeats_jitter_kuka clusters_seven student_welder narrow_ten two_move_ur"
    ),
    "instrument_aside": _named(
        "elevation_index range_scale_seven azimuth_and_offset smooth_field_ten tracker_walk_ur tracker_walk_seven "
        "tracker_drift_ten"
    ),
    "rows": {c.name: c for c in _ROWS},
    "clustered": {c.name: c for c in _CLUSTERED},
    "single": {n: c for n, c in CASES.items() if c.family == "single" and c.effects},
    "several": {n: c for n, c in CASES.items() if c.family in ("several", "masses") and c.poses <= 200},
    "memory": {n: c for n, c in CASES.items() if c.family == "memory"},
    "linear": {n: c for n, c in CASES.items() if c.family == "linear"},
}

"""Machines by number, for asking whether what is printed of them holds: kind of arm, way of measuring, effect or none.

Machine n belongs to stratum n mod 12; its arm and its effect are drawn from a stream of their own.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from experiments.blind.case import Case, effect

STRATA: dict[str, dict[str, Any]] = {
    "30 poses": {"poses": 30, "noise_mm": 0.03},
    "60 poses": {"poses": 60, "noise_mm": 0.05},
    "120 poses": {"poses": 120, "noise_mm": 0.03},
    "400 poses": {"poses": 400, "noise_mm": 0.03},
    "repeats, labelled": {"poses": 180, "repeats": 3, "labelled": True, "noise_mm": 0.015, "shared_mm": 0.04},
    "repeats, jitter": {"poses": 150, "repeats": 3, "noise_mm": 0.02, "shared_mm": 0.03},
    "heavy tails": {"poses": 100, "noise_mm": 0.05, "noise": "student"},
    "outliers": {"poses": 80, "noise_mm": 0.03, "outliers": 0.04},
    "clusters": {"poses": 200, "noise_mm": 0.02, "order": "clusters", "shared_mm": 0.03},
    "drift": {"poses": 100, "noise_mm": 0.03, "walk_mm": 0.05},
    "noise by distance": {"poses": 80, "noise_mm": 0.04, "noise": "distance", "tracker": "levelled"},
    "narrow": {"poses": 90, "noise_mm": 0.03, "narrow": 0.35},
}
ARMS = ("ur_like", "irb_like", "puma_like", "staubli_like", "kuka_like", "seven_axes", "cobot_ten", "welder",
        "four_axes", "rail_kuka", "scara", "gantry")  # fmt: skip
_SIX = frozenset(ARMS[:8])
EFFECTS = {
    "compliance": (effect("compliance", 0.2, joint=3), "joint compliance, J3"),
    "ratio": (effect("gear_ratio", 0.15, joint=3), "gear ratio, J3"),
    "coupling": (effect("coupling", 0.15, source=4, joint=5), "coupling, J4 to J5"),
    "eccentric": (effect("harmonic", 0.2, joint=3, per_turn=1), "eccentricity, 1 per turn, J3"),
    "base": (effect("base_compliance", 0.2), "base compliance"),
}
"""Undeclared effects beyond geometry, and the catalogue's name of each."""


def machine_of(number: int) -> tuple[str, Case, str]:
    """Stratum, case, and the catalogue's name of the effect that the machine has, empty for none."""
    stratum = list(STRATA)[number % len(STRATA)]
    rng = np.random.default_rng([number, 20])
    arm = ARMS[rng.integers(len(ARMS))]
    kind = str(rng.choice(list(EFFECTS))) if arm in _SIX and rng.uniform() < 0.6 else ""
    undeclared, name = EFFECTS.get(kind, (None, ""))
    case = Case(f"{stratum}, {arm}, {kind}", arm, effects=(undeclared,) if undeclared else (), **STRATA[stratum])
    return stratum, case, name

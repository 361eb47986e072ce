"""All blind robots by name."""

from __future__ import annotations

from experiments.blind import (
    family_innocent,
    family_instrument,
    family_linear,
    family_many,
    family_masses,
    family_memory,
    family_range,
    family_single,
)
from experiments.blind.case import Case

__all__ = ["CASES", "FAMILIES", "Case"]

_MODULES = (
    family_single, family_many, family_memory, family_masses, family_linear, family_instrument, family_innocent,
    family_range,
)  # fmt: skip
CASES: dict[str, Case] = {case.name: case for module in _MODULES for case in module.CASES}
FAMILIES: tuple[str, ...] = tuple(dict.fromkeys(case.family for case in CASES.values()))

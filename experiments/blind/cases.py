"""All blind robots by name."""

from __future__ import annotations

from experiments.blind import family_load, family_many, family_measuring, family_memory, family_single
from experiments.blind.case import Case

__all__ = ["CASES", "FAMILIES", "Case"]

_MODULES = (family_single, family_many, family_memory, family_load, family_measuring)
CASES: dict[str, Case] = {case.name: case for module in _MODULES for case in module.CASES}
FAMILIES: tuple[str, ...] = tuple(dict.fromkeys(case.family for case in CASES.values()))

"""Findings of a method compared with the drawn formula."""

from __future__ import annotations

from typing import Any

import numpy as np

from experiments.blind.grading import nodes
from experiments.blind.simulator import Array
from experiments.random_laws.law import Place, places
from experiments.random_laws.robot import Robot
from gpmodel.errors import InputError
from gpmodel.model.states import States
from gpmodel.report.schema_search import EffectRecord

CLOCKS = ("row", "time")
ALIKE = 0.95
"""Inputs whose columns correlate by more are one input; places that move the tool so much alike are one place."""


def stands_for(found: str, true: str, states: States) -> bool:
    """Return whether an input is the true one, or proportional to it over the poses."""
    if found == true:
        return True
    try:
        pair = np.array([states[found], states[true]])
    except InputError:
        return False
    return bool(np.ptp(pair, axis=1).min() > 0 and abs(np.corrcoef(pair)[0, 1]) > ALIKE)


def alike(first: Array, second: Array) -> float:
    """Cosine between two motions of the tool (N, 3), pose by pose, each pose weighted by both sizes."""
    sizes = np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
    return float(np.abs(np.sum(first * second, axis=1)).sum() / max(sizes.sum(), 1e-300))


def same_place(finding: EffectRecord, robot: Robot) -> bool:
    """Return whether a finding acts at the site of the formula, or moves the tool alike."""
    place = Place(finding.slot, finding.axis)
    if robot.place is None or place not in places(robot.machine.arm):
        return False
    columns = [p.column(robot.machine.arm, robot.machine.tool, robot.fresh.q) for p in (place, robot.place)]
    return alike(*columns) > ALIKE


def graded(findings: tuple[EffectRecord, ...], robot: Robot, states: States) -> dict[str, Any]:
    """inputs_right: every true input is read; inputs_needless: others that are; place_right: of one finding at least;
    false: findings that read no true input, on an innocent robot all but those that follow a tracker that walks."""
    found = [f for f in findings if f.kept]
    true = robot.law.inputs if robot.law else CLOCKS if robot.machine.case.walk_mm else ()
    read = sorted({name for f in found for name in f.inputs})
    right = {name: [t for t in true if stands_for(name, t, states)] for name in read}
    out = {
        "false": sum(not any(right[name] for name in f.inputs) for f in found),
        "found": [said(f) for f in found],
    }
    if robot.law:
        out |= {
            "inputs_right": all(any(t in r for r in right.values()) for t in true),
            "inputs_needless": sum(not r for r in right.values()),
            "place_right": any(same_place(f, robot) for f in found),
        }
    return out


def said(finding: EffectRecord) -> dict[str, Any]:
    """A finding in short; nodes: of its law, as they are counted for the blind robots."""
    return {
        "name": finding.name, "place": f"{finding.slot} {finding.axis}", "law": finding.basis,
        "inputs": len(finding.inputs), "nodes": nodes(finding.basis), "named": bool(finding.catalogue),
        "found_by": finding.found_by,
    }  # fmt: skip

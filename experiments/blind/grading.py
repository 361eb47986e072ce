"""Compare a report with the true effects: names, false findings, readable formulas, standard errors.

A finding is an entry of `effects` in report.json; a true effect is an entry of `effects` in truth.json.
"""

from __future__ import annotations

import ast
from fnmatch import fnmatchcase
from itertools import permutations
from statistics import median
from typing import Any

import numpy as np

GOAL = 1.25
SIGMAS = 3.0
MATERIAL = 1.002
"""Two fits of one model from different starts differ by less."""
LONGEST_LAW = 7
MOST_INPUTS = 2
INSTRUMENT_PLACES = ("base", "*tracker*", "*instrument*", "*registration*", "*measur*")
UNITS = {
    **dict.fromkeys(("base_compliance", "compliance", "compliance_measured", "payload_deflection"), ("rad/Nm",)),
    **dict.fromkeys(("harmonic", "approach", "last_move"), ("rad", "m")),
    **dict.fromkeys(("gear_ratio", "coupling"), ("rad/rad", "m/m", "1")),
}
Finding = dict[str, Any]
Truth = dict[str, Any]


def answers(wanted: list[list[str]], inputs: list[str]) -> bool:
    """Return whether distinct inputs match every pattern of one of the sets."""
    return any(
        all(map(fnmatchcase, chosen, patterns))
        for patterns in wanted
        for chosen in permutations(sorted(set(inputs)), len(patterns))
    )


def innocent(inputs: list[str], truth: list[Truth]) -> bool:
    """Return whether an added effect reads nothing that any true effect depends on."""
    patterns = [p for effect in truth for names in effect["named"] for p in names]
    return not any(fnmatchcase(name, p) for name in inputs for p in patterns)


def recognises(finding: Finding, effect: Truth) -> bool:
    """Return whether a finding alone has the inputs of a true effect, or its name."""
    return answers(effect["named"], finding["inputs"]) or _called(finding, effect)


def false(finding: Finding, truth: list[Truth]) -> bool:
    """Return whether a finding matches no true effect, by inputs and name, or assigns an instrument error to the
    robot.
    """
    own = [e for e in truth if _called(finding, e) or not innocent(finding["inputs"], [e])]
    if not own:
        return True
    of_robot = any(e["place"] == "robot" for e in own)
    at_instrument = any(fnmatchcase(finding["slot"], p) for p in INSTRUMENT_PLACES)
    return not (of_robot or at_instrument or any(_called(finding, e) for e in own))


def _called(finding: Finding, effect: Truth) -> bool:
    return any(fnmatchcase(finding["name"].lower(), p) for p in effect["called"])


def readable(finding: Finding) -> bool:
    """Return whether a finding has a name of the catalogue, or is one formula of at most two inputs and seven nodes."""
    return bool(finding.get("catalogue")) or (
        len(finding["inputs"]) <= MOST_INPUTS and nodes(finding["basis"]) <= LONGEST_LAW
    )


def nodes(law: str) -> int:
    """Functions, operations, inputs and constants of a law; an input with its own origin and scale counts as one."""
    try:
        return sum(_nodes(ast.parse(part.strip(), mode="eval").body) for part in law.split(" and "))
    except SyntaxError:
        return len(law)


def _nodes(node: ast.expr) -> int:
    if _scaled(node):
        return 1
    if isinstance(node, ast.UnaryOp):
        return _nodes(node.operand)
    return 1 + sum(_nodes(child) for child in _children(node))


def _children(node: ast.expr) -> list[ast.expr]:
    if isinstance(node, ast.BinOp):
        return [node.left, node.right]
    return list(node.args) if isinstance(node, ast.Call) else []


def _scaled(node: ast.expr) -> bool:
    """An input, or one with a constant added or multiplied."""
    if isinstance(node, ast.UnaryOp):
        return _scaled(node.operand)
    if isinstance(node, ast.BinOp):
        if isinstance(node.op, ast.Pow):
            return False
        left, right = _constant(node.left), _constant(node.right)
        return (right and _scaled(node.left)) or (left and _scaled(node.right) and not isinstance(node.op, ast.Div))
    return isinstance(node, ast.Name)


def _constant(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) or (isinstance(node, ast.UnaryOp) and _constant(node.operand))


def deviations(findings: list[Finding], truth: dict[str, Any]) -> list[float]:
    """(value - truth) / sigma of every effect that is one number of known unit, recognised by one named finding.

    The amplitude of a sine and cosine is compared with that of the same pair only, not with a spring's or a curve's.
    """
    if truth["case"]["masses_off"]:
        return []
    out = []
    for effect in truth["effects"]:
        units = UNITS.get(effect["kind"], ())
        joint = effect["settings"].get("joint")
        slot = "base" if joint is None else f"J{joint}.*"
        own = [
            f for f in findings
            if f.get("catalogue") and f["unit"] in units and fnmatchcase(f["slot"], slot) and recognises(f, effect)
            and (effect["kind"] != "harmonic" or f["basis"].startswith(_pair(effect["settings"])))
        ]  # fmt: skip
        if len(own) == 1 and own[0].get("stderr"):
            out.append((abs(own[0]["value"]) - abs(effect["amount"])) / own[0]["stderr"])
    return out


def _pair(settings: dict[str, Any]) -> str:
    """Return the beginning of the basis of a sine and cosine of a joint, before its phase."""
    turns = settings["per_turn"]
    return f"sin({'' if turns == 1 else f'{turns:g}*'}J{settings['joint']} "


def worse(ours: np.ndarray, standard: np.ndarray) -> bool:
    """Return whether errors (N, 3) exceed the standard model's on equal poses by more than a five-hundredth and
    three standard errors.
    """
    squared, before = np.sum(ours**2, axis=1), np.sum(standard**2, axis=1)
    gap = squared - before
    beyond_chance = gap.mean() > SIGMAS * gap.std(ddof=1) / np.sqrt(len(gap))
    return bool(beyond_chance and squared.mean() > MATERIAL**2 * before.mean())


def grade(findings: list[Finding], truth: dict[str, Any]) -> dict[str, Any]:
    """The part of a row of results that a report alone decides."""
    effects = [e for e in truth["effects"] if not e["hidden"]]
    pooled = [name for finding in findings for name in finding["inputs"]]
    return {
        "found": [f"{f['name']} @ {f['slot']}" for f in findings],
        "named": all(answers(e["named"], pooled) or any(_called(f, e) for f in findings) for e in effects),
        "effects": len(effects),
        "effects_named": sum(any(recognises(f, e) for f in findings) for e in effects),
        "false": sum(false(f, truth["effects"]) for f in findings),
        "readable": sum(map(readable, findings)),
        "deviations": deviations(findings, truth),
    }


def summarise(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Counts over the judged robots; a robot has an effect where its oracle differs from the geometric fit.

    exact: against exact positions, where no noise hides a difference; the other ratios are against measured ones.
    """
    done = [row for row in rows if "named" in row]
    told = [row for row in done if row["oracle_clean_mm"] != row["geometric_clean_mm"]]
    ratios, exact = ([row[f"ratio_{kind}"] for row in done] for kind in ("noisy", "clean"))
    sigmas = [abs(z) for row in done for z in row.get("deviations", [])]
    return {
        "robots": len(rows),
        "judged": len(done),
        "failed": sum("failed" in row for row in rows),
        "within_goal": sum(ratio <= GOAL for ratio in ratios),
        "median_ratio": median(ratios) if ratios else None,
        "worst_ratio": max(ratios, default=None),
        "within_goal_exact": sum(ratio <= GOAL for ratio in exact),
        "median_ratio_exact": median(exact) if exact else None,
        "worst_ratio_exact": max(exact, default=None),
        "worse_than_standard": sum(row.get("worse", False) for row in done),
        "with_effect": len(told),
        "named": sum(row["named"] for row in told),
        "effects": sum(row.get("effects", 0) for row in done),
        "effects_named": sum(row.get("effects_named", 0) for row in done),
        "false_additions": sum(row["false"] for row in done),
        "findings": sum(len(row["found"]) for row in done),
        "readable": sum(row.get("readable", 0) for row in done),
        "parameters": len(sigmas),
        "within_2_sigma": sum(z <= 2.0 for z in sigmas),
        "slowest_s": max((row["seconds"] for row in done), default=None),
    }

"""Did the reports name the right inputs, and how many robots came within the goal?"""

from __future__ import annotations

from fnmatch import fnmatchcase
from itertools import permutations
from typing import Any

GOAL = 1.25


def answers(wanted: list[list[str]], inputs: list[str]) -> bool:
    """Whether distinct inputs match every pattern of one of the sets."""
    return any(
        all(map(fnmatchcase, chosen, patterns))
        for patterns in wanted
        for chosen in permutations(sorted(set(inputs)), len(patterns))
    )


def innocent(inputs: list[str], truth: list[dict[str, Any]]) -> bool:
    """Whether an added effect reads nothing that any true effect depends on."""
    patterns = [p for effect in truth for names in effect["named"] for p in names]
    return not any(fnmatchcase(name, p) for name in inputs for p in patterns)


def summarise(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Counts over the judged robots; a robot has an effect where its oracle differs from the geometric fit."""
    done = [row for row in rows if "named" in row]
    told = [row for row in done if row["oracle_clean_mm"] != row["geometric_clean_mm"]]
    ratios = [row["ratio_noisy"] for row in done]
    return {
        "robots": len(rows),
        "judged": len(done),
        "failed": sum("failed" in row for row in rows),
        "within_goal": sum(ratio <= GOAL for ratio in ratios),
        "worst_ratio": max(ratios, default=None),
        "with_effect": len(told),
        "named": sum(row["named"] for row in told),
        "false_additions": sum(row["false"] for row in done),
        "slowest_s": max((row["seconds"] for row in done), default=None),
    }

"""Did a report name the right inputs?"""

from __future__ import annotations

from fnmatch import fnmatchcase
from itertools import permutations
from typing import Any


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

"""Columns that belong together by their names: joints by a number, coordinates by a letter."""

import re
from collections.abc import Iterator, Sequence
from itertools import product

from gpmodel.mechanism.protocol import Mechanism

Columns = tuple[int, ...]
NOMINAL = ("nom", "target", "cmd", "command", "soll", "set", "desired", "program", "theor", "design", "cad", "ref")
ACTUAL = ("act", "meas", "ist", "real", "encoder", "feedback", "observed")
"""Words in names of commanded, and of measured values."""
_WORDS = re.compile(r"[^A-Za-z]+|(?<=[a-z])(?=[A-Z])")


def joint_families(names: Sequence[str], mechanism: Mechanism, numeric: Sequence[int]) -> Iterator[Columns]:
    """Columns of all joints in order: by the mechanism's names of them, or by names that differ in a number."""
    count = len(mechanism.joints)
    bare = {i: re.sub(r"\W|_", "", names[i]).casefold() for i in numeric}
    wanted = [re.sub(r"\W|_", "", joint.name).casefold() for joint in mechanism.joints]
    for ending in ("", "joint"):
        found = [[i for i, name in bare.items() if (word := w.removesuffix(ending)) and word in name] for w in wanted]
        exact = [[i for i in part if bare[i] == w] or part for part, w in zip(found, wanted, strict=True)]
        if all(len(part) == 1 for part in exact) and len({i for part in exact for i in part}) == count:
            yield tuple(part[0] for part in exact)
            break
    groups: dict[str, dict[int, list[int]]] = {}
    for i in numeric:
        for number in re.finditer(r"\d{1,9}", names[i]):
            stem = f"{names[i][: number.start()]}#{names[i][number.end() :]}".casefold()
            groups.setdefault(stem, {}).setdefault(int(number[0]), []).append(i)
    for group in groups.values():
        for first in sorted(group):
            if all(first + k in group for k in range(count)):
                copies = min(len(group[first + k]) for k in range(count))
                yield from (tuple(group[first + k][c] for k in range(count)) for c in range(copies))


def lettered(names: Sequence[str], numeric: Sequence[int], letters: Sequence[str] = ("xyz",)) -> Iterator[Columns]:
    """Columns whose names differ in one letter, x, y and z; of equal names the nearest behind it."""
    for i, word in product(numeric, letters):
        for place, letter in enumerate(names[i]):
            if letter.lower() != word[0]:
                continue
            others = []
            for other in word[1:]:
                same = other.upper() if letter.isupper() else other
                name = f"{names[i][:place]}{same}{names[i][place + 1 :]}"
                alike = [k for k in numeric if names[k] == name]
                others += [min(alike, key=lambda k: (k < i, abs(k - i)))] if alike else []
            if len(others) == len(word) - 1:
                yield (i, *others)


def windows(numeric: Sequence[int], count: int, strides: Sequence[int] = (1,)) -> Iterator[Columns]:
    """Columns that stand side by side, or with `strides` between them."""
    known = set(numeric)
    for stride, first in product(strides, numeric):
        found = tuple(first + stride * k for k in range(count))
        if known.issuperset(found):
            yield found


def said_to_be(names: Sequence[str], columns: Columns) -> int:
    """1 where the names say that these columns were measured, -1 where they say that they were commanded, else 0."""
    words = [word.lower() for i in columns for word in _WORDS.split(names[i]) if word]
    nominal = any(word.startswith(NOMINAL) for word in words)
    return any(word.startswith(ACTUAL) for word in words) - nominal

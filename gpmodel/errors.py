"""The exceptions a user can meet."""

import difflib
import re
from collections.abc import Iterable

LONGEST = 1000
"""Characters of a message, which may quote a whole file."""
QUOTED = 60
"""Characters of a text in quotes; a longer one is cut."""
_QUOTED = re.compile(rf"(?<!\w)'([^'/\\]{{{QUOTED}}})[^'/\\]+'(?!\w)")
"""A long one, without the quotes that end one short text and begin the next."""

LISTED, NEAREST = 6, 3
"""Names of one sentence: all are listed up to so many; of more, so many of the most alike."""


def choices(name: object, known: Iterable[object]) -> str:
    """List the expected names in place of an unknown one: all of a few, of many the nearest, case aside.

    >>> choices("j7", ["J1", "J2"])
    'J1, J2'
    >>> choices("joint_complaince", [*"abcdef", "joint_compliance", "joint_bending"])
    'joint_compliance, joint_bending, e and 5 others'
    """
    names = list(dict.fromkeys(map(str, known)))
    if len(names) <= LISTED:
        return ", ".join(names) or "none"
    folded = {other.casefold(): other for other in reversed(names)}
    alike = difflib.get_close_matches(str(name).casefold()[:LONGEST], folded, NEAREST, cutoff=0.0)
    return f"{', '.join(folded[other] for other in alike)} and {len(names) - len(alike)} others"


class GpModelError(Exception):
    """Root of every error raised on purpose; the message is one line: what, where, what was expected."""


class InputError(GpModelError, ValueError):
    """Bad input from outside: a table, a mechanism description, an argument. Line breaks in what is quoted are spaces.

    argument: the argument at fault, which the message then opens with; empty where it is the content of a file.
    said: the message without it, so that a command line can put an option's name there.
    """

    def __init__(self, message: str, argument: str = "") -> None:
        self.argument, message = argument, _QUOTED.sub(r"'\1…'", " ".join(message.splitlines()))
        self.said = message if len(message) <= LONGEST else f"{message[: LONGEST - 200]} … {message[-200:]}"
        super().__init__(f"{argument}: {self.said}" if argument else self.said)


class LayoutError(InputError):
    """A table in a layout that is not read as it stands."""

    def __init__(self, message: str) -> None:
        super().__init__(f"{message}; or try gpmodel import FILE --guess")


class OpenLoopsError(InputError):
    """Joint values, with the errors of a mechanism, at which its closed loops do not meet.

    gap: what does not meet. pose: index of the joint values. where: file and row; by default the number of the pose.
    """

    def __init__(self, gap: str, pose: int, where: str = "") -> None:
        self.gap, self.pose = gap, pose
        super().__init__(f"{where or f'pose {pose + 1}'}: {gap}")


class WriteError(InputError):
    """File that could not be written: a full disk, missing permission."""

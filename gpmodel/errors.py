"""Exceptions that a user of gpmodel can see."""

import difflib
import re
from collections.abc import Iterable

LONGEST = 1000
"""Largest number of characters of an error message; a longer message is cut in the middle."""
QUOTED = 60
"""Largest number of characters of a quoted text in an error message; a longer text is cut."""
_QUOTED = re.compile(rf"(?<!\w)'([^'/\\]{{{QUOTED}}})[^'/\\]+'(?!\w)")
"""Pattern of a quoted text longer than 60 characters. The pattern skips the text between two short quoted texts."""

LISTED, NEAREST = 6, 3
"""Largest number of names that an error message lists in full, and number of similar names listed otherwise."""


def choices(name: object, known: Iterable[object]) -> str:
    """List the accepted names for the message about an unknown name; of many names, the most similar, ignoring case.

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
    """Base class of all errors that gpmodel raises on purpose. The message is one line: what is wrong, where, what was
    expected."""


class InputError(GpModelError, ValueError):
    """Invalid input: a table, a mechanism description, an argument. Line breaks in a message become spaces.

    argument: name of the invalid argument, which begins the message; empty if a file is invalid.
    said: message without the argument, so that a command line can write the option's name instead.
    """

    def __init__(self, message: str, argument: str = "") -> None:
        self.argument, message = argument, _QUOTED.sub(r"'\1…'", " ".join(message.splitlines()))
        self.said = message if len(message) <= LONGEST else f"{message[: LONGEST - 200]} … {message[-200:]}"
        super().__init__(f"{argument}: {self.said}" if argument else self.said)


class LayoutError(InputError):
    """Table in a layout that gpmodel cannot read directly. The message recommends `gpmodel import FILE --guess`."""

    def __init__(self, message: str) -> None:
        super().__init__(f"{message}; or try gpmodel import FILE --guess")


class OpenLoopsError(InputError):
    """Error: joint values at which the closed loops of a mechanism, with its errors, do not meet.

    gap: frames that do not meet. pose: number of the pose. where: file and row; by default the number of the pose.
    """

    def __init__(self, gap: str, pose: int, where: str = "") -> None:
        self.gap, self.pose = gap, pose
        super().__init__(f"{where or f'pose {pose + 1}'}: {gap}")


class WriteError(InputError):
    """Error: a file that cannot be written, for example on a full disk or without permission."""

"""The exceptions a user can meet."""

import re

LONGEST = 1000
"""Characters of a message; what it quotes may be a whole file."""
QUOTED = 60
"""Characters of a text in quotes."""
_QUOTED = re.compile(rf"(?<!\w)'([^'/\\]{{{QUOTED}}})[^'/\\]+'(?!\w)")
"""A long one, without the quotes that end one short text and begin the next."""


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


class WriteError(InputError):
    """What could not be written: a full disk, a folder that is not ours."""

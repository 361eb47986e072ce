"""The exceptions a user can meet."""


class GpModelError(Exception):
    """Root of every error raised on purpose; the message is one line: what, where, what was expected."""


class InputError(GpModelError, ValueError):
    """Bad input from outside: a table, a mechanism description, an argument.

    argument: the argument at fault, which the message then opens with; empty where it is the content of a file.
    said: the message without it, so that a command line can put an option's name there.
    """

    def __init__(self, message: str, argument: str = "") -> None:
        super().__init__(f"{argument}: {message}" if argument else message)
        self.argument = argument
        self.said = message


class WriteError(InputError):
    """What could not be written: a full disk, a folder that is not ours."""

"""The exceptions a user can meet."""


class GpModelError(Exception):
    """Root of every error raised on purpose; the message is one line: what, where, what was expected."""


class InputError(GpModelError, ValueError):
    """Bad input from outside: a table, a mechanism description, an option."""

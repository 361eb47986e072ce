"""Read the options of the experiments."""

import argparse
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any


def parsed(text: str | None, arguments: Sequence[str] | None = None, **defaults: Any) -> argparse.Namespace:
    """Parse options by their default values, whose types they have.

    A type in the place of a value is a required option, None an optional path, False a flag, and a tuple the choices,
    of which the first is the default.
    """
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default in defaults.items():
        kind = Path if default is None or isinstance(default, Path) else type(default)
        given: dict[str, Any] = {"type": kind, "default": default, "help": f"[default: {default}]"}
        if default is False:
            given = {"action": "store_true"}
        elif isinstance(default, type):
            given = {"type": default, "required": True}
        elif isinstance(default, tuple):
            given = {"choices": default, "default": default[0]}
        parser.add_argument(f"--{name.replace('_', '-')}", **given)
    return parser.parse_args(arguments)


def command() -> str:
    """Return the command line of this process."""
    return shlex.join(["python", *sys.orig_argv[1:]])

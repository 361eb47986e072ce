"""Options of the commands of the experiments."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any


def parsed(text: str | None, arguments: Sequence[str] | None = None, **defaults: Any) -> argparse.Namespace:
    """Parse options by their default values, whose types they have; a type in the place of a value is a required
    option."""
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default in defaults.items():
        kind = default if isinstance(default, type) else Path if isinstance(default, Path) else type(default)
        given = {"required": True} if kind is default else {"default": default, "help": f"[default: {default}]"}
        parser.add_argument(f"--{name.replace('_', '-')}", type=kind, **given)
    return parser.parse_args(arguments)

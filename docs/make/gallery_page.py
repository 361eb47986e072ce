"""Make the page of the gallery from the list of robots."""

import re
import shlex

from gallery import ROBOTS

INTRODUCTION = """# Gallery

Eight simulated machines, each with one undeclared effect of known size, random geometric errors of 0.3 mm and noise of
0.03 mm. Each picture is the first screen of the report on the machine. The search used the catalogue and smooth terms
only and took seconds. From the root of the repository, `make pictures` takes the pictures again.
"""

WIDTH = 78
"""Largest number of characters of a line of a command on the page."""


def pages() -> dict[str, str]:
    """Return the page of the gallery, by its path."""
    parts = [INTRODUCTION]
    for robot in ROBOTS:
        commands = "\n".join(_in_lines(["gpmodel", *command]) for command in robot.commands)
        pictures = "\n".join(
            f"![{robot.title}](pictures/gallery-{robot.name}-{scheme}.png#only-{scheme})"
            for scheme in ("light", "dark")
        )
        parts.append(f"## {robot.title}\n\n{pictures}\n\n```sh\n{commands}\n```\n")
    return {"gallery.md": "\n".join(parts)}


def _in_lines(words: list[str]) -> str:
    """Break a command before options into lines of at most WIDTH characters."""
    lines = [""]
    for option in re.split(r" (?=--)", shlex.join(words)):
        if len(lines[-1]) + len(option) > WIDTH:
            lines.append("   ")
        lines[-1] += f"{lines[-1] and ' '}{option}"
    return " \\\n".join(lines)

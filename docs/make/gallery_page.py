"""The page of the gallery, made of the list of its robots."""

import re
import shlex

from gallery import ROBOTS

INTRODUCTION = """# Gallery

Eight machines with something that nobody declared, simulated at a known truth: 0.3 mm of wrong geometry everywhere and
0.03 mm of noise. The pictures are the first screens of their reports as they come out, found by the catalogue and
curves alone in seconds. From the root of the repository, `make pictures` takes them anew.
"""

WIDTH = 78
"""Characters of a line of a command."""


def pages() -> dict[str, str]:
    """The one page."""
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
    """A command that goes on over lines which a page can show, broken before options."""
    lines = [""]
    for option in re.split(r" (?=--)", shlex.join(words)):
        if len(lines[-1]) + len(option) > WIDTH:
            lines.append("   ")
        lines[-1] += f"{lines[-1] and ' '}{option}"
    return " \\\n".join(lines)

"""Make the reference page of all commands from their `--help`."""

import click

from gpmodel.cli.main import main

WIDTH = 80
INTRODUCTION = """# Commands

One program, `gpmodel`. This is what `gpmodel COMMAND --help` prints. Exit status: 0 done, also when nothing was found;
2 bad input, in one line; 1 a defect of ours; `gpmodel verify` ends with 3 where the model does not hold.
"""


def pages() -> dict[str, str]:
    """Return the reference page of all commands, by its path."""
    root = click.Context(main, info_name="gpmodel", max_content_width=WIDTH, terminal_width=WIDTH)
    parts = [INTRODUCTION]
    for name in main.list_commands(root):
        command = main.get_command(root, name)
        assert command is not None
        parts.append(_section(command, f"gpmodel {name}", root, 2))
    return {"reference/commands.md": "\n".join(parts)}


def _section(command: click.Command, name: str, parent: click.Context, level: int) -> str:
    context = click.Context(command, info_name=name, max_content_width=WIDTH, terminal_width=WIDTH)
    text = f"{'#' * level} {name}\n\n```text\n{command.get_help(context)}\n```\n"
    if isinstance(command, click.Group):
        inside = [(n, command.get_command(context, n)) for n in command.list_commands(context)]
        text += "\n" + "\n".join(_section(c, f"{name} {n}", context, level + 1) for n, c in inside if c is not None)
    return text

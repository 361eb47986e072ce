"""`gpmodel completion`: the shell completes commands and options."""

import click
from click.shell_completion import get_completion_class

from gpmodel.cli.terminal import echo
from gpmodel.errors import InputError


@click.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
@click.pass_context
def completion(context: click.Context, shell: str) -> None:
    """Print what makes SHELL complete gpmodel's commands and options: eval "$(gpmodel completion bash)"."""
    kind = get_completion_class(shell)
    if kind is None:
        raise InputError(f"{shell} is not known to this version of click", "shell")
    echo(kind(context.find_root().command, {}, "gpmodel", "_GPMODEL_COMPLETE").source())

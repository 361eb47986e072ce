"""`gpmodel effects`: the families of effects."""

import textwrap

import click

from gpmodel.api.effects import effects as families
from gpmodel.cli.options import mechanism_options
from gpmodel.cli.terminal import echo
from gpmodel.mechanism.source import LoadedMechanism
from gpmodel.wording import WIDTH, wrapped


@click.command()
@mechanism_options()
def effects(mechanism: LoadedMechanism) -> None:
    """List the families of effects: what each is, who described it, what it reads, and an example on MECHANISM."""
    for row in families(mechanism).to_dict("records"):
        echo(row["family"])
        for line in (f"{row['explanation']} ({row['source']})", _instances(row)):
            echo(wrapped(line))


def _instances(row: dict[object, object]) -> str:
    if not row["instances"]:
        return f"none on this mechanism: it would need {row['inputs'] or 'other joints'}"
    first, *others = textwrap.wrap(str(row["inputs"] or "nothing"), WIDTH, break_on_hyphens=False)
    reads = f"{first} ..." if others else first
    carrying = " with a payload" if row["payload"] else ""
    return f"{row['instances']} here{carrying}, reading {reads}; --effect '{row['example']}'"

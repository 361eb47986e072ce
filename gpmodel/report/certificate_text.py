"""The certificate of a calibration or a verification in 80 columns."""

from collections.abc import Iterator, Sequence

from gpmodel import wording
from gpmodel.report.certificate import Certificate, Line

NAME = 24
"""Characters of a name beside its value; below a longer one the value has a line of its own."""


def text(found: Certificate) -> str:
    """Scope, accuracy, repeatability and effects; parameters and record are on the page alone."""
    blocks = (
        (found.title, list(_lines(found.particulars)) or ["    no particulars were given"]),
        ("Scope", list(_lines(found.scope))),
        ("Accuracy, mm", list(_accuracy(found))),
        ("Repeatability", list(_lines(found.repeatability))),
        ("Effects", list(_lines([(name, f"{v} ± {s} {unit}") for name, v, s, unit in found.effects]))),
    )
    return wording.titled(blocks)


def _accuracy(found: Certificate) -> Iterator[str]:
    if not found.statistics:
        return
    yield wording.wrapped(f"over {found.poses}")
    yield "    {:>57}{:>18}".format(*(head.removesuffix(", mm") for head in found.heads))
    yield from ("    {:<47}{:>10}{:>18}".format(*row) for row in found.statistics)


def _lines(entries: Sequence[Line]) -> Iterator[str]:
    """Yield the non-empty lines, each name with its value."""
    for name, value in entries:
        if value and len(name) > NAME:
            yield f"    {name}"
        if value:
            yield wording.wrapped(value, NAME + 6, f"    {'' if len(name) > NAME else name:<{NAME + 2}}")

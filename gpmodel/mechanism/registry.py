"""Mechanisms by name, asked of every installed provider."""

import sys
from collections.abc import Sequence
from importlib.metadata import entry_points

from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import Mechanism

PROVIDERS = "gpmodel.mechanisms"


def load_mechanism(name: str, *, frame: str | None = None, payload_com: Sequence[float] | None = None) -> Mechanism:
    """The mechanism that the first provider to know `name` builds.

    A provider is an entry point of the group `gpmodel.mechanisms`: a callable
    load_mechanism(name, *, frame=None, payload_com=None) -> Mechanism | None. Where its module has a function
    `mechanism_names`, those are listed when nobody knows the name. frame: what is measured (default: the last
    link). payload_com: (3,) m, centre of mass of the payload in the measured frame.
    Raises InputError when no provider knows the name.
    """
    known: list[str] = []
    broken: list[str] = []
    for provider in sorted(entry_points(group=PROVIDERS), key=lambda e: e.name != "robots"):
        try:
            load = provider.load()
        except (ImportError, AttributeError) as error:
            broken.append(f"; provider '{provider.name}' cannot be loaded: {error}")
            continue
        mechanism = load(name, frame=frame, payload_com=payload_com)
        if mechanism is not None:
            return mechanism
        known += getattr(sys.modules[provider.module], "mechanism_names", tuple)()
    raise InputError(
        f"'{name}' is unknown; expected a .urdf file, a .toml file of DH rows, a joint or a hexapod, or one of "
        f"{', '.join(known)}{''.join(broken)}",
        "mechanism",
    )

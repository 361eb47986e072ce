"""A family of effects: what it is, who described it, and its instances on a mechanism."""

import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib.metadata import entry_points

from gpmodel.errors import InputError
from gpmodel.families.candidate import Candidate
from gpmodel.families.frequency_grid import FrequencyGrid
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.states import States

PROVIDERS = "gpmodel.families"

Builder = Callable[[Mechanism, States], Iterable[Candidate | Effect]]


@dataclass(frozen=True)
class Family:
    """A named physical effect.

    name: one word, as written on a command line. explanation: what happens physically. source: who described it.
    build: every instance that a mechanism and these columns allow; an effect alone is a candidate of one effect.
    grids: waves of it at more rates than can be named, which a selection of groups looks through.
    offered: the instances that a search is offered, where these are not those that can be named.

    generic: it says how an error looks and names no part; only a search is offered it. clamped: well beyond the
    ranges it was fitted in it keeps its value. refit_constants: constants written in its bases were
    chosen from many and belong to the last fit. yields: a part without a drive gives way to its load, so that
    its number is positive. wanders: it went there and back during the session, by no law that
    says where it is afterwards.
    """

    name: str
    explanation: str
    source: str
    build: Builder
    grids: Callable[[Mechanism, States], Iterable[FrequencyGrid]] = lambda *_: ()
    offered: Builder | None = None
    generic: bool = False
    clamped: bool = False
    refit_constants: bool = False
    yields: bool = False
    wanders: bool = False

    def __post_init__(self) -> None:
        if not callable(self.build):
            raise InputError(f"family {self.name!r}: expected a function (mechanism, states) that yields effects")


def installed() -> tuple[Family, ...]:
    """Families of every installed provider: an entry point of the group `gpmodel.families` that is a Family, or
    several of them. What cannot be loaded is left out with a warning."""
    found: list[Family] = []
    for provider in sorted(entry_points(group=PROVIDERS), key=lambda e: e.name):
        try:
            given = provider.load()
            families = (given,) if isinstance(given, Family) else tuple(given)
        except (ImportError, AttributeError, TypeError) as error:
            warnings.warn(f"families of '{provider.name}' cannot be loaded: {error}", stacklevel=2)
            continue
        found += [f for f in families if isinstance(f, Family)]
    return tuple(found)

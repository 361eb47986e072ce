"""Offer of a search: families of effects, candidates, single effects."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

from gpmodel.errors import InputError
from gpmodel.families.candidate import Candidate, one
from gpmodel.families.family import Family
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.states import States

Offer = Family | Candidate | Effect

PLAIN_COST = 4.0
"""Nats of an effect given without a cost: as much as the plainest rows of the catalogue, e^4 = 55 of which would be
as many as there are places in an arm with six joints."""


def distinct(offers: Iterable[object]) -> tuple[Offer, ...]:
    """The offers as a tuple. Raises InputError for one of another kind, or two of one name."""
    kept: dict[str, Offer] = {}
    for offer in offers:
        if not isinstance(offer, Family | Candidate | Effect):
            raise InputError(
                f"{offer!r} is of type {type(offer).__name__}; expected a Family or an Effect", "candidates"
            )
        if offer.name in kept:
            raise InputError(f"'{offer.name}' is offered twice; expected each name once", "candidates")
        kept[offer.name] = offer
    return tuple(kept.values())


def instances(offer: Offer, mechanism: Mechanism, states: States, *, search: bool = False) -> Iterator[Candidate]:
    """The candidates of one offer on a mechanism, those of a family with its explanation.

    search: those that a search is offered, where a family has others to be named.
    """
    match offer:
        case Candidate():
            yield offer
        case Effect():
            yield Candidate(offer.name, (offer,), offer.family or offer.name, PLAIN_COST)
        case Family(build=build, offered=offered):
            for instance in (offered if search and offered else build)(mechanism, states):
                yield _of_family(instance, offer)


def _of_family(instance: Candidate | Effect, family: Family) -> Candidate:
    match instance:
        case Candidate():
            found = instance
        case Effect():
            found = one(instance.name, replace(instance, family=family.name), PLAIN_COST)
        case _:
            raise InputError(
                f"family '{family.name}' yields a {type(instance).__name__}; expected candidates or effects"
            )
    if found.family != family.name:
        raise InputError(f"family '{family.name}': candidate '{found.name}' says it is of family '{found.family}'")
    return replace(found, explanation=f"{family.explanation} ({family.source})")

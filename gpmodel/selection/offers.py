"""Offered groups: each candidate of the catalogue, and a joint group of each kind that acts at several joints."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence, Set
from dataclasses import dataclass, replace
from itertools import chain

from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import Offer, instances
from gpmodel.families.frequency_grid import FrequencyGrid
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Term
from gpmodel.model.sites import Site
from gpmodel.selection.group import Group, Shapes, group_of, joined
from gpmodel.selection.programs import laws, terms

Builder = Callable[[Mechanism, Shapes], Iterator[Group | None]]

LARGEST_BLOCK = 130
"""Effects of one kind offered together as one group at all places: more are slow and say nothing."""
SMALLEST_BLOCK = 3
"""Places below which they are offered singly."""
BLOCK_COST = 1.0
"""Nats of a kind at all places: there are few kinds to choose from."""


def of_offers(offers: Iterable[Offer]) -> Builder:
    """Every instance of what is offered."""

    def build(mechanism: Mechanism, shapes: Shapes) -> Iterator[Group | None]:
        for offer in offers:
            yield from (group_of(c, shapes) for c in instances(offer, mechanism, shapes.states, search=True))

    return build


def of_evolved(candidates: Sequence[Candidate], cost: Callable[[int], float]) -> Builder:
    """Build groups from evolved candidates; terms without a shared input become separate formulas, with their terms
    as parts.

    cost: nats of a number of nodes.
    """

    def build(mechanism: Mechanism, shapes: Shapes) -> Iterator[Group | None]:
        for law in chain.from_iterable(laws(candidate, cost) for candidate in candidates):
            whole = group_of(law, shapes)
            parts = tuple(group_of(term, shapes) for term in terms(law, cost))
            yield whole and replace(whole, parts=tuple(p for p in parts if p is not None))

    return build


@dataclass(frozen=True)
class Offering:
    """Offer of a selection.

    single: builders of groups that are offered from the start.
    sites, inputs: of the smooth terms of one or two inputs that are proposed.
    grids: of sinusoids at more frequencies than can be named.
    wanted: returns whether a group may be offered.
    """

    single: Sequence[Builder]
    sites: Sequence[Site] = ()
    inputs: Sequence[str] = ()
    grids: Sequence[FrequencyGrid] = ()
    wanted: Callable[[Group], bool] = lambda _: True


def singles(offering: Offering, mechanism: Mechanism, shapes: Shapes) -> list[Group]:
    """The single groups that vary over these poses, the first of each set of columns.

    Terms that were evolved together are offered one by one where one of them has a name by itself.
    """
    built = chain.from_iterable(builder(mechanism, shapes) for builder in offering.single)
    found = without_copies(group for group in built if group is not None and offering.wanted(group))
    named = {g.effects[0].terms for g in found if g.family and len(g.effects) == 1}
    return without_copies(g for whole in found for g in _apart(whole, named))


def without_copies(groups: Iterable[Group]) -> list[Group]:
    """The first of each set of columns."""
    found: dict[object, Group] = {}
    for group in groups:
        found.setdefault((tuple(e.terms for e in group.effects), group.spreads, group.cap), group)
    return list(found.values())


def _apart(group: Group, named: Set[tuple[Term, ...]]) -> tuple[Group, ...]:
    """A group, or its terms but for those that are offered by name, where there are any. named: terms of those."""
    left = tuple(part for part in group.parts if part.effects[0].terms not in named)
    return left if len(left) < len(group.parts) else (replace(group, parts=()),)


def shared_kinds(mechanism: Mechanism, groups: Iterable[Group]) -> list[Group]:
    """Groups that are the same but for the joint, as one group under one variance: many weak ones of one kind."""
    kinds: dict[str, list[Group]] = defaultdict(list)
    for group in groups:
        for j in mechanism.joints:
            if group.name.endswith(f", {j.name}"):
                kinds[group.name.removesuffix(f", {j.name}")].append(group)
    return [
        joined(f"{kind}, several joints", parts, parts[0].cost + BLOCK_COST)
        for kind, parts in kinds.items()
        if len(parts) >= SMALLEST_BLOCK and sum(len(p.effects) for p in parts) <= LARGEST_BLOCK
    ]

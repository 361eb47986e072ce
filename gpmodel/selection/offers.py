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
"""Largest number of effects of one kind in a joint group at all sites: a larger group is slow and never selected."""
SMALLEST_BLOCK = 3
"""Least number of sites of a joint group."""
BLOCK_COST = 1.0
"""Price of a joint group in addition to that of one part, nats: there are few kinds."""


def of_offers(offers: Iterable[Offer]) -> Builder:
    """Return a builder of groups from families, candidates and effects."""

    def build(mechanism: Mechanism, shapes: Shapes) -> Iterator[Group | None]:
        for offer in offers:
            yield from (group_of(c, shapes) for c in instances(offer, mechanism, shapes.states, search=True))

    return build


def of_evolved(candidates: Sequence[Candidate], cost: Callable[[int], float]) -> Builder:
    """Return a builder of groups from evolved candidates, one for each set of inputs that terms share.

    Its parts are the single terms. cost: function from a number of nodes to nats.
    """

    def build(mechanism: Mechanism, shapes: Shapes) -> Iterator[Group | None]:
        for law in chain.from_iterable(laws(candidate, cost) for candidate in candidates):
            whole = group_of(law, shapes)
            parts = tuple(group_of(term, shapes) for term in terms(law, cost))
            yield whole and replace(whole, parts=tuple(p for p in parts if p is not None))

    return build


@dataclass(frozen=True)
class Offering:
    """Groups that a selection may use.

    single: builders of groups that are offered from the start.
    sites, inputs: of proposed smooth terms of one or two inputs.
    grids: of sinusoids at any frequency of a range.
    wanted: function that returns whether a group may be offered.
    """

    single: Sequence[Builder]
    sites: Sequence[Site] = ()
    inputs: Sequence[str] = ()
    grids: Sequence[FrequencyGrid] = ()
    wanted: Callable[[Group], bool] = lambda _: True


def singles(offering: Offering, mechanism: Mechanism, shapes: Shapes) -> list[Group]:
    """Return the single groups that vary over these poses, without groups of equal columns.

    Terms that evolved together are offered separately if one of them is also offered by name.
    """
    built = chain.from_iterable(builder(mechanism, shapes) for builder in offering.single)
    found = without_copies(group for group in built if group is not None and offering.wanted(group))
    named = {g.effects[0].terms for g in found if g.family and len(g.effects) == 1}
    return without_copies(g for whole in found for g in _apart(whole, named))


def without_copies(groups: Iterable[Group]) -> list[Group]:
    """Return the first of all groups with equal columns."""
    found: dict[object, Group] = {}
    for group in groups:
        found.setdefault((tuple(e.terms for e in group.effects), group.spreads, group.cap), group)
    return list(found.values())


def _apart(group: Group, named: Set[tuple[Term, ...]]) -> tuple[Group, ...]:
    """Return a group, or its terms that are not offered by name if some are. named: terms of the named groups."""
    left = tuple(part for part in group.parts if part.effects[0].terms not in named)
    return left if len(left) < len(group.parts) else (replace(group, parts=()),)


def shared_kinds(mechanism: Mechanism, groups: Iterable[Group]) -> list[Group]:
    """Return joint groups of groups that differ only in the joint, to detect many weak effects of one kind."""
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

"""Form the candidate groups of effects: each effect of the catalogue, and a joint group of one kind at many joints."""

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
"""Largest number of effects of a joint group (one kind at many joints): larger ones are slow and never selected."""
SMALLEST_BLOCK = 3
"""Least number of sites (frame and axis) at which the effects of a joint group act."""
BLOCK_COST = 1.0
"""Penalty of a joint group beyond that of one of its parts, nats; small, because there are few kinds of effects."""


def of_offers(offers: Iterable[Offer]) -> Builder:
    """Return a function that builds groups of effects for a mechanism from families, candidates and effects."""

    def build(mechanism: Mechanism, shapes: Shapes) -> Iterator[Group | None]:
        for offer in offers:
            yield from (group_of(c, shapes) for c in instances(offer, mechanism, shapes.states, search=True))

    return build


def of_evolved(candidates: Sequence[Candidate], cost: Callable[[int], float]) -> Builder:
    """Return a function that builds groups from evolved candidates, one group for each set of inputs that terms share.

    The parts of a group are its single terms. cost: function from a formula's number of nodes to its penalty, nats.
    """

    def build(mechanism: Mechanism, shapes: Shapes) -> Iterator[Group | None]:
        for law in chain.from_iterable(laws(candidate, cost) for candidate in candidates):
            whole = group_of(law, shapes)
            parts = tuple(group_of(term, shapes) for term in terms(law, cost))
            yield whole and replace(whole, parts=tuple(p for p in parts if p is not None))

    return build


@dataclass(frozen=True)
class Offering:
    """Candidate groups of effects that a selection may use.

    single: functions that build the groups that are candidates from the beginning.
    sites, inputs: sites (frame and axis) and input variables of the smooth terms that may be proposed.
    grids: frequency grids of the sinusoids that may be proposed.
    wanted: function that decides if a group may be a candidate.
    """

    single: Sequence[Builder]
    sites: Sequence[Site] = ()
    inputs: Sequence[str] = ()
    grids: Sequence[FrequencyGrid] = ()
    wanted: Callable[[Group], bool] = lambda _: True


def singles(offering: Offering, mechanism: Mechanism, shapes: Shapes) -> list[Group]:
    """Return the candidate groups that vary over the measured poses; of groups with equal columns only the first.

    The terms of an evolved program become separate candidates if one of the terms is also a candidate with a name.
    """
    built = chain.from_iterable(builder(mechanism, shapes) for builder in offering.single)
    found = without_copies(group for group in built if group is not None and offering.wanted(group))
    named = {g.effects[0].terms for g in found if g.family and len(g.effects) == 1}
    return without_copies(g for whole in found for g in _apart(whole, named))


def without_copies(groups: Iterable[Group]) -> list[Group]:
    """Omit copies of groups: of groups with equal effects, spreads and largest variances only the first is kept."""
    found: dict[object, Group] = {}
    for group in groups:
        found.setdefault((tuple(e.terms for e in group.effects), group.spreads, group.cap), group)
    return list(found.values())


def _apart(group: Group, named: Set[tuple[Term, ...]]) -> tuple[Group, ...]:
    """Remove from a group the terms that groups with a named cause contain. named: such terms, by effect."""
    left = tuple(part for part in group.parts if part.effects[0].terms not in named)
    return left if len(left) < len(group.parts) else (replace(group, parts=()),)


def shared_kinds(mechanism: Mechanism, groups: Iterable[Group]) -> list[Group]:
    """Join groups that differ only in the joint to joint groups, which detect many weak effects of one kind."""
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

"""Define a group of columns that come in together under one variance, and the price of its structure, nats."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gpmodel.arrays import Array
from gpmodel.calibration.priors import GEOMETRY_REACH
from gpmodel.evidence.criteria import Criteria
from gpmodel.families.candidate import SMOOTH_TERM, Candidate
from gpmodel.families.catalogue import family
from gpmodel.formula.expression import Basis, Expression
from gpmodel.model.effect import Effect
from gpmodel.model.states import States

CAP = 5e-3
"""Radians or metres, as √a: no undeclared effect of a machine in service moves its place further."""
DECLARED_CAP = 0.3
"""Largest √a of an effect that is known to be there, in its own unit."""
FEW = 2
"""Unknowns up to which a group is read as one effect: a number, or a sine and cosine. More of them make a curve."""
FLAT = 1e-6
"""Relative variance of a basis below which it is a constant, which the geometry holds."""


class Shapes:
    """Values (N,) of bases at fixed poses, each computed once."""

    def __init__(self, states: States) -> None:
        self.states = states
        self._values: dict[str, Array] = {}
        self._moments: dict[str, tuple[float, float]] = {}

    def __call__(self, basis: Basis) -> Array:
        text = str(basis)
        if text not in self._values:
            with np.errstate(all="ignore"):
                self._values[text] = np.ascontiguousarray(basis(self.states), dtype=float)
        return self._values[text]

    def moments(self, basis: Basis) -> tuple[float, float]:
        """Variance and mean square over the poses."""
        text = str(basis)
        if text not in self._moments:
            values = self(basis)
            with np.errstate(all="ignore"):
                self._moments[text] = float(np.var(values)), float(np.mean(values**2))
        return self._moments[text]


@dataclass(frozen=True)
class Group(Candidate):
    """A candidate with unknowns u_k ~ N(0, a spread_k²), one variance a for all of them.

    spreads: (E,) standard deviations of the unknowns for a = 1, scaled so that Σ spread_k² var(φ_k) = 1: √a is how
    far the whole group moves its place over the poses, rad or m. where: slot and axis. cap: largest √a; where the
    priors are believed, what somebody stated. always_included: in the model whatever it is worth. parts: the groups of
    one kind at several places that it is made of, empty for a plain group. inner: None also where not all of its
    effects are left.
    """

    spreads: tuple[float, ...] = ()
    where: str = "all"
    cap: float = CAP
    always_included: bool = False
    parts: tuple["Group", ...] = ()

    def with_prior(self, variance: float) -> tuple[Effect, ...]:
        """Its effects with the standard deviations √a spread_k as their priors."""
        root = math.sqrt(variance)
        return tuple(replace(e, prior=root * s) for e, s in zip(self.effects, self.spreads, strict=True))


def is_curve(candidate: Candidate) -> bool:
    """Return whether a candidate describes an error without naming a part: a smooth term, or one of a generic
    family.
    """
    known = family(candidate.family)
    return candidate.found_by == SMOOTH_TERM or (known is not None and known.generic)


def spread_of(effect: Effect, shapes: Shapes) -> float:
    """Standard deviation over the poses of what a unit of it does to its slots; 0 where flat, NaN past numbers."""
    total, size = 0.0, 0.0
    for term in effect.terms:
        variance, square = shapes.moments(term.basis)
        total += term.weight**2 * variance
        size += term.weight**2 * square
    return math.sqrt(total) if total > FLAT**2 * size else 0.0 if np.isfinite(total) else math.nan


def group_of(candidate: Candidate, shapes: Shapes) -> Group | None:
    """A candidate as a group; finite priors say how large its effects are to each other, the others get equal shares.

    Those that do not vary over the poses are left out; None where nothing is left.
    """
    sizes = [spread_of(e, shapes) for e in candidate.effects]
    alive = [(e, s) for e, s in zip(candidate.effects, sizes, strict=True) if np.isfinite(s) and s > 0]
    if not alive:
        return None
    relative = np.array([e.prior if np.isfinite(e.prior) else 1.0 / s for e, s in alive])
    total = math.sqrt(sum((r * s) ** 2 for r, (_, s) in zip(relative, alive, strict=True)))
    effects, spreads = tuple(e for e, _ in alive), tuple(float(r / total) for r in relative)
    cap = min(CAP, effects[0].prior / spreads[0]) if candidate.believed else CAP
    whole = {**vars(candidate), "effects": effects, "family": candidate.family or effects[0].family}
    whole["inner"] = candidate.inner if len(effects) == len(candidate.effects) else None
    return Group(**whole, spreads=spreads, where=f"{effects[0].terms[0].slot} {effects[0].terms[0].axis}", cap=cap)


def geometry_groups(effects: Iterable[Effect]) -> tuple[Group, ...]:
    """Group constant errors as lengths, angles, and those with priors, which keep their ratios; other effects one each.

    All are always in. Together they stay within what is believed of a description: along a direction that the poses
    hardly show, a wrist 29 cm away would say in the linear problem what the curves of two joints do.
    """
    kinds: dict[str, list[Effect]] = {"geometry, lengths": [], "geometry, angles": [], "geometry, with priors": []}
    for e in effects:
        kind = "with priors" if np.isfinite(e.prior) else "lengths" if e.unit == "m" else "angles"
        kinds.setdefault(f"geometry, {kind}" if e.constant else e.name, []).append(e)
    out = []
    for name, (first, *others) in ((name, chosen) for name, chosen in kinds.items() if chosen):
        sizes = np.array([e.prior if np.isfinite(e.prior) else 1.0 for e in (first, *others)])
        spreads = tuple((sizes / np.linalg.norm(sizes)).tolist())
        reach = GEOMETRY_REACH if first.constant and first.prior == np.inf else DECLARED_CAP
        family, cap = "geometric" if first.constant else first.family, min(reach, first.prior / spreads[0])
        out.append(Group(name, (first, *others), family, 0.0, spreads=spreads, cap=cap, always_included=True))
    return tuple(out)


def joined(name: str, parts: Sequence[Group], cost: float) -> Group:
    """Groups of one kind at several places under one variance."""
    share = 1.0 / math.sqrt(len(parts))
    effects = tuple(e for p in parts for e in p.effects)
    spreads = tuple(share * s for p in parts for s in p.spreads)
    return Group(name, effects, parts[0].family, cost, spreads=spreads, parts=tuple(parts))


READABLE = 12
"""Operations, inputs and constants that are read in a formula at most; a longer one is no plainer than a curve."""


@dataclass(frozen=True)
class Price:
    """Prices of groups.

    limits: minimum_nats for any group, head_start for one without a name, naming_margin for reading a curve.
    of_input: nats by input, from the references of evolved programs; an input that is missing is free. with_formulas:
    names of curves of which formulas are offered.
    """

    limits: Criteria = field(default_factory=Criteria)
    of_input: Mapping[str, float] = field(default_factory=dict)
    with_formulas: frozenset[str] = frozenset()

    def to_describe(self, group: Group) -> float:
        """Log of how many alternatives there are, and the price of having no name."""
        return group.cost + self.limits.head_start * (not group.family)

    def to_enter(self, group: Group) -> float:
        """Return the gain a group needs to enter the model: minimum gain, description and inputs."""
        read = [self.of_input.get(name, 0.0) for name in group.inputs]
        return self.limits.minimum_nats + self.to_describe(group) + (float(np.mean(read)) if read else 0.0)

    def to_read(self, group: Group) -> float:
        """Return the price of reading a smooth term once formulas of it are offered, or of a long formula."""
        names = {group.name, *(part.name for part in group.parts)}
        curve = is_curve(group) and len(group.effects) > FEW and not names.isdisjoint(self.with_formulas)
        basis = group.place.basis
        long = not group.family and isinstance(basis, Expression) and basis.length > READABLE
        return self.limits.naming_margin * (curve or (long and len(group.effects) <= FEW))

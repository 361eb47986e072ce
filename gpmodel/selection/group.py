"""Groups of effects that enter a model together under one prior variance, and the penalty of a group, nats."""

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
"""Largest prior standard deviation of a motion, rad or m: an undeclared effect of a working machine is smaller."""
DECLARED_CAP = 0.3
"""Largest prior standard deviation √a of an effect that is known to exist, in the unit of the effect."""
FEW = 2
"""Largest number of coefficients of a simple group: one effect, or a sine and cosine. A smooth term has more."""
FLAT = 1e-6
"""Relative variance below which a basis function counts as constant and thus as part of the geometry."""


class Shapes:
    """Values of basis functions at fixed poses, one value a pose; each function is computed once."""

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
        """Return variance and mean square of a basis function over the poses."""
        text = str(basis)
        if text not in self._moments:
            values = self(basis)
            with np.errstate(all="ignore"):
                self._moments[text] = float(np.var(values)), float(np.mean(values**2))
        return self._moments[text]


@dataclass(frozen=True)
class Group(Candidate):
    """Effects that enter a model together: their coefficients u_k ~ N(0, a spread_k²) share one prior variance a.

    spreads: prior standard deviations of the coefficients u_k for a = 1, scaled so that Σ spread_k² var(φ_k) = 1 with
    the basis function φ_k of effect k. √a is then the RMS motion of the group's site, rad or m. where: frame (slot) and
    axis of the site. cap: largest √a; for specified priors the specified value. always_included: never deleted.
    parts: groups of one kind at several sites that form the group, empty for a plain group. inner: nonlinear constants
    in basis functions; None if there are none or an effect is deleted.
    """

    spreads: tuple[float, ...] = ()
    where: str = "all"
    cap: float = CAP
    always_included: bool = False
    parts: tuple["Group", ...] = ()

    def with_prior(self, variance: float) -> tuple[Effect, ...]:
        """Return the group's effects with their prior standard deviations for the prior variance `variance`."""
        root = math.sqrt(variance)
        return tuple(replace(e, prior=root * s) for e, s in zip(self.effects, self.spreads, strict=True))


def is_curve(candidate: Candidate) -> bool:
    """Return whether a candidate describes an error without its cause: a smooth term or one of a generic family."""
    known = family(candidate.family)
    return candidate.found_by == SMOOTH_TERM or (known is not None and known.generic)


def spread_of(effect: Effect, shapes: Shapes) -> float:
    """Return the standard deviation of a basis function over the poses; 0 if constant, NaN if infinite."""
    total, size = 0.0, 0.0
    for term in effect.terms:
        variance, square = shapes.moments(term.basis)
        total += term.weight**2 * variance
        size += term.weight**2 * square
    return math.sqrt(total) if total > FLAT**2 * size else 0.0 if np.isfinite(total) else math.nan


def group_of(candidate: Candidate, shapes: Shapes) -> Group | None:
    """Return a candidate as a group of effects that share one prior variance; None if no effect varies over the poses.

    Finite priors set the ratios of the coefficients, else all cause equal RMS motions. Constant effects are omitted.
    """
    sizes = [spread_of(e, shapes) for e in candidate.effects]
    alive = [(e, s) for e, s in zip(candidate.effects, sizes, strict=True) if np.isfinite(s) and s > 0]
    if not alive:
        return None
    relative = np.array([e.prior if np.isfinite(e.prior) else 1.0 / s for e, s in alive])
    total = math.sqrt(sum((r * s) ** 2 for r, (_, s) in zip(relative, alive, strict=True)))
    effects, spreads = tuple(e for e, _ in alive), tuple(float(r / total) for r in relative)
    cap = min(CAP, effects[0].prior / spreads[0]) if candidate.specified else CAP
    whole = {**vars(candidate), "effects": effects, "family": candidate.family or effects[0].family}
    whole["inner"] = candidate.inner if len(effects) == len(candidate.effects) else None
    return Group(**whole, spreads=spreads, where=f"{effects[0].terms[0].slot} {effects[0].terms[0].axis}", cap=cap)


def geometry_groups(effects: Iterable[Effect]) -> tuple[Group, ...]:
    """Group the effects of constant geometric errors: all lengths, all angles, all effects with priors; others singly.

    These groups of geometric errors are always in the model, with prior variances limited to the errors of a machine
    description. Without a limit, a wrist 29 cm off in a hardly determined direction fits like two smooth terms.
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
    """Join groups of one kind of effect at several sites to one group with one prior variance. cost: penalty, nats."""
    share = 1.0 / math.sqrt(len(parts))
    effects = tuple(e for p in parts for e in p.effects)
    spreads = tuple(share * s for p in parts for s in p.spreads)
    return Group(name, effects, parts[0].family, cost, spreads=spreads, parts=tuple(parts))


READABLE = 12
"""Largest number of operations, inputs and constants of a formula that is clearer than a smooth term."""


@dataclass(frozen=True)
class Price:
    """Prices (penalties) of groups of effects, nats: the gain in log evidence that a group needs to enter the model.

    limits: limits in nats; minimum_nats for any group, head_start for a group without a named cause, naming_margin for
    a smooth term or a long formula. of_input: penalty of each input variable, nats, from the inputs of evolved
    programs; 0 for other inputs. with_formulas: names of smooth terms for which formulas are offered.
    """

    limits: Criteria = field(default_factory=Criteria)
    of_input: Mapping[str, float] = field(default_factory=dict)
    with_formulas: frozenset[str] = frozenset()

    def to_describe(self, group: Group) -> float:
        """Return a group's description penalty, nats: log of the number of alternatives, more without a named cause."""
        return group.cost + self.limits.head_start * (not group.family)

    def to_enter(self, group: Group) -> float:
        """Return the log evidence gain, nats, that a group needs: minimum plus penalties of description and inputs."""
        read = [self.of_input.get(name, 0.0) for name in group.inputs]
        return self.limits.minimum_nats + self.to_describe(group) + (float(np.mean(read)) if read else 0.0)

    def to_read(self, group: Group) -> float:
        """Return the extra penalty, nats, of a group that is hard to read (long formula, smooth term with formulas)."""
        names = {group.name, *(part.name for part in group.parts)}
        curve = is_curve(group) and len(group.effects) > FEW and not names.isdisjoint(self.with_formulas)
        basis = group.place.basis
        long = not group.family and isinstance(basis, Expression) and basis.length > READABLE
        return self.limits.naming_margin * (curve or (long and len(group.effects) <= FEW))

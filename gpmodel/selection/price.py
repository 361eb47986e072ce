"""The price of a group: minus the log prior of the structure that it adds to the model, nats."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from gpmodel.evidence.criteria import Criteria
from gpmodel.formula.expression import Expression
from gpmodel.selection.group import FEW, Group, is_curve

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
        """What a group must gain to enter the model: the least gain of any group, its description, its inputs."""
        read = [self.of_input.get(name, 0.0) for name in group.inputs]
        return self.limits.minimum_nats + self.to_describe(group) + (float(np.mean(read)) if read else 0.0)

    def to_read(self, group: Group) -> float:
        """What a reader loses by a curve that names no part, once formulas of it are offered, or by a long formula."""
        names = {group.name, *(part.name for part in group.parts)}
        curve = is_curve(group) and len(group.effects) > FEW and not names.isdisjoint(self.with_formulas)
        basis = group.place.basis
        long = not group.family and isinstance(basis, Expression) and basis.length > READABLE
        return self.limits.naming_margin * (curve or (long and len(group.effects) <= FEW))

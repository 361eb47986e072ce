"""Places where a twist may act: the base, every joint's drive and other axes, the tool."""

from dataclasses import dataclass

from gpmodel.formula.expression import Basis
from gpmodel.mechanism.protocol import AXES, Mechanism, closed
from gpmodel.model.effect import Effect, Term


@dataclass(frozen=True)
class Site:
    """A place where a twist may act: one axis of one slot, or the drive of a joint (several under one unknown)."""

    terms: tuple[tuple[str, str, float], ...]

    @property
    def slot(self) -> str:
        """Where it acts first."""
        return self.terms[0][0]

    @property
    def axis(self) -> str:
        """The axis it acts along first."""
        return self.terms[0][1]

    @property
    def name(self) -> str:
        """Slot and axis."""
        return f"{self.slot} {self.axis}"

    def effect(self, name: str, basis: Basis, unit: str, family: str = "") -> Effect:
        """An effect here, of one unknown in `unit`."""
        return Effect(name, tuple(Term(slot, axis, basis, weight) for slot, axis, weight in self.terms), unit, family)


def sites_of(mechanism: Mechanism) -> tuple[Site, ...]:
    """The base, every joint (its own drive first, then the other axes of its moving side), the tool.

    Where loops close, the places of its constants stand for the joints.
    """
    out = [Site((("base", axis, 1.0),)) for axis in AXES]
    if loops := closed(mechanism):
        out += [Site(((slot, axis, 1.0),)) for slot, axis in loops.constants]
        return (*out, *(Site((("tool", axis, 1.0),)) for axis in AXES[:3]))
    for joint in mechanism.joints:
        out.append(Site(joint.drive))
        slot = f"{joint.name}.moving"
        out += [Site(((slot, axis, 1.0),)) for axis in AXES if axis != joint.drive[0][1]]
    out += [Site((("tool", axis, 1.0),)) for axis in AXES[:3]]
    return tuple(out)

"""Places where a twist may act: the base, every joint's drive and other axes, the tool; and the constants there."""

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.formula.expression import Basis
from gpmodel.mechanism.branches import branched, stands
from gpmodel.mechanism.protocol import AXES, Mechanism, closed
from gpmodel.model.effect import Effect, Term, effect_at

SAME = 1e-9
"""m and rad that a unit twist has along another axis by rounding alone."""


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
    """The base, every joint (its own drive first, then the other axes of its moving side, then those of its fixed side
    that are no axis of the frame before it), the tool.

    Where loops close, the places of its constants stand for the joints.
    """
    out = [Site((("base", axis, 1.0),)) for axis in AXES]
    if loops := closed(mechanism):
        out += [Site(((slot, axis, 1.0),)) for slot, axis in loops.constants]
        return (*out, *(Site((("tool", axis, 1.0),)) for axis in AXES[:3]))
    steps = dict(zip(mechanism.slots, mechanism.transforms(np.zeros((1, len(mechanism.joints))))[:, 0], strict=True))
    for joint in mechanism.joints:
        drive = joint.drive[0][1]
        out.append(Site(joint.drive))
        out += [Site(((f"{joint.name}.moving", axis, 1.0),)) for axis in AXES if axis != drive]
        fixed = f"{joint.name}.fixed"
        out += [Site(((fixed, axis, 1.0),)) for axis in AXES if axis[1] != drive[1] and _is_new(steps[fixed], axis)]
    out += [Site((("tool", axis, 1.0),)) for axis in AXES[:3]]
    return tuple(out)


def _is_new(step: Array, axis: str) -> bool:
    """Return whether a twist along an axis of a frame is along no axis of the previous frame. step: (4, 4) from the
    previous.
    """
    along = step[:3, "xyz".index(axis[1])]
    turned = np.cross(step[:3, 3], along) if axis[0] == "R" else np.zeros(3)
    return int(np.sum(np.abs([*along, *turned]) > SAME)) > 1


def geometric_effects(mechanism: Mechanism) -> tuple[Effect, ...]:
    """The redundant complete set: six constant twists on the moving side of every joint, or what closed loops have; of
    several arms also where each but the first stands."""
    loops, tree = closed(mechanism), branched(mechanism)
    stand = [mechanism.slots[i] for i in stands(tree)] if tree else []
    slots = [*stand, *(f"{joint.name}.moving" for joint in mechanism.joints)]
    return tuple(
        effect_at(f"{slot.removesuffix('.moving')} {axis}", slot, axis, family="geometric")
        for slot, axis in (loops.constants if loops else ((slot, axis) for slot in slots for axis in AXES))
    )


def standard_effects(mechanism: Mechanism, patterns: Sequence[str] = ("*",)) -> tuple[Effect, ...]:
    """The geometric effects whose name (`J3 Ty`) fits any of the patterns; `none` alone for none of them.

    patterns: shell patterns over NAME AXIS, with J1..Jn for the joints' own names. Raises InputError for a
    pattern that fits nothing.
    """
    everything = geometric_effects(mechanism)
    if tuple(patterns) == ("none",):
        return ()
    chosen: set[str] = set()
    for pattern in patterns:
        fits = [e.name for e in everything if any(fnmatchcase(n, pattern) for n in _aliases(e.name, mechanism))]
        if not fits:
            raise InputError(
                f"'{pattern}' fits no parameter; available: {everything[0].name} to {everything[-1].name}", "standard"
            )
        chosen.update(fits)
    return tuple(e for e in everything if e.name in chosen)


def _aliases(name: str, mechanism: Mechanism) -> tuple[str, ...]:
    """The name itself, and with J1..Jn for the joint that it is at; a link of closed loops may be at none."""
    place, axis = name.rsplit(" ", 1)
    names = [joint.name for joint in mechanism.joints]
    at = (i for i, n in enumerate(names) if place == n or place.startswith(f"{n}."))
    return name, *(f"J{i + 1}{place.removeprefix(names[i])} {axis}" for i in at)

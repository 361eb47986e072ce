"""Which geometric parameters the standard model holds."""

from collections.abc import Sequence
from fnmatch import fnmatchcase

from gpmodel.errors import InputError
from gpmodel.mechanism.branches import branched, stands
from gpmodel.mechanism.protocol import AXES, Mechanism, closed
from gpmodel.model.effect import Effect, effect_at


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

"""Causes of a change that the catalogue lacks: breaks in the curve of a joint, and scales of measured coordinates."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import PLAIN_COST
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import AXES, INSTRUMENT, Joint, Mechanism
from gpmodel.model.effect import Effect, Term, drive_effect, effect_at
from gpmodel.model.states import PREFIX, States

BREAK = "break"
"""Family of steps and kinks in the curve of a joint."""
EITHER_SIDE = 3
"""Least number of positions of a joint before and after a break: three points determine a displacement."""
MOST_BREAKS = 40
"""Largest number of places at which the curve of one joint may break. With more positions than places, a break lies at
most a fortieth of the positions from a place."""


def uncatalogued(mechanism: Mechanism, states: States) -> Iterator[Candidate]:
    """Yield the causes of a change that the catalogue lacks."""
    for joint in mechanism.joints:
        yield from _breaks(joint, states)
    if states.seen is not None:
        terms = tuple(Term(INSTRUMENT, f"T{axis}", Expression(f"{PREFIX}{axis}")) for axis in "xyz")
        for what, own in (*((f"measured {term.axis[1]}", (term,)) for term in terms), ("measured coordinates", terms)):
            name = f"scale of the {what}"
            yield Candidate(name, (Effect(name, own, "1"),), "", PLAIN_COST)


def _breaks(joint: Joint, states: States) -> Iterator[Candidate]:
    """Yield the breaks of one joint between neighbouring positions of the poses, with equal probabilities."""
    unit, factor, digits = ("mm", 1e3, 1) if joint.kind == "prismatic" else ("deg", 180.0 / np.pi, 2)
    positions = np.unique(np.round(factor * states[joint.name], digits))
    gaps = list(pairwise(positions.tolist()))[EITHER_SIDE - 1 : 1 - EITHER_SIDE]
    for low, high in gaps[:: -(-len(gaps) // MOST_BREAKS) or 1]:
        where = f"between {low:.6g} and {high:.6g} {unit}"
        made = list(_break(joint, where, f"{0.5 * (low + high) / factor:.9g}"))
        for name, effects in made:
            yield Candidate(name, effects, BREAK, PLAIN_COST + float(np.log(len(gaps) * len(made))))


def _break(joint: Joint, where: str, place: str) -> Iterator[tuple[str, tuple[Effect, ...]]]:
    """Yield steps and kinks of one joint at a place: a displacement of the drive at all positions on one side.

    The place of a kink is known only to the distance of the positions, so that a kink includes a step. The guideway of
    a prismatic joint may step along each axis alone and along all axes, as where two parts of a rail meet.
    """
    above = f"{joint.name} - ({place})"
    for side, way in (("above", above), ("below", f"({place}) - {joint.name}")):
        name = f"of {joint.name} {where}, {side} it"
        step = drive_effect(f"step {name}", joint, Expression(f"step({way})"))
        kink = drive_effect(f"kink {name}", joint, Expression(f"({way})*step({way})"), "1")
        yield kink.name, (kink, step)
        if joint.kind == "revolute":
            yield step.name, (step,)
    if joint.kind == "prismatic":
        name, basis = f"step of the guideway {where}, {joint.name}", Expression(f"step({above})")
        axes = tuple(effect_at(f"{name}, {axis}", joint.drive[0][0], axis, basis) for axis in AXES)
        yield name, axes
        yield from ((effect.name, (effect,)) for effect in axes)

"""Effects: one unknown number each, a small twist at one or more slots, shaped by a basis."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.formula.expression import ONE, Basis
from gpmodel.mechanism.protocol import AXES, INSTRUMENT, Joint
from gpmodel.model.states import States

REGISTRATION, TOOL = "setup", "tool"
"""The labels of a table by which registrations and tools are told."""


def made_of(parts: object, kind: type) -> bool:
    """Return whether `parts` is a tuple of one kind only."""
    return isinstance(parts, tuple) and all(isinstance(part, kind) for part in parts)


@dataclass(frozen=True)
class Term:
    """`weight · basis` along one axis of the frame of one slot."""

    slot: str
    axis: str
    basis: Basis = ONE
    weight: float = 1.0

    def __post_init__(self) -> None:
        if self.axis not in AXES:
            raise InputError(f"axis '{self.axis}' is unknown; available: {', '.join(AXES)}")
        if not callable(self.basis) or not made_of(getattr(self.basis, "inputs", None), str):
            raise InputError(f"{self.basis!r} is no basis; expected an Expression, as in Expression('sin(2*J4)')")


@dataclass(frozen=True)
class TakenUp:
    """A twist (6,), m and rad, of the registration of one set-up in the instrument's frame, or of one tool in its own.

    of: REGISTRATION or TOOL. label: the set-up or the tool.
    """

    of: str
    label: str
    twist: tuple[float, ...]


@dataclass(frozen=True)
class Effect:
    """A small twist per unit of one unknown: Σ weight φ(s) e_axis over its terms.

    family: the family of the catalogue, empty without one. prior: standard deviation
    of the unknown around `mean` that is believed before measuring; infinite for none. taken_up: per unit of the
    unknown, the rigid motions that registrations and tools take up, so that it acts in the rest alone.
    """

    name: str
    terms: tuple[Term, ...]
    unit: str
    family: str = ""
    prior: float = math.inf
    mean: float = 0.0
    taken_up: tuple[TakenUp, ...] = ()

    def __post_init__(self) -> None:
        if not made_of(self.terms, Term):
            raise InputError(f"effect {self.name!r}: expected a tuple of terms, as in (Term('base', 'Rx'),)")

    @cached_property
    def inputs(self) -> tuple[str, ...]:
        """The state columns that its bases read."""
        return tuple(dict.fromkeys(i for term in self.terms for i in term.basis.inputs))

    @cached_property
    def slots(self) -> tuple[str, ...]:
        """The slots it acts at."""
        return tuple(dict.fromkeys(term.slot for term in self.terms))

    @property
    def of_the_instrument(self) -> bool:
        """True if the effect moves only the instrument's readings, not the mechanism."""
        return self.slots == (INSTRUMENT,)

    @property
    def constant(self) -> bool:
        """True if the effect is constant over the poses: a geometric error."""
        return not self.inputs

    def twist(self, states: States, slot: str) -> Array:
        """Twist (N, 6) at `slot` per unit of the unknown, metres and radians, in the slot's frame."""
        out = np.zeros((len(states), 6))
        for term in self.terms:
            if term.slot == slot:
                out[:, AXES.index(term.axis)] += term.weight * states.value(term.basis)
        return out


def axis_unit(axis: str) -> str:
    """m for a translation, rad for a rotation."""
    return "m" if axis.startswith("T") else "rad"


def effect_at(
    name: str, slot: str, axis: str, basis: Basis = ONE, unit: str = "", family: str = "", prior: float = math.inf
) -> Effect:
    """The common effect: one slot, one axis, one basis; θ φ(s) e_axis is the twist there.

    slot: "J4.moving", "J4.fixed", "base", "tool", or "instrument". axis: "Tx" to "Tz", m, or "Rx" to "Rz", rad, of the
    slot's own frame. basis: φ, an Expression or any object with `inputs`, `str()` and a call that gives (N,). unit: of
    the unknown θ, that of the axis where empty. family, prior: as in Effect. Raises InputError for an unknown axis.
    """
    return Effect(name, (Term(slot, axis, basis),), unit or axis_unit(axis), family, prior)


def drive_effect(
    name: str, joint: Joint, basis: Basis, unit: str = "", family: str = "", prior: float = math.inf
) -> Effect:
    """An error of a joint's own coordinate, wherever its drive makes it act."""
    terms = tuple(Term(slot, axis, basis, weight) for slot, axis, weight in joint.drive)
    return Effect(name, terms, unit or ("rad" if joint.kind == "revolute" else "m"), family, prior)

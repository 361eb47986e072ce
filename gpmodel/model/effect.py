"""Effects: a coefficient times a small twist at one or more frames of the chain, with a basis function of the pose."""

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
"""Columns of a table with the labels of the set-up (rows with a common registration) and of the tool."""


def made_of(parts: object, kind: type) -> bool:
    """Return whether `parts` is a tuple whose elements all have the type `kind`."""
    return isinstance(parts, tuple) and not [part for part in parts if not isinstance(part, kind)]


@dataclass(frozen=True)
class Term:
    """Term of an error effect: weight times basis function, along one axis of one frame of the kinematic chain."""

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
    """A rigid motion (6,), m and rad: of a set-up's registration in the instrument's frame, or of a tool in its frame.

    of: name of the column with the label, "setup" or "tool".
    label: name of the set-up or the tool.
    """

    of: str
    label: str
    twist: tuple[float, ...]


@dataclass(frozen=True)
class Effect:
    """A small twist at frames of the chain, per unit of one coefficient θ: sum over terms of weight · φ(state) · axis.

    unit: unit of the coefficient θ.
    family: family of the catalogue, or empty.
    prior: prior standard deviation of θ around `mean`; infinite without a prior.
    taken_up: rigid motions per unit of θ that are subtracted from the effect, so that registration and tool do not
    change.
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
        """Names of the inputs (columns of the poses) in the effect's basis functions."""
        return tuple(dict.fromkeys(i for term in self.terms for i in term.basis.inputs))

    @cached_property
    def slots(self) -> tuple[str, ...]:
        """Names of the slots (frames of the chain) at which the effect acts."""
        return tuple(dict.fromkeys(term.slot for term in self.terms))

    @property
    def of_the_instrument(self) -> bool:
        """True if the effect changes only the measurements of the instrument, not the motion of the mechanism."""
        return self.slots == (INSTRUMENT,)

    @property
    def constant(self) -> bool:
        """True if the effect does not depend on the pose: a geometric constant."""
        return not self.inputs

    def twist(self, states: States, slot: str) -> Array:
        """Return the effect's twist (poses, 6), m and rad, at the frame `slot` per unit of its coefficient."""
        out = np.zeros((len(states), 6))
        for term in self.terms:
            if term.slot == slot:
                out[:, AXES.index(term.axis)] += term.weight * states.value(term.basis)
        return out


def axis_unit(axis: str, column: str = "1") -> str:
    """Return the unit of a coefficient: m for a translation, rad for a rotation, each per unit of its `column`."""
    return ("m" if axis.startswith("T") else "rad") + (f"/{column}" if column != "1" else "")


def effect_at(
    name: str, slot: str, axis: str, basis: Basis = ONE, unit: str = "", family: str = "", prior: float = math.inf
) -> Effect:
    """Return an effect with one slot (frame), one axis and one basis function φ: the twist θ φ(state) along the axis.

    slot: name of the frame: "J4.moving", "J4.fixed", "base", "tool", or "instrument".
    axis: "Tx" to "Tz", m, or "Rx" to "Rz", rad, of the frame of the slot.
    basis: φ, an Expression or any object with `inputs`, `str()` and a call that returns a value per pose.
    unit: unit of the coefficient θ; if empty, m or rad as for the axis.
    family, prior: family and prior standard deviation, as in Effect.
    Raises InputError for an unknown axis.
    """
    return Effect(name, (Term(slot, axis, basis),), unit or axis_unit(axis), family, prior)


def drive_effect(
    name: str, joint: Joint, basis: Basis, unit: str = "", family: str = "", prior: float = math.inf
) -> Effect:
    """Return an error of a joint's coordinate as an effect, which acts at each frame of the joint's drive."""
    terms = tuple(Term(slot, axis, basis, weight) for slot, axis, weight in joint.drive)
    return Effect(name, terms, unit or ("rad" if joint.kind == "revolute" else "m"), family, prior)

"""Write gravity loads as arithmetic with two functions that every exported source defines.

    load(frames, slot, axis, weights)       component of the wrench that bodies at and beyond a slot exert at its origin
    couple(frames, at, side, slot, axis)    component of the couple of 1 kg·m along an axis of the frame `at`

axis: 0 to 2 for the force along x, y, z of the slot's frame, N; 3 to 5 for the moment, N·m.
"""

import re
from dataclasses import dataclass

import numpy as np

from gpmodel.application.exports.chain import Chain
from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import AXES, Mechanism

_WRENCH = re.compile(r"(?P<kind>force|moment)_(?P<of>\w+)_(?P<side>[xyz])$")
_BASE_COUPLE = re.compile(r"moment_base_(?P<side>[xyz])_of_(?P<link>\w+)_(?P<along>[xyz])$")
_COUPLE = re.compile(r"torque_(?P<joint>\w+?)_of_(?P<link>\w+)_(?P<along>[xyz])$")
_OWN = re.compile(r"torque_(?P<joint>\w+?)_of_(?P<link>\w+)$")
_PAYLOAD = re.compile(r"payload_torque_(?P<joint>\w+)$")
_TORQUE = re.compile(r"torque_(?P<joint>\w+)$")


@dataclass(frozen=True)
class Body:
    """A mass, kg, and its centre (3,), m, in the frame of a slot."""

    slot: int
    mass: float
    centre: Array


@dataclass(frozen=True)
class Loads:
    """Gravity loads of a mechanism as text. bodies: all bodies with mass, the payload last."""

    mechanism: Mechanism
    chain: Chain
    bodies: tuple[Body, ...]

    def text(self, name: str) -> str:
        """Return the load with that name; raise InputError for another name, or if the masses of its arm are
        unknown."""
        try:
            return self._text(name)
        except ValueError:
            raise InputError(
                f"input '{name}' is a load of another arm than {self.chain.slots[-1]}; expected a load of this arm"
            ) from None

    def _text(self, name: str) -> str:
        if self.bodies and (match := _BASE_COUPLE.match(name)):
            axis = 3 + "xyz".index(match["side"])
            return f"couple(frames, {self._slot(match['link'])}, {'xyz'.index(match['along'])}, 0, {axis})"
        if self.bodies and (match := _WRENCH.match(name)):
            axis = "xyz".index(match["side"]) + (3 if match["kind"] == "moment" else 0)
            return f"load(frames, {self._slot(match['of'])}, {axis}, weights)"
        if self.bodies and (match := _COUPLE.match(name)):
            at, along = self._slot(match["link"]), "xyz".index(match["along"])
            turning = [(w, s, a) for w, s, a in self._drive(match["joint"]) if s <= at and a >= 3]
            return _sum([f"{w!r} * couple(frames, {at}, {along}, {s}, {a})" for w, s, a in turning])
        if self.bodies and (match := _OWN.match(name)):
            return self._torque(match["joint"], f"weight_of_{self._body(match['link'])}")
        if self.bodies and (match := _PAYLOAD.match(name)):
            return self._torque(match["joint"], f"weight_of_{len(self.bodies) - 1}")
        if self.bodies and (match := _TORQUE.match(name)):
            return self._torque(match["joint"], "weights")
        raise InputError(f"input '{name}' cannot be written as source; expected joint values, loads or columns")

    def _torque(self, joint: str, weights: str) -> str:
        parts = [f"{w!r} * load(frames, {s}, {a}, {weights})" for w, s, a in self._drive(joint)]
        return _sum(parts)

    def _drive(self, joint: str) -> list[tuple[float, int, int]]:
        """Return weight, slot and axis of every motion that a joint drives."""
        drive = next((j.drive for j in self.mechanism.joints if j.name == joint), ())
        return [(float(w), self.chain.slots.index(slot), AXES.index(axis)) for slot, axis, w in drive]

    def _slot(self, link: str) -> int:
        return 0 if link == "base" else self.chain.slots.index(f"{link}.moving")

    def _body(self, link: str) -> int:
        slot = self._slot(link)
        return int(np.flatnonzero([body.slot == slot for body in self.bodies])[0])


def _sum(parts: list[str]) -> str:
    return " + ".join(parts) or "0.0"

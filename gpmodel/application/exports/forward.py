"""Forward kinematics with errors as data for generated source code: chain of motions, error terms, gravity loads.

Gravity loads are arithmetic expressions of two functions that every exported source defines.

    load(frames, slot, axis, weights)       component of the wrench that bodies at and beyond a slot exert at its origin
    couple(frames, at, side, slot, axis)    component of the couple of 1 kg·m along an axis of the frame `at`

axis: 0 to 2 for the force along x, y, z of the slot's frame, N; 3 to 5 for the moment, N·m.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.application.exports.sample import Place
from gpmodel.application.model_file import SavedModel
from gpmodel.application.usable import Clamped, Ended, at_end, usable
from gpmodel.arrays import ROUNDING, Array
from gpmodel.errors import InputError
from gpmodel.formula.expression import Basis, Expression
from gpmodel.mechanism.branches import branched, random_poses
from gpmodel.mechanism.protocol import AXES, KnownMasses, Mechanism, closed, unwrapped
from gpmodel.mechanism.source import choice_of
from gpmodel.model.memory import read_by
from gpmodel.model.sites import translate
from gpmodel.model.states import measured_torques
from gpmodel.numerics import se3

PROBES = 8
"""Number of random poses at which the exported chain is compared with the mechanism."""


@dataclass(frozen=True)
class Chain:
    """Serial chain of frames T_s(q) = fixed_s · motion along or about axis_s by weights_s · q, q the joint values.

    slots: names of the frames s. fixed: constant transforms, m. axes: "Tx" to "Rz", or "" for a frame without motion.
    weights: factors of the table's joint values in the motion of each frame.
    """

    slots: tuple[str, ...]
    fixed: Array
    axes: tuple[str, ...]
    weights: Array

    @property
    def moving(self) -> tuple[int, ...]:
        """Numbers of the slots (frames) with a joint motion."""
        return tuple(i for i, axis in enumerate(self.axes) if axis)

    @property
    def motions(self) -> Array:
        """Matrix from the table's joint values to the motions of all frames."""
        return self.weights[list(self.moving)]

    def transforms(self, q: Array) -> Array:
        out = np.repeat(self.fixed[:, None], len(q), axis=1)
        for s in self.moving:
            twists = np.zeros((len(q), 6))
            twists[:, AXES.index(self.axes[s])] = q @ self.weights[s]
            out[s] = out[s] @ se3.exp(twists)
        return out


def coupled(mechanism: Mechanism) -> dict[str, dict[str, float]]:
    """Return the joints that several values of the controller move, as by a parallelogram linkage.

    A coupled joint is mapped to the joints whose values move it, with factors; first the joint itself, factor 1.
    """
    moves: dict[str, dict[str, float]] = {}
    for joint in mechanism.joints:
        for slot, _, weight in joint.drive:
            moves.setdefault(slot.removesuffix(".moving"), {})[joint.name] = weight
    several = {name: factors for name, factors in moves.items() if len(factors) > 1 and name in factors}
    return {
        name: {name: 1.0} | {other: w / factors[name] for other, w in factors.items() if other != name}
        for name, factors in several.items()
    }


def arm_of(mechanism: Mechanism, tip: str) -> Chain:
    """Return the chain that ends at a measured link `tip`, driven by all joint values; for one arm, the whole chain.

    Raises InputError if the mechanism is no serial chain, or if several arms do not have separate tools.
    """
    tree = branched(mechanism)
    if tree is None:
        return chain_of(mechanism)
    if not tip:
        raise InputError(
            f"no tool belongs to a single arm of {mechanism.name}; expected a separate tool for each arm in 'tool'"
        )
    alone = tree.alone(tip)
    own = chain_of(alone)
    weights = np.zeros((len(own.slots), len(mechanism.joints)))
    weights[:, [[j.name for j in mechanism.joints].index(j.name) for j in alone.joints]] = own.weights
    return replace(own, slots=(*own.slots[:-1], tree.tips[tip]), weights=weights)


def chain_of(mechanism: Mechanism) -> Chain:
    """Return the serial chain of frames of a mechanism.

    Raises InputError for several arms, closed loops, or a slot (frame) that moves about more than one axis.
    """
    if branched(mechanism) or closed(mechanism):
        what = "several arms" if branched(mechanism) else "closed loops"
        raise InputError(f"{mechanism.name} has {what}; expected a serial chain")
    slots, joints = mechanism.slots, mechanism.joints
    axes, weights = [""] * len(slots), np.zeros((len(slots), len(joints)))
    for column, joint in enumerate(joints):
        for slot, axis, weight in joint.drive:
            at = slots.index(slot)
            if axes[at] not in ("", axis):
                raise InputError(f"{mechanism.name}: {slot} moves about more than one axis; expected a serial chain")
            axes[at], weights[at, column] = axis, weight
    rest = mechanism.transforms(np.zeros((1, len(joints))))[:, 0]
    found = Chain(slots, rest, tuple(axes), weights)
    q = random_poses(mechanism, PROBES, np.random.default_rng(0))
    if not np.allclose(found.transforms(q), mechanism.transforms(q), atol=ROUNDING, rtol=0):
        raise InputError(f"{mechanism.name}: a joint has several motions; expected a serial chain")
    return found


_WRENCH = re.compile(r"(?P<kind>force|moment)_(?P<of>\w+)_(?P<side>[xyz])$")
_BASE_COUPLE = re.compile(r"moment_base_(?P<side>[xyz])_of_(?P<link>\w+)_(?P<along>[xyz])$")
_COUPLE = re.compile(r"torque_(?P<joint>\w+?)_of_(?P<link>\w+)_(?P<along>[xyz])$")
_OWN = re.compile(r"torque_(?P<joint>\w+?)_of_(?P<link>\w+)$")
_PAYLOAD = re.compile(r"payload_torque_(?P<joint>\w+)$")
_TORQUE = re.compile(r"torque_(?P<joint>\w+)$")


@dataclass(frozen=True)
class Body:
    """A mass, kg, and its centre of mass, m, in a frame (slot) of the chain."""

    slot: int
    mass: float
    centre: Array


@dataclass(frozen=True)
class Loads:
    """Gravity loads of a mechanism as source text. bodies: all bodies with mass, the payload last."""

    mechanism: Mechanism
    chain: Chain
    bodies: tuple[Body, ...]

    def text(self, name: str) -> str:
        """Return the source text of a gravity load by name; raise InputError for an unknown name or unknown masses."""
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
        """Return weight, index of the frame (slot) and index of the axis of every motion that a joint drives."""
        drive = next((j.drive for j in self.mechanism.joints if j.name == joint), ())
        return [(float(w), self.chain.slots.index(slot), AXES.index(axis)) for slot, axis, w in drive]

    def _slot(self, link: str) -> int:
        return 0 if link == "base" else self.chain.slots.index(f"{link}.moving")

    def _body(self, link: str) -> int:
        slot = self._slot(link)
        return int(np.flatnonzero([body.slot == slot for body in self.bodies])[0])


def _sum(parts: list[str]) -> str:
    return " + ".join(parts) or "0.0"


@dataclass(frozen=True)
class Line:
    """One term of an error twist: coefficient times basis function, along an axis of a frame (slot)."""

    slot: int
    axis: int
    coefficient: float
    basis: Basis


@dataclass(frozen=True)
class Forward:
    """Forward model T_register · Π T_s exp(Σ lines) · T_tool over the frames s, for the set-up, tool and arm `place`.

    computed: gravity loads that basis functions use, as arithmetic with `load` and `couple`.
    inputs: names and units of required inputs besides joint values.
    bodies: bodies with mass; the last body is 1 kg of payload.
    missing: omitted effects, with the names of the fitted table.
    """

    saved: SavedModel
    chain: Chain
    lines: tuple[Line, ...]
    computed: Mapping[str, str]
    inputs: Mapping[str, str]
    bodies: tuple[Body, ...]
    gravity: Array
    missing: tuple[str, ...]
    place: Place


def forward_of(saved: SavedModel, place: Place) -> Forward:
    """Return the forward model of `predict` at the end of the session, without effects that source text cannot express.

    If the mechanism has several arms, the forward model is that of the arm with the tool of `place`. Raises InputError
    for a mechanism that is not a serial chain, or a load with unknown masses.
    """
    whole = usable(saved)
    kept = at_end(whole)
    chain = arm_of(saved.mechanism, place.tip)
    lines = tuple(
        Line(chain.slots.index(t.slot), AXES.index(t.axis), float(value * t.weight), basis)
        for e, value in zip(kept.model.effects, kept.theta, strict=True)
        if value != 0.0
        for t in e.terms
        if t.slot in chain.slots and (basis := _written(t.basis)) is not None
    )
    bodies, gravity = _masses(saved, chain, place)
    own = {joint.name for joint in saved.mechanism.joints} | set("xyz")
    read = [n for n in dict.fromkeys(name for line in lines for name in line.basis.inputs) if n not in own]
    given = set(kept.input_units) | _measured_torques(saved) | {n for n in read if read_by(n)}
    loads = Loads(saved.mechanism, chain, bodies)
    computed = {name: loads.text(name) for name in read if name not in given and name != "payload"}
    inputs = {name: kept.input_units.get(name, "N*m" if name.startswith("torque_") else "1") for name in read}
    inputs = {name: unit for name, unit in inputs.items() if name not in computed} | {"payload": "kg"}
    left = {e.name for e in saved.model.effects} - {
        e.name for e in whole.model.effects if all(_written(t.basis) is not None for t in e.terms)
    }
    values = zip(saved.model.effects, saved.theta.tolist(), strict=True)
    missing = tuple(translate(e.name, saved.names) for e, value in values if e.name in left and value)
    return Forward(kept, chain, lines, computed, inputs, bodies, gravity, missing, place)


def _written(basis: Basis) -> Basis | None:
    """Return a basis function that source text can express; a function of time and row becomes a number, or None."""
    last = basis.basis if isinstance(basis, Clamped) else basis
    if not isinstance(last, Ended):
        return basis
    return None if last.constant is None else Expression(repr(last.constant))


def _measured_torques(saved: SavedModel) -> set[str]:
    if saved.measured is None:
        return set()
    return {f"torque_{joint}" for joint in measured_torques(saved.mechanism, saved.measured.dataset)}


def _masses(saved: SavedModel, chain: Chain, place: Place) -> tuple[tuple[Body, ...], Array]:
    """Return the bodies with mass, and gravity; each of several arms carries only its own links, without payload."""
    tree = branched(saved.mechanism)
    bare = unwrapped(saved.mechanism) if tree is None else tree.alone(place.tip)
    if not isinstance(bare, KnownMasses):
        return (), np.zeros(3)
    slots = dict(zip(bare.slots, range(len(chain.slots)), strict=True))
    bodies = [Body(slots[slot], mass, centre) for slot, (mass, centre) in bare.bodies.items()]
    com = dict(choice_of(saved.mechanism).tool_coms).get(place.tool, bare.payload_com)
    carried = Body(len(chain.slots) - 1, float(tree is None), np.asarray(com))
    return (*bodies, carried), bare.gravity

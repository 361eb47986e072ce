"""Forward model as data: all numbers and terms, for generating source code."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gpmodel.application.exports.chain import Chain, arm_of
from gpmodel.application.exports.loads import Body, Loads
from gpmodel.application.exports.sample import Place
from gpmodel.application.model_file import SavedModel
from gpmodel.application.usable import Clamped, Ended, placed_now, usable
from gpmodel.arrays import Array
from gpmodel.formula.expression import Basis, Expression
from gpmodel.mechanism.branches import branched
from gpmodel.mechanism.protocol import AXES, Massive, bare_of
from gpmodel.model.memory import read_by
from gpmodel.model.sites import translate
from gpmodel.model.states import measured_torques


@dataclass(frozen=True)
class Line:
    """Term coefficient · basis of an error twist along an axis of a slot."""

    slot: int
    axis: int
    coefficient: float
    basis: Basis


@dataclass(frozen=True)
class Forward:
    """Forward model T_register · Π T_s exp(Σ lines) · T_tool, of the set-up, tool and arm `place`.

    computed: gravity loads that basis functions use, as arithmetic with `load` and `couple`.
    inputs: names and units of required inputs besides joint values.
    bodies: with mass; the last one is 1 kg of payload.
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
    """Return the forward model of `predict`, without effects that text cannot express at the end of the session.

    If the mechanism has several arms, the forward model is that of the arm with the tool of `place`. Raises InputError
    for a mechanism that is not a serial chain, or a load with unknown masses.
    """
    whole = usable(saved)
    kept = placed_now(whole)
    chain = arm_of(saved.mechanism, place.tip)
    lines = tuple(
        Line(chain.slots.index(t.slot), AXES.index(t.axis), float(value * t.weight), basis)
        for e, value in zip(kept.model.effects, kept.theta, strict=True)
        if value != 0.0
        for t in e.terms
        if t.slot in chain.slots and (basis := _written(t.basis)) is not None
    )
    bodies, gravity = _masses(saved, chain, place.tip)
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
    """Return a basis function as text can express it; at the end of the session a number, or None if it depends on the
    pose."""
    last = basis.basis if isinstance(basis, Clamped) else basis
    if not isinstance(last, Ended):
        return basis
    return None if last.constant is None else Expression(repr(last.constant))


def _measured_torques(saved: SavedModel) -> set[str]:
    if saved.measured is None:
        return set()
    return {f"torque_{joint}" for joint in measured_torques(saved.mechanism, saved.measured.dataset)}


def _masses(saved: SavedModel, chain: Chain, tip: str) -> tuple[tuple[Body, ...], Array]:
    """Return the bodies with mass, and gravity; each of several arms carries only itself, without payload."""
    tree = branched(saved.mechanism)
    bare = bare_of(saved.mechanism) if tree is None else tree.alone(tip)
    if not isinstance(bare, Massive):
        return (), np.zeros(3)
    slots = dict(zip(bare.slots, range(len(chain.slots)), strict=True))
    bodies = [Body(slots[slot], mass, centre) for slot, (mass, centre) in bare.bodies.items()]
    carried = Body(len(chain.slots) - 1, float(tree is None), np.asarray(bare.payload_com))
    return (*bodies, carried), bare.gravity

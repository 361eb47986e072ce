"""Sites of error twists (the base, the drive and other axes of each joint, the tool), and geometric constants."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

import numpy as np

from gpmodel.arrays import ROUNDING, Array
from gpmodel.errors import InputError
from gpmodel.formula.expression import Basis, Expression
from gpmodel.mechanism.branches import branched, mounting_slots
from gpmodel.mechanism.protocol import AXES, Mechanism, closed, followers
from gpmodel.model.effect import Effect, Term, effect_at
from gpmodel.model.memory import read_by
from gpmodel.model.states import States
from gpmodel.table.dataset import Dataset

_WORD = re.compile(r"[A-Za-z_][A-Za-z_0-9]*")


def names_of(data: Dataset) -> Mapping[str, str]:
    """Map the names of joints, loads and extra columns of the mechanism to the names in the table."""
    return {**table_names(data.joints, data.columns or data.joints), **data.extra_names}


def table_names(joints: Sequence[str], columns: Sequence[str]) -> Mapping[str, str]:
    """Map joint names, and names of loads that contain a joint name, to the names of the columns of the table."""
    out = {}
    for joint, column in zip(joints, columns, strict=True):
        out[joint] = column
        for prefix in ("torque", "payload_torque", "approach", "last_move"):
            out[f"{prefix}_{joint}"] = f"{prefix}_{column}"
        for axis in "xyz":
            for prefix in ("force", "moment"):
                out[f"{prefix}_{joint}_{axis}"] = f"{prefix}_{column}_{axis}"
    return {**out, **_unit_loads(dict(zip(joints, columns, strict=True)))}


def _unit_loads(columns: Mapping[str, str]) -> dict[str, str]:
    """Map names of joint torques by one link: `torque_J2_of_J4`, and `torque_J2_of_J4_x` by its first moment."""
    at = {f"torque_{j}": f"torque_{c}" for j, c in columns.items()}
    at |= {f"moment_base_{a}": f"moment_base_{a}" for a in "xy"}
    return {
        f"{here}_of_{link}{axis}": f"{shown}_of_{column}{axis}"
        for here, shown in at.items()
        for link, column in columns.items()
        for axis in ("", "_x", "_y", "_z")
    }


def translate(text: str, names: Mapping[str, str]) -> str:
    """Replace whole words of a text, also inside names such as `lag_J1_40`; `J1` does not match in `J10`."""

    def said(match: re.Match[str]) -> str:
        word = match[0]
        for source in () if word in names else read_by(word):
            word = word.replace(f"_{source}", f"_{names.get(source, source)}", 1)
        return names.get(word, word)

    return _WORD.sub(said, text)


def with_joint_names(text: str, mechanism: Mechanism, signs: str = r"[\W_]") -> str:
    """Replace names of joints as a description or a table spells them, such as `Achse 3`, by the mechanism's `Achse_3`.

    signs: pattern of the characters that an underscore of the mechanism's name replaces.
    """
    for name in sorted((joint.name for joint in mechanism.joints), key=len, reverse=True):
        if not name.startswith("_"):  # of a joint whose name begins with a digit
            text = re.sub(rf"(?<![^\W_]){name.replace('_', signs)}(?![^\W_])", name, text)
    return text


def mechanism_names(mechanism: Mechanism, states: States) -> Mapping[str, str]:
    """Map names with J1 to Jn of joints and loads to the mechanism's names, except names of the table's columns."""
    own = [joint.name for joint in mechanism.joints]
    numbered = [f"J{i}" for i in range(1, len(own) + 1)]
    known = {*own, *states.columns}
    return {said: name for said, name in table_names(numbered, own).items() if said not in known}


def in_mechanism_names(effect: Effect, mechanism: Mechanism, states: States) -> Effect:
    """Return an effect with the mechanism's joint names in its frames and expressions, instead of J1 to Jn."""
    names = mechanism_names(mechanism, states)
    return replace(effect, terms=tuple(_renamed(term, names) for term in effect.terms))


def _renamed(term: Term, names: Mapping[str, str]) -> Term:
    basis = term.basis
    if isinstance(basis, Expression):
        basis = Expression(translate(str(basis), names))
    return replace(term, slot=translate(term.slot, names), basis=basis)


@dataclass(frozen=True)
class Site:
    """A site at which an error may act: an axis of a frame, or the drive of a joint, which may move several frames."""

    terms: tuple[tuple[str, str, float], ...]

    @property
    def slot(self) -> str:
        """Frame (slot) of the site's first axis."""
        return self.terms[0][0]

    @property
    def axis(self) -> str:
        """Name of the site's first axis, such as "Rz"."""
        return self.terms[0][1]

    @property
    def name(self) -> str:
        """Name of the site: names of frame (slot) and axis."""
        return f"{self.slot} {self.axis}"

    def effect(self, name: str, basis: Basis, unit: str, family: str = "", prior: float = math.inf) -> Effect:
        """Return an error effect at the site with one coefficient in `unit`, and its prior standard deviation."""
        terms = tuple(Term(slot, axis, basis, weight) for slot, axis, weight in self.terms)
        return Effect(name, terms, unit, family, prior)


def sites_of(mechanism: Mechanism) -> tuple[Site, ...]:
    """Return the sites of a mechanism at which errors may act: the base, every joint, the tool.

    The sites of a joint are its drive, the other axes of its moving frame, and the axes of its fixed frame that differ
    from those of the previous frame. A link that other joints move (coupled) has the axes of its moving side. With
    closed loops, the sites are those of the geometric constants, not of the joints.
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
    out += [Site(((f"{name}.moving", axis, 1.0),)) for name in followers(mechanism) for axis in AXES]
    out += [Site((("tool", axis, 1.0),)) for axis in AXES[:3]]
    return tuple(out)


def _is_new(step: Array, axis: str) -> bool:
    """Return whether a frame's axis differs from all twist axes of the previous frame. step: transform (4, 4) from the
    previous frame."""
    along = step[:3, "xyz".index(axis[1])]
    turned = np.cross(step[:3, 3], along) if axis[0] == "R" else np.zeros(3)
    return int(np.sum(np.abs([*along, *turned]) > ROUNDING)) > 1


def geometric_effects(mechanism: Mechanism) -> tuple[Effect, ...]:
    """Return the complete geometry, with redundant constants: six twists on the moving side of every joint, then of
    every link that follows other joints, such as the wrist of a palletiser.

    With closed loops, the mechanism states its constants. With several robot arms, each arm except the first has six
    more twists at its mounting.
    """
    loops, tree = closed(mechanism), branched(mechanism)
    stand = [mechanism.slots[i] for i in mounting_slots(tree)] if tree else []
    links = [*(joint.name for joint in mechanism.joints), *followers(mechanism)]
    slots = [*stand, *(f"{name}.moving" for name in links)]
    return tuple(
        effect_at(f"{slot.removesuffix('.moving')} {axis}", slot, axis, family="geometric")
        for slot, axis in (loops.constants if loops else ((slot, axis) for slot in slots for axis in AXES))
    )


def standard_effects(mechanism: Mechanism, patterns: Sequence[str] = ("*",)) -> tuple[Effect, ...]:
    """Return the geometric constants whose name (`J3 Ty`) matches any of the patterns; none for the single pattern
    `none`.

    patterns: shell patterns over NAME AXIS, with J1..Jn for the joints' own names. Raises InputError for a pattern
    without a match.
    """
    everything = geometric_effects(mechanism)
    if tuple(patterns) == ("none",):
        return ()
    chosen: set[str] = set()
    for pattern in patterns:
        known = {pattern, with_joint_names(pattern, mechanism)}
        fits = [
            e.name for e in everything if any(fnmatchcase(n, k) for n in _aliases(e.name, mechanism) for k in known)
        ]
        if not fits:
            raise InputError(
                f"'{pattern}' fits no parameter; available: {everything[0].name} to {everything[-1].name}", "standard"
            )
        chosen.update(fits)
    return tuple(e for e in everything if e.name in chosen)


def _aliases(name: str, mechanism: Mechanism) -> tuple[str, ...]:
    """Return the names of a geometric constant: its name, and its name with J1..Jn instead of the joint's name."""
    place, axis = name.rsplit(" ", 1)
    names = [joint.name for joint in mechanism.joints]
    at = (i for i, n in enumerate(names) if place == n or place.startswith(f"{n}."))
    return name, *(f"J{i + 1}{place.removeprefix(names[i])} {axis}" for i in at)

"""Load a mechanism from a name or file, with its measured frame and its payload."""

import os
import shutil
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import entry_points
from multiprocessing.util import Finalize
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import Array
from gpmodel.characters import harmless
from gpmodel.errors import InputError, choices
from gpmodel.mechanism.branches import links
from gpmodel.mechanism.protocol import ChangeableLoads, FittedLever, Joint, Mechanism, WeightByPart, checked_mass
from gpmodel.texts import read_text

PROVIDERS = "gpmodel.mechanisms"


def load_mechanism(name: str, *, frame: str | None = None, payload_com: Sequence[float] | None = None) -> Mechanism:
    """Return the mechanism from the first provider that knows `name`.

    A provider is an entry point of the group `gpmodel.mechanisms`: a callable load_mechanism(name, *, frame=None,
    payload_com=None) -> Mechanism | None. A function `mechanism_names` of its module may list its names for messages.

    frame: measured link (default: the last link).
    payload_com: centre of mass (3,) of the payload in the measured frame, m.
    Raises InputError if no provider knows the name.
    """
    known: list[str] = []
    broken: list[str] = []
    for provider in sorted(entry_points(group=PROVIDERS), key=lambda e: e.name != "robots"):
        try:
            load = provider.load()
        except (ImportError, AttributeError) as error:
            broken.append(f"; provider '{provider.name}' cannot be loaded: {error}")
            continue
        mechanism: Mechanism | None = load(name, frame=frame, payload_com=payload_com)
        if mechanism is not None:
            return mechanism
        known += getattr(sys.modules[provider.module], "mechanism_names", tuple)()
    raise InputError(
        f"'{name}' is unknown; expected a .urdf file, a .toml file of DH rows, a joint or a hexapod, or one of "
        f"{choices(name, known)}{''.join(broken)}",
        "mechanism",
    )


RESERVED = ("x", "y", "z", "rx", "ry", "rz", "row", "payload", "group", "repeat", "setup", "tool")
"""Names of table columns and inputs that a joint cannot have."""
FILES = (".urdf", ".toml")
LARGEST_FILE = 16 << 20
"""Largest size of the description of a mechanism, bytes. The largest description of example-robot-data, a humanoid with
hands, has 0.3 MB."""
LONGEST_JOINT = 200
"""Largest number of characters in the name of a joint, in a description and in a saved model."""


@dataclass(frozen=True)
class MechanismChoice:
    """Name or file of a mechanism, and its options.

    frame: name of the measured link.
    payload: payload mass, kg, or None.
    payload_com: centre of mass (3,) of the payload in the measured frame, m, or None.
    tool_coms: centres of mass (3,) of the payloads of several tools in the measured frame, m, by the label of the tool.
    gravity: acceleration of gravity (3,) in the root frame, m/s², or None for that of the description.
    added_mass, added_moment: mass, kg, beyond the description that the measured frame carries, and its first moment
    (3,) in this frame, kg m, or None.
    description: text of the file, if known. With a description, `name` is only a name, and no file is opened.
    """

    name: str
    frame: str | None = None
    payload: float | None = None
    payload_com: tuple[float, ...] | None = None
    description: str | None = None
    gravity: tuple[float, ...] | None = None
    added_mass: float | None = None
    added_moment: tuple[float, ...] | None = None
    tool_coms: tuple[tuple[str, tuple[float, ...]], ...] = ()

    def __post_init__(self) -> None:
        if self.payload is not None:
            checked_mass(self.payload, "", "payload")

    def load(self) -> "LoadedMechanism":
        """Load the chosen mechanism. Raises InputError if the mechanism is unknown or its file is invalid."""
        name, choice = self.name, self
        if self.description:
            name = str(_unpacked(self.name, self.description))
        elif self.description is None and os.path.isfile(name):
            choice = replace(self, description=read_text(Path(name), LARGEST_FILE, "the description of a mechanism"))
        elif self.description is not None and Path(name).suffix.lower() in FILES:
            raise InputError(f"mechanism '{name}' is a file, and its description is missing")
        try:
            bare = load_mechanism(name, frame=self.frame, payload_com=self.payload_com)
            if taken := [joint.name for joint in bare.joints if joint.name in RESERVED]:
                message = f"joint '{taken[0]}' has the name of another column of a table; expected another name"
                raise InputError(f"{name}: {message}, as axis_{taken[0]}")
            if longer := [joint.name for joint in bare.joints if len(joint.name) > LONGEST_JOINT]:
                message = f"the name of joint '{longer[0][:20]}...' has {len(longer[0])} characters"
                raise InputError(f"{name}: {message}; expected at most {LONGEST_JOINT}")
            loaded = LoadedMechanism(replace(choice, gravity=None, added_mass=None, added_moment=None), bare)
            if self.gravity is not None:
                loaded = loaded.with_gravity(self.gravity)
            if self.added_mass is not None:
                loaded = loaded.with_mass(self.added_mass, self.added_moment or (0.0, 0.0, 0.0))
            return loaded
        except InputError as error:
            if not self.description:
                raise
            raise InputError(error.said.replace(name, f"its mechanism {self.name}"), error.argument) from None


@cache
def _unpacked(name: str, description: str) -> Path:
    """Write a description to a temporary file, kept until this process ends, and return the path of the file.

    Some mechanisms can only be loaded from a file.
    """
    if Path(name).suffix.lower() not in FILES or len(description) > LARGEST_FILE:
        raise InputError(f"mechanism '{name}': expected a name that ends in {' or '.join(FILES)}, of a smaller file")
    folder = Path(tempfile.mkdtemp(prefix="gpmodel-"))
    Finalize(None, shutil.rmtree, (folder, True), exitpriority=0)  # atexit is not run in copies of a process
    path = folder / Path(name).name
    try:
        path.write_text(description, encoding="utf-8")
    except (OSError, UnicodeEncodeError) as error:
        raise InputError(f"mechanism '{name}': cannot be unpacked ({error})") from None
    return path


@dataclass(frozen=True, repr=False)
class LoadedMechanism:
    """A mechanism with the name and options from which it was loaded, and its payload.

    choice: name and options, from which a saved model loads the mechanism again.
    bare: the mechanism as its provider built it.
    """

    choice: MechanismChoice
    bare: Mechanism

    @property
    def name(self) -> str:
        """Name in the description, without characters that are unsafe in source code or on a terminal."""
        return harmless(self.bare.name)

    @property
    def joints(self) -> tuple[Joint, ...]:
        return self.bare.joints

    @property
    def slots(self) -> tuple[str, ...]:
        return self.bare.slots

    def transforms(self, q: Array) -> Array:
        return self.bare.transforms(q)

    def loads(self, q: Array, payload: Array) -> dict[str, Array]:
        return self.bare.loads(q, payload)

    def loads_by_tool(self, q: Array, payload: Array, tool: NDArray[np.str_]) -> dict[str, Array]:
        """Return the loads with the centre of mass of the tool of each pose.

        Loads are linear in the first moment of the payload: a payload m at c instead of c_0 adds m times the loads by
        the first moment c - c_0 of a mass of 1 kg. tool: label of the tool of each pose (poses,).
        """
        out = self.loads(q, payload)
        if not self.choice.tool_coms or not out or not isinstance(self.bare, ChangeableLoads):
            return out
        start = self.bare.with_mass(1.0, np.asarray(self.bare.payload_com)).loads(q, payload)
        for label, point in self.choice.tool_coms:
            end = self.bare.with_mass(1.0, np.array(point)).loads(q, payload)
            own = np.where(tool == label, payload, 0.0)
            out = {name: values + own * (end[name] - start[name]) for name, values in out.items()}
        return out

    def unit_loads(self, q: Array) -> dict[str, Array]:
        """Return the loads by unit first moments and masses of links, as WeightByPart.unit_loads; empty if unknown."""
        return self.bare.unit_loads(q) if isinstance(self.bare, WeightByPart) else {}

    @property
    def levers(self) -> dict[str, Array]:
        """Vectors of the links that grow with temperature; see gpmodel.mechanism.branches.links."""
        return links(self.bare)

    def reaching(self, point: Iterable[float]) -> "LoadedMechanism":
        """Return the mechanism with its lever adapted to the tool `point` (3,), m, from a first fit, in the measured
        frame."""
        return replace(self, bare=self.bare.reaching(point)) if isinstance(self.bare, FittedLever) else self

    def with_gravity(self, gravity: Iterable[float]) -> "LoadedMechanism":
        """Return a copy of the mechanism with a new acceleration of gravity (3,) in its root frame, m/s²."""
        choice = replace(self.choice, gravity=tuple(float(v) for v in gravity))
        return LoadedMechanism(choice, self._changeable.with_gravity(np.array(choice.gravity)))

    def with_mass(self, mass: float, moment: Iterable[float]) -> "LoadedMechanism":
        """Return the mechanism with a further mass, kg, and first moment (3,), kg m, at the measured frame."""
        own, first = np.array(self.choice.added_moment or np.zeros(3)), np.array([*moment])
        choice = replace(
            self.choice, added_mass=(self.choice.added_mass or 0.0) + mass, added_moment=tuple((own + first).tolist())
        )
        return LoadedMechanism(choice, self._changeable.with_mass(mass, first))

    @property
    def _changeable(self) -> ChangeableLoads:
        if not isinstance(self.bare, ChangeableLoads):
            raise InputError(f"{self.name}: its loads cannot be changed; expected a serial arm with masses")
        return self.bare

    def carrying_at(self, point: Iterable[float], by_tool: Mapping[str, Array] | None = None) -> "LoadedMechanism":
        """Return the mechanism with the centre of mass of its payload at `point` (3,), m, in the measured frame.

        by_tool: centre of mass (3,) of each tool's payload, m, by the label of the tool.
        """
        coms = tuple((label, tuple(com.tolist())) for label, com in (by_tool or {}).items())
        return replace(self.choice, payload_com=tuple(float(v) for v in point), tool_coms=coms).load()

    def __repr__(self) -> str:
        carried = "" if self.choice.payload is None else f", payload {self.choice.payload:g} kg"
        return f"<mechanism {self.name}: joints {', '.join(j.name for j in self.joints)}{carried}>"


def choice_of(mechanism: Mechanism) -> MechanismChoice:
    """Return name and options from which a mechanism can be loaded again; its name if it was built in Python."""
    return mechanism.choice if isinstance(mechanism, LoadedMechanism) else MechanismChoice(mechanism.name)

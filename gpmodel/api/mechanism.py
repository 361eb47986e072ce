"""Mechanisms, with what they carry."""

from collections.abc import Sequence
from pathlib import Path

from gpmodel.api.arguments import point, quantity, shown
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.mechanism.source import LoadedMechanism, MechanismChoice

MechanismLike = Mechanism | str | Path


def load_mechanism(
    source: str | Path,
    payload: str | float | None = None,
    *,
    frame: str | None = None,
    payload_com: str | Sequence[float] | None = None,
) -> LoadedMechanism:
    """A mechanism by name or from a file.

    source: a built-in name (`irb6400r`, `ur5`, `spherical-joint`), a .urdf file, or a .toml file of DH rows or of a
    joint. payload: what the tool carries in every row, "60 kg" or kg; where it hangs is found with the tool point by
    every function that fits, unless payload_com says it: "0,0,120mm" or (3,) m in the measured frame. frame: the
    measured link, by default the last one. Raises InputError: unknown name, a bad file, no unit.
    """
    if not isinstance(source, str | Path):
        raise InputError(f"{shown(source)}, expected the name or the file of a mechanism", "source")
    if not isinstance(frame, str | None):
        raise InputError(f"{shown(frame)}, expected the name of a link", "frame")
    mass = None if payload is None else quantity(payload, "mass", "payload")
    com = None if payload_com is None else point(payload_com, "payload_com")
    return MechanismChoice(str(source), frame, mass, com).load()


def mechanism_of(given: MechanismLike | None) -> Mechanism:
    """The mechanism itself, or that of a name or file. Raises InputError for what is neither."""
    if isinstance(given, str | Path):
        return load_mechanism(given)
    if not isinstance(given, Mechanism):
        raise InputError(f"{shown(given)}, expected a mechanism, its name or its file", "mechanism")
    return given

"""Mechanisms, with what they carry."""

from collections.abc import Sequence
from pathlib import Path

from gpmodel.api.arguments import point, quantity
from gpmodel.mechanism.source import LoadedMechanism, MechanismChoice


def load_mechanism(
    source: str | Path,
    payload: str | float | None = None,
    *,
    frame: str | None = None,
    payload_com: str | Sequence[float] | None = None,
) -> LoadedMechanism:
    """A mechanism by name or from a file.

    source: a built-in name (`irb6400r`, `ur5`, `spherical-joint`), a .urdf file, or a .toml file of DH rows.
    payload: what the tool carries in every row, "60 kg" or kg; where it hangs is found with the tool point by every
    function that fits, unless payload_com says it: "0,0,120mm" or (3,) m in the measured frame. frame: the measured
    link, by default the last one. Raises InputError: unknown name, a bad file, no unit.
    """
    mass = None if payload is None else quantity(payload, "mass", "payload")
    com = None if payload_com is None else point(payload_com, "payload_com")
    return MechanismChoice(str(source), frame, mass, com).load()

"""Import of files of other programs with a known layout: a table, or a description."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from gpmodel.arrays import Array
from gpmodel.errors import InputError, choices
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.table.units import JOINT_UNITS


@dataclass(frozen=True)
class Imported:
    """content: a table of text cells, the text of a mechanism's file, or cameras as a TOML file has them. described:
    what stands beside a table, "cameras" and "board", likewise. left_out: parts of the file that are not in it, each
    with the reason."""

    content: pd.DataFrame | str | dict[str, object]
    described: Mapping[str, Mapping[str, object]] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()


def left_out(what: str, names: Iterable[str]) -> tuple[str, ...]:
    """Say which parts of a file are not imported, as "no joint of arm.urdf: l6_x"; nothing of none."""
    named = ", ".join(names)
    return (f"{what}: {named}",) if named else ()


def joint_cells(mechanism: Mechanism | None, values: Mapping[str, Array], where: str) -> dict[str, list[str]]:
    """Joint columns with units, of values (N,) by joint name, rad and m.

    Raises InputError without a mechanism, which says which joints there are and which of them slide, or where one of
    its joints is missing.
    """
    if mechanism is None:
        raise InputError(f"{where}: joint values without units; expected --mechanism M, whose joints turn or slide")
    if missing := [j.name for j in mechanism.joints if j.name not in values]:
        raise InputError(f"{where}: no values of joint '{missing[0]}'; it has {choices(missing[0], values)}")
    return {f"{j.name} [{JOINT_UNITS[j.kind]}]": cells(values[j.name]) for j in mechanism.joints}


def surplus_joints(mechanism: Mechanism | None, names: Iterable[str]) -> tuple[str, ...]:
    """Say which names are of no joint of a mechanism, and so in no table of it."""
    if mechanism is None:
        return ()
    joints = {joint.name for joint in mechanism.joints}
    return left_out(f"no joint of {mechanism.name}", (name for name in names if name not in joints))


def cells(values: Array) -> list[str]:
    """Numbers as text, nothing where there is none."""
    return ["" if np.isnan(v) else repr(float(v)) for v in values]


def rotation_vectors(read: Callable[[Array], Rotation], numbers: Array) -> Array:
    """Rotation vectors (N, 3), rad, of rows of numbers (N, k) that are whole; NaN of others."""
    out, known = np.full((len(numbers), 3), np.nan), np.isfinite(numbers).all(axis=1)
    if known.any():
        out[known] = read(numbers[known]).as_rotvec()
    return out

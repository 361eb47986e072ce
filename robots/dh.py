"""Serial chains read from TOML tables of Denavit-Hartenberg rows, with the units in the keys.

    name = "my arm"                # default: the file's name
    convention = "modified"        # a row is Rx(alpha) Tx(a) Ry(beta) Rz(theta) Tz(d) (Craig);
                                   # or "standard": Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta) (Paul);
                                   # beta for nearly parallel axes only (Hayati)
    gravity_m_s2 = [0, 0, -9.81]   # in the root frame; this is the default

    [base]                         # first row's frame in the root frame; default: identity
    xyz_mm = [0, 0, 0]
    rpy_deg = [0, 0, 0]            # Rz(yaw) Ry(pitch) Rx(roll)

    [tool]                         # measured frame in the last row's frame; default: identity
    xyz_mm = [0, 0, 200]

    [[joint]]                      # one row per joint, from the base
    name = "J1"                    # default: J1, J2, ...
    kind = "revolute"              # the default; or "prismatic"
    alpha_deg = 0                  # alpha, a, beta, d and theta are zero by default;
    a_mm = 0                       # theta (d of a prismatic joint) is its value at coordinate zero
    d_mm = 800
    theta_deg = 0
    sign = 1                       # -1 if the coordinate has the opposite sense
    lower_deg = -180               # limits of the coordinate; default: none
    upper_deg = 180
    mass_kg = 262.6                # mass of the part that moves with this joint, up to the next
    com_mm = [120, 0, -400]        # centre of mass of this part in this row's frame

    [[coupling]]                   # parallel bar: motion of `joint` = sign * joint + factor * follows
    joint = "J3"
    follows = "J2"
    factor = -1

    [[arm]]                        # several arms instead of [base], [tool] and [[joint]]: each has these tables,
    name = "left"                  # as [[arm.joint]]; its name is the name of its measured frame. A joint that
                                   # moves several arms, as of a torso, is a row of one name in each arm.

Angles take _deg or _rad, lengths _mm, _m or _in, masses _kg.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import numpy as np

from gpmodel.arrays import Array
from gpmodel.characters import is_name
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import checked, checked_mass
from gpmodel.table.units import TomlTable
from gpmodel.texts import read_toml
from robots.chain import Branches, SerialChain, check_arms
from robots.links import DOWN, LONGEST_CHAIN, Link, along, placement


def of_another_kind(path: Path) -> bool:
    """Return True if a TOML file has a key `kind`, so that another loader reads it; False for an unreadable file."""
    try:
        return "kind" in read_toml(path, "a mechanism")
    except InputError:
        return False


def read_dh(path: Path) -> SerialChain | Branches:
    """Read a chain, or several arms, from a TOML file of Denavit-Hartenberg rows; see the docstring of this module.

    Errors named NAME.moving act in a frame that moves with the joint NAME. The frame NAME.moving is, in the modified
    convention, after all transforms of the row; in the standard convention, between Tz(d) and Tx(a). The joint
    moves about or along the z axis of the frame NAME.moving.
    Raises InputError if the file is unreadable, or a key is unknown, has no unit or no valid value.
    """
    top = TomlTable(read_toml(path, "a TOML table of DH rows"), str(path))
    name = top.text("name", path.stem)
    convention = top.choice("convention", ("standard", "modified"))
    gravity = top.quantity("gravity", "acceleration", np.array(DOWN), size=3)
    arms = top.tables("arm")
    if not arms:
        return _chain(top, _Common(name, convention, gravity), "tool")
    top.done()
    chains = tuple(_chain(arm, _Common(name, convention, gravity), arm.text("name", "")) for arm in arms)
    check_arms(chains, str(path))
    return Branches(name, chains)


@dataclass(frozen=True)
class _Common:
    """Values that all arms of a file share. convention: `standard` or `modified` rows. gravity: (3,), m/s²."""

    name: str
    convention: str
    gravity: Array


def _chain(top: TomlTable, common: _Common, frame: str) -> SerialChain:
    """Return the chain of one TOML table with [base], [tool], [[joint]] and [[coupling]]."""
    before = _placement(top.table("base"))
    tool = _placement(top.table("tool"))
    rows = top.tables("joint")
    if not rows:
        raise InputError(f"{top.where}: no [[joint]] rows; expected one for each joint, from the base")
    if len(rows) > LONGEST_CHAIN:
        raise InputError(f"{top.where}: {len(rows)} [[joint]] rows; expected at most {LONGEST_CHAIN}")
    links, signs, limits = [], [], []
    for number, row in enumerate(rows, start=1):
        link, after = _link(row, number, common.convention, before)
        before = after
        links.append(link)
        signs.append(row.choice("sign", (1, -1), 1))
        dimension = "angle" if link.axis == "Rz" else "length"
        lower = row.quantity("lower", dimension, -math.inf)
        upper = row.quantity("upper", dimension, math.inf)
        if not lower < upper:
            raise InputError(
                f"{row.where}: the lower limit {lower:g} is not below the upper limit {upper:g} (rad or m)"
            )
        limits.append((lower, upper))
        row.done()
    names = tuple(link.name for link in links)
    if len(set(names)) < len(names):
        raise InputError(f"{top.where}: joint names {', '.join(names)} repeat; expected different names")
    coupling = _coupled(top, names, np.array(signs, dtype=np.float64))
    top.done()
    return SerialChain(
        name=common.name,
        links=tuple(links),
        tool=before @ tool,
        joint_names=names,
        coupling=coupling,
        limits=np.array(limits),
        tool_frame=frame,
        gravity=common.gravity,
    )


def _coupled(top: TomlTable, names: tuple[str, ...], signs: Array) -> Array:
    """Return the matrix of the motions of the links per joint coordinate. Raises InputError for two couplings of one
    pair of joints, or a cycle of couplings."""
    coupling, pairs = np.diag(signs), dict[tuple[str, str], str]()
    for table in top.tables("coupling"):
        pair = table.choice("joint", names), table.choice("follows", names)
        if pair[0] == pair[1]:
            raise InputError(f"{table.where}: {pair[0]} follows itself; expected another joint")
        if pair in pairs:
            raise InputError(f"{table.where}: {pair[0]} follows {pair[1]} already; expected one [[coupling]] per pair")
        factor = checked(table.number("factor"), "angle", f"{table.where}: factor")
        coupling[names.index(pair[0]), names.index(pair[1])] = factor
        pairs[pair] = table.where
        table.done()
    graph: dict[str, set[str]] = {}
    for joint, follows in pairs:
        graph.setdefault(joint, set()).add(follows)
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        circle = " follows ".join(reversed(error.args[1]))
        raise InputError(f"{list(pairs.values())[-1]}: {circle}; expected couplings without a cycle") from None
    return coupling


def _link(row: TomlTable, number: int, convention: str, before: Array) -> tuple[Link, Array]:
    """Return the link of a Denavit-Hartenberg row, and the constant transform from its motion to the row's frame."""
    name = row.text("name", f"J{number}")
    if not is_name(name):
        raise InputError(
            f"{row.where}: name is {name!r}, expected letters, digits and underscores, and no keyword of Python"
        )
    axis = {"revolute": "Rz", "prismatic": "Tz"}[row.choice("kind", ("revolute", "prismatic"), "revolute")]
    alpha, theta = row.quantity("alpha", "angle", 0.0), row.quantity("theta", "angle", 0.0)
    a, d = row.quantity("a", "length", 0.0), row.quantity("d", "length", 0.0)
    mass = row.quantity("mass", "mass", 0.0)
    checked_mass(mass, f"{row.where}: mass_kg")
    com = row.quantity("com", "length", np.zeros(3), size=3)
    screw = along("Rz", theta) @ along("Tz", d)
    twist = along("Rx", alpha) @ along("Tx", a) @ along("Ry", row.quantity("beta", "angle", 0.0))
    if convention == "modified":
        return Link(name, before @ twist @ screw, axis, mass, com), np.eye(4)
    return Link(name, before @ screw, axis, mass, twist[:3, :3] @ com + twist[:3, 3]), twist


def _placement(table: TomlTable) -> Array:
    xyz = table.quantity("xyz", "length", np.zeros(3), size=3)
    rpy = table.quantity("rpy", "angle", np.zeros(3), size=3)
    table.done()
    return placement(xyz, rpy)

"""Read links with masses and the joints between links from a URDF file, without meshes."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError, choices
from gpmodel.mechanism.protocol import LARGEST, checked, checked_mass
from gpmodel.mechanism.source import LARGEST_FILE
from gpmodel.texts import read_limited
from robots.links import placement

MOST_JOINTS = 300
"""Largest number of joints of a URDF; a humanoid robot with hands has 100 joints."""

ELEMENTS = ("link", "joint", "inertial", "mass", "origin", "parent", "child", "axis", "limit", "mimic", "calibration")
"""XML elements of a URDF that are read; names of XML elements are case sensitive."""


class _Plain(ET.TreeBuilder):
    """XML builder that refuses a document type, which could define entities of unlimited size."""

    def doctype(self, name: str, public: str | None, system: str | None) -> None:
        """Raise ValueError for an XML document type."""
        raise ValueError(f"document type {name!r}; expected elements only")


def parse_xml(path: Path) -> ET.Element:
    """Return the <robot> element of a URDF file, with comments. Raises InputError if the file cannot be a URDF."""
    try:
        content = read_limited(path, LARGEST_FILE, "a URDF file")
        root = ET.fromstring(content, ET.XMLParser(target=_Plain(insert_comments=True)))
    except InputError:
        raise
    except (ET.ParseError, ValueError, LookupError) as error:
        raise InputError(f"{path}: not well-formed XML ({error}); expected a URDF file") from error
    if root.tag != "robot":
        raise InputError(f"{path}: the root element is <{root.tag}>, expected <robot> as in a URDF file")
    for element in (*root, *root.iterfind("link/*"), *root.iterfind("link/inertial/*"), *root.iterfind("joint/*")):
        if (tag := str(element.tag)) not in ELEMENTS and tag.lower() in ELEMENTS:
            raise InputError(f"{path}: element <{tag}> is unknown; expected <{tag.lower()}>")
    if len(root.findall("joint")) > MOST_JOINTS:
        raise InputError(f"{path}: more than {MOST_JOINTS} joints; expected the description of one machine")
    if any("xacro" in str(element.tag) for element in root.iter()):
        raise InputError(f"{path}: holds xacro macros; expected plain URDF (run `xacro {path.name}` first)")
    return root


def has_geometry(path: Path) -> bool:
    """Return whether any link of the URDF file has collision geometry."""
    return any(link.find("collision/geometry") is not None for link in parse_xml(path).iterfind("link"))


MOVING = ("revolute", "continuous", "prismatic")
"""Kinds of URDF joints that have one coordinate."""
KINDS = (*MOVING, "fixed", "floating", "planar")

LONGEST_TITLE = 60
"""Largest number of characters of the name of a robot."""


@dataclass(frozen=True)
class Mimic:
    """A joint that follows a leading joint: motion = multiplier * motion of the leading joint + offset (rad or m)."""

    leader: str
    multiplier: float
    offset: float


@dataclass(frozen=True, eq=False)
class UrdfJoint:
    """A joint between two links of a URDF.

    origin: pose (4, 4) of the joint frame at rest in the frame of the parent link, m.
    axis: unit vector (3,) of the motion in the joint frame, or zero.
    limits: lower and upper limit, rad or m, infinite if not given.
    not_read: parts of the XML element that are ignored.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: Array
    axis: Array
    limits: tuple[float, float]
    mimic: Mimic | None
    not_read: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class UrdfTree:
    """The tree of links and joints of a URDF file.

    name: name of the robot, "" if not given.
    masses: {link: mass [kg] and centre of mass (3,) [m] in the link's frame}.
    """

    name: str
    root: str
    masses: dict[str, tuple[float, Array]]
    joints: tuple[UrdfJoint, ...]

    @cached_property
    def above(self) -> dict[str, UrdfJoint]:
        """{link: joint of which the link is the child}."""
        return {joint.child: joint for joint in self.joints}

    @cached_property
    def below(self) -> dict[str, list[UrdfJoint]]:
        """{link: joints of which the link is the parent, sorted by name}."""
        found: dict[str, list[UrdfJoint]] = {link: [] for link in self.masses}
        for joint in sorted(self.joints, key=lambda joint: joint.name):
            found[joint.parent].append(joint)
        return found

    @cached_property
    def frames(self) -> dict[str, Array]:
        """{link: pose (4, 4) of the link in the root frame with all joints at zero}, parents before children."""
        found: dict[str, Array] = {self.root: np.eye(4)}
        waiting = [*reversed(self.below[self.root])]
        while waiting:
            joint = waiting.pop()
            found[joint.child] = found[joint.parent] @ joint.origin
            waiting += reversed(self.below[joint.child])
        return found

    def route(self, link: str) -> list[UrdfJoint]:
        """Return the joints from the root to a link."""
        found: list[UrdfJoint] = []
        while link in self.above:
            found.insert(0, self.above[link])
            link = found[0].parent
        return found

    def moving_below(self, link: str) -> Iterator[UrdfJoint]:
        """Yield the next joints beyond a link that are not fixed."""
        for joint in self.below[link]:
            if joint.kind == "fixed":
                yield from self.moving_below(joint.child)
            else:
                yield joint


def read_tree(path: Path) -> UrdfTree:
    """Read the links and joints of a URDF file.
    Raises InputError if the links do not form a tree, or if a value is not a number."""
    robot = parse_xml(path)
    try:
        links = robot.findall("link")
        masses = {_name(link): _mass(link) for link in links}
        joints = tuple(_joint(joint) for joint in robot.findall("joint"))
        if not masses:
            raise ValueError("no <link> elements; expected at least one")
        if len(masses) < len(links) or len({joint.name for joint in joints}) < len(joints):
            raise ValueError("two links or two joints have equal names; expected different names")
        unknown = [end for joint in joints for end in (joint.parent, joint.child) if end not in masses]
        children = [joint.child for joint in joints]
        twice = [link for link in children if children.count(link) > 1]
        roots = [link for link in masses if link not in children]
        if unknown:
            raise ValueError(
                f"a joint refers to an unknown link '{unknown[0]}'; expected one of {choices(unknown[0], masses)}"
            )
        moving = {joint.name for joint in joints if joint.kind in MOVING}
        for joint in joints:
            if joint.mimic and joint.mimic.leader not in moving:
                raise ValueError(
                    f"joint '{joint.name}' mimics '{joint.mimic.leader}', which is no moving joint of the file; "
                    f"expected one of {choices(joint.mimic.leader, sorted(moving))}"
                )
        if twice or len(roots) != 1:
            message = (
                f"'{twice[0]}' is the child of two joints"
                if twice
                else f"{', '.join(roots) or 'none'} without a parent"
            )
            raise ValueError(
                f"links form no tree: {message}; expected one without a parent, and one parent of every other link"
            )
        title = re.fullmatch(rf"[\w .,()+-]{{1,{LONGEST_TITLE}}}", robot.get("name", ""))
        tree = UrdfTree(title[0] if title else "", roots[0], masses, joints)
        if len(tree.frames) < len(masses):
            raise ValueError("joints form a loop; expected a tree")
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: the URDF cannot be read: {error}") from error
    return tree


def origin_of(element: ET.Element) -> Array:
    """Return the transform (4, 4) of an XML element's <origin>. Raises ValueError for an invalid origin."""
    origin = element.find("origin")
    xyz, rpy = ("0 0 0", "0 0 0") if origin is None else (origin.get("xyz", "0 0 0"), origin.get("rpy", "0 0 0"))
    shift, turn = _vector(xyz, "xyz"), _vector(rpy, "rpy")
    for values, dimension in ((shift, "length"), (turn, "angle")):
        for value in values.tolist():
            checked(value, dimension, f"an <origin> of a <{element.tag}>")
    return placement(shift, turn)


def _name(element: ET.Element) -> str:
    if not (name := element.get("name", "")):
        raise ValueError(f"a <{element.tag}> has no name; expected an attribute 'name'")
    return name


def _mass(link: ET.Element) -> tuple[float, Array]:
    inertial = link.find("inertial")
    if inertial is None:
        return 0.0, np.zeros(3)
    mass = inertial.find("mass")
    if mass is None:
        raise ValueError(f"the <inertial> of link '{_name(link)}' has no <mass>; expected a mass in kg")
    value = _number(mass.get("value", ""), "a mass")
    return checked_mass(value, f"link '{_name(link)}' weighs"), origin_of(inertial)[:3, 3]


def _joint(joint: ET.Element) -> UrdfJoint:
    name, kind = _name(joint), joint.get("type", "")
    if kind not in KINDS:
        raise ValueError(f"joint '{name}' is of type '{kind}'; expected one of {', '.join(KINDS)}")
    ends = [joint.find("parent"), joint.find("child")]
    parent, child = ("" if end is None else end.get("link", "") for end in ends)
    axis, mimic, limit = joint.find("axis"), joint.find("mimic"), joint.find("limit")
    vector = _vector("1 0 0" if axis is None else axis.get("xyz", "1 0 0"), f"the axis of joint '{name}'")
    vector = vector / (np.abs(vector).max() or 1.0)
    length = float(np.linalg.norm(vector))
    limits = (-math.inf, math.inf)
    if kind in ("revolute", "prismatic") and (limit is not None or mimic is None):
        if limit is None:
            raise ValueError(f"joint '{name}' has no <limit>; expected lower and upper limit")
        lower, upper = (_number(limit.get(side, "0"), f"the {side} limit of '{name}'") for side in ("lower", "upper"))
        limits = (lower, upper)
        if kind == "revolute":  # some files have a large number for no limit
            limits = (
                -math.inf if lower < -LARGEST["angle"] else lower,
                math.inf if upper > LARGEST["angle"] else upper,
            )
        else:
            for end in limits:
                checked(end, "length", f"a limit of joint '{name}'")
    follows = None if mimic is None else _mimic(mimic, name, "length" if kind == "prismatic" else "angle")
    return UrdfJoint(
        name, kind, parent, child, origin_of(joint), vector / length if length else vector, limits, follows,
        _not_read(joint, name, kind),
    )  # fmt: skip


def _not_read(joint: ET.Element, name: str, kind: str) -> tuple[str, ...]:
    """List the elements of a URDF joint that are not read, and missing elements that get the URDF default."""
    said = [f"<calibration> of joint {name}" for _ in joint.findall("calibration")]
    if kind in MOVING and joint.find("axis") is None:
        said.append(f"the axis of joint {name}, which the file does not give; 1 0 0 is taken, as URDF says")
    return tuple(said)


def _mimic(mimic: ET.Element, name: str, dimension: str) -> Mimic:
    """Return the Mimic joint of a <mimic> element.
    A multiplier larger than the largest length or angle of a machine is refused."""
    multiplier, offset = (
        checked(_number(mimic.get(key, usual), what), dimension, what)
        for key, usual in (("multiplier", "1"), ("offset", "0"))
        for what in [f"the {key} of the <mimic> of joint '{name}'"]
    )
    return Mimic(mimic.get("joint", ""), multiplier, offset)


def _vector(text: str, what: str) -> Array:
    numbers = [_number(part, what) for part in text.split()]
    if len(numbers) != 3:
        raise ValueError(f"{what} is '{text}', expected three numbers")
    return np.array(numbers)


def _number(text: str, what: str) -> float:
    try:
        number = float(text)
    except ValueError:
        raise ValueError(f"{what} is '{text}', expected a number") from None
    if not math.isfinite(number):
        raise ValueError(f"{what} is '{text}', expected a finite number")
    return number

"""URDF files opened with care: what is wrong with one comes as one line."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from gpmodel.errors import InputError
from gpmodel.texts import read_limited

LARGEST_FILE = 16 << 20
"""Bytes; a humanoid with its hands has 0.3 MB."""
MOST_JOINTS = 300
"""Largest number of joints of a chain; a humanoid with its hands has 100."""

ELEMENTS = ("link", "joint", "inertial", "mass", "origin", "parent", "child", "axis", "limit", "mimic", "calibration")
"""That are read; XML tells capital letters from small ones."""


class _Plain(ET.TreeBuilder):
    """Elements alone: a document type, which could define entities that grow without end, is refused."""

    def doctype(self, name: str, public: str | None, system: str | None) -> None:
        """Raises ValueError."""
        raise ValueError(f"document type {name!r}")


def parse_xml(path: Path) -> ET.Element:
    """The <robot> element, comments kept. Raises InputError where the file cannot be a URDF."""
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
            raise InputError(f"{path}: <{tag}> is no element of a URDF; expected <{tag.lower()}>")
    if len(root.findall("joint")) > MOST_JOINTS:
        raise InputError(f"{path}: more than {MOST_JOINTS} joints; expected the description of one machine")
    if any("xacro" in str(element.tag) for element in root.iter()):
        raise InputError(f"{path}: holds xacro macros; expected plain URDF (run `xacro {path.name}` first)")
    return root


def has_geometry(path: Path) -> bool:
    """Return whether any link of the file has collision geometry."""
    return any(link.find("collision/geometry") is not None for link in parse_xml(path).iterfind("link"))

"""URDF files opened with care: what is wrong with one comes as one line, and nothing else is printed."""

from __future__ import annotations

import os
import sys
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pinocchio as pin

from gpmodel.errors import InputError

LARGEST_FILE = 16 << 20
"""Bytes; a humanoid with its hands has 0.3 MB."""
MOST_JOINTS = 300
"""Of which a chain may be made; a humanoid with its hands has 100."""


@dataclass(frozen=True)
class Mimic:
    """A joint that moves with another: motion = multiplier * motion of the leader + offset (rad or m)."""

    leader: str
    multiplier: float
    offset: float


class _Plain(ET.TreeBuilder):
    """Elements alone: a document type, which could define entities that grow without end, is refused."""

    def doctype(self, name: str, public: str | None, system: str | None) -> None:
        """Raises ValueError."""
        raise ValueError(f"document type {name!r}")


def parse_xml(path: Path) -> ET.Element:
    """The <robot> element, comments kept. Raises InputError where the file cannot be a URDF."""
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise InputError(f"{path}: larger than {LARGEST_FILE >> 20} MB; expected a URDF file")
        root = ET.parse(path, ET.XMLParser(target=_Plain(insert_comments=True))).getroot()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); expected a URDF file") from error
    except (ET.ParseError, ValueError, LookupError) as error:
        raise InputError(f"{path}: not well-formed XML ({error}); expected a URDF file") from error
    if root.tag != "robot":
        raise InputError(f"{path}: the root element is <{root.tag}>, expected <robot> as in a URDF file")
    if len(root.findall("joint")) > MOST_JOINTS:
        raise InputError(f"{path}: more than {MOST_JOINTS} joints; expected the description of one machine")
    if any("xacro" in str(element.tag) for element in root.iter()):
        raise InputError(f"{path}: holds xacro macros; expected plain URDF (run `xacro {path.name}` first)")
    return root


def parse_mimics(path: Path) -> dict[str, Mimic]:
    """Every mimic joint by name. Raises InputError where the file cannot be a URDF."""
    joints = parse_xml(path).findall("joint")
    try:
        return {
            joint.get("name", ""): Mimic(
                mimic.get("joint", ""),
                float(mimic.get("multiplier", "1")),
                float(mimic.get("offset", "0")),
            )
            for joint in joints
            if (mimic := joint.find("mimic")) is not None
        }
    except ValueError as error:
        raise InputError(f"{path}: a <mimic> element has no number ({error}); expected a URDF file") from error


def parse_model(path: Path) -> pin.Model:
    """Pinocchio's model of the file, no mesh opened. Raises InputError with the parser's first complaint, also where it
    would go on without the inertia that it complains of."""
    try:
        with _quiet() as said:
            model = pin.buildModelFromUrdf(str(path))
        if any("inertial" in line for line in said):
            raise ValueError(said)
        return model
    except (ValueError, RuntimeError) as error:
        complaint = next((line for line in said if line.strip()), str(error).splitlines()[0])
        raise InputError(
            f"{path}: not a URDF that can be read ({complaint.strip().removeprefix('Error:').strip()})"
        ) from error


@contextmanager
def _quiet() -> Iterator[list[str]]:
    """Keeps what C libraries print off the terminal; the lines are in the yielded list afterwards."""
    lines: list[str] = []
    sys.stdout.flush()
    sys.stderr.flush()
    kept = [os.dup(1), os.dup(2)]
    with tempfile.TemporaryFile("w+", errors="replace") as sink:
        try:
            os.dup2(sink.fileno(), 1)
            os.dup2(sink.fileno(), 2)
            yield lines
        finally:
            for stream, copy in zip((1, 2), kept, strict=True):
                os.dup2(copy, stream)
                os.close(copy)
            sink.seek(0)
            lines.extend(sink)

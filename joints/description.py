"""A joint as a TOML file describes it: its rotations, its lever, its balls, which of its angles are measured.

    kind = "spherical"             # or "universal"; what is left out is as joints/data/<kind>_joint.toml has it
    name = "leg 3, upper joint"

    [tooling_ball]
    centre = ["0 mm", "0 mm", "60 mm"]

`gpmodel joint mechanism --defaults` prints a whole one. Sections of the design studies (`[preload]`, `[film]`, ...)
may stand in the same file; they are `gpmodel joint design`'s.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gpmodel.errors import InputError
from joints.passive_joint import PassiveJoint, Rotation, vector
from joints.settings import Settings, laid_over, load_settings, positive, read_toml

KINDS = ("spherical", "universal")
"""Kinds of a single joint; `hexapod` and `tau` are machines of twelve (joints.hexapod, joints.tau)."""

SECTIONS = ("preload", "contact", "thermal", "film", "stiffness", "dynamics", "budget", "demand")
"""Sections of the file that `gpmodel joint design` reads."""


def kind_of(path: Path) -> Any:
    """Return the kind of mechanism that a TOML file describes; None for a table of Denavit-Hartenberg rows."""
    return read_toml(path).get("kind")


def spherical_joint() -> PassiveJoint:
    """The thesis' joint on its test rig."""
    return _built(load_settings("spherical_joint"), "spherical_joint.toml")


def read_joint(path: Path) -> PassiveJoint:
    """The joint of a TOML file.

    Raises InputError: no such kind, an unknown key, a missing unit, no lever, a ball that falls through its socket's
    opening, a tooling ball inside the ball, rotations that are not two or three about different axes.
    """
    given = read_toml(path)
    kind = given.get("kind")
    if kind not in KINDS:
        raise InputError(f"{path.name}: kind = {kind!r}, expected 'spherical', 'universal', 'hexapod' or 'tau'")
    own = {key: value for key, value in given.items() if key not in SECTIONS}
    joint = _built(laid_over(f"{kind}_joint", own, path.name), path.name)
    return joint if "name" in given else replace(joint, name=path.stem)


def _built(s: Settings, file: str) -> PassiveJoint:
    centre, radius = vector(s["tooling_ball"]["centre"]), s["tooling_ball"]["diameter"] / 2
    positive(f"{file}: tooling_ball.diameter", 2 * radius, "m")
    lever = float(np.linalg.norm(centre))
    if not lever > 1e-6:
        raise InputError(f"{file}: tooling_ball.centre is {lever:g} m from the joint's centre; expected a lever")
    if "ball" in s:
        _check_ball(s, lever, file)
    rotations = tuple(_rotation(entry, f"{file}: rotation[{i}]") for i, entry in enumerate(s["rotation"]))
    return PassiveJoint(centre, rotations, vector(s["gravity"]), name=s["name"])


def _check_ball(s: Settings, lever: float, file: str) -> None:
    ball, opening = s["ball"]["diameter"], s["socket"]["opening"]
    positive(f"{file}: ball.diameter", ball, "m")
    positive(f"{file}: socket.opening", opening, "m")
    if opening >= ball:
        raise InputError(
            f"{file}: ball.diameter = {1e3 * ball:g} mm falls through socket.opening = {1e3 * opening:g} mm; "
            "expected a larger ball"
        )
    reach = (ball + s["tooling_ball"]["diameter"]) / 2
    if lever < reach:
        raise InputError(
            f"{file}: tooling_ball.centre is {1e3 * lever:g} mm from the joint's centre, inside the ball; "
            f"expected at least {1e3 * reach:g} mm"
        )


def _rotation(entry: dict[str, Any], where: str) -> Rotation:
    if entry["axis"] not in ("x", "y", "z"):
        raise InputError(f"{where}.axis = '{entry['axis']}', expected x, y or z")
    if not entry["lower"] < entry["upper"]:
        lower, upper = np.degrees([entry["lower"], entry["upper"]])
        raise InputError(f"{where}: lower = {lower:g} deg, expected below upper = {upper:g} deg")
    return Rotation(entry["name"], entry["axis"], entry["lower"], entry["upper"], entry["measured"])

"""A Tau robot as a TOML file describes it: three actuators, six links between their balls, the measured point."""

from pathlib import Path

import numpy as np

from gpmodel.errors import InputError
from gpmodel.numerics import se3
from joints.hexapod_description import described, held
from joints.limits import require
from joints.passive_joint import vector
from joints.settings import Settings
from joints.tau import ARMS, Actuator, Tau

KIND = "tau"
DRIVES = {"turned": ("revolute", "turn"), "pushed": ("prismatic", "travel")}
"""What an actuator is in the table of its joint, and where its range stands."""

AXES = {"x": np.eye(3)[:, [1, 2, 0]], "y": np.eye(3)[:, [2, 0, 1]], "z": np.eye(3)}
"""Frames whose z is that axis of the base."""


def tau(path: Path | None = None) -> Tau:
    """The Tau robot of a TOML file, the built-in one without.

    Raises InputError: an unknown key, a missing unit, another number of actuators or links than three and six, a range
    without zero inside, links that leave the platform loose.
    """
    return described(KIND, path, _built)


def _built(s: Settings, file: str) -> Tau:
    for key, count in (("actuator", 3), ("link", len(ARMS))):
        if len(s[key]) != count:
            raise InputError(f"{file}: {len(s[key])} tables [[{key}]], expected {count}: links 1 to 3 on the first "
                             "actuator, 4 and 5 on the second, 6 on the third")  # fmt: skip
    first, second, third = (_actuator(entry, f"{file}: actuator[{i}]") for i, entry in enumerate(s["actuator"]))
    base, platform = (np.array([vector(link[end]) for link in s["link"]]) for end in ("base", "platform"))
    machine = Tau(
        actuators=(first, second, third), start=vector(s["start"]), name=s["name"], base=base, platform=platform,
        tool=vector(s["tool"]["centre"]), mass=s["platform"]["mass"], gravity=vector(s["gravity"]),
    )  # fmt: skip
    require(machine.lengths > 0, f"{file}: length of a link [m]", machine.lengths, "above 0")
    return held(machine, file)


def _actuator(entry: Settings, where: str) -> Actuator:
    if entry["drive"] not in DRIVES:
        raise InputError(f"{where}.drive = '{entry['drive']}', expected turned or pushed")
    if entry["axis"] not in AXES:
        raise InputError(f"{where}.axis = '{entry['axis']}', expected x, y or z")
    kind, key = DRIVES[entry["drive"]]
    lower, upper = entry[key][0], entry[key][-1]
    if len(entry[key]) != 2 or not lower < 0.0 < upper:
        raise InputError(
            f"{where}.{key}: {len(entry[key])} values from {lower:g} to {upper:g}, expected the lowest and the highest "
            "coordinate, zero between them"
        )
    frame = se3.frame(AXES[entry["axis"]], vector(entry["at"]))
    return Actuator(kind, frame @ se3.along(5, np.array([entry["stands"]]))[0], lower, upper)

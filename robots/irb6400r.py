"""The ABB IRB 6400R, built from its published dimensions."""

import numpy as np

from gpmodel.numerics.se3 import shift
from robots.chain import SerialChain
from robots.links import Link

DIMENSIONS = {
    "irb6400r": {"d1": 0.800, "a1": 0.240, "a2": 1.050, "a3": 0.225, "d4": 1.175, "d6": 0.200},
    "irb6400r-2.8": {"d1": 0.800, "a1": 0.240, "a2": 1.050, "a3": 0.225, "d4": 1.520, "d6": 0.200},
}
LIMITS_DEG = ((-180, 180), (-70, 85), (-28, 110), (-300, 300), (-120, 120), (-300, 300))
AXES = ("Rz", "Ry", "Ry", "Rx", "Ry", "Rx")
SURROGATE_MASSES = (262.6, 156.2, 149.3, 10.2, 17.7, 41.5)


def irb6400r(name: str = "irb6400r") -> SerialChain:
    """The arm `irb6400r` (2.5-150) or `irb6400r-2.8` (2.8-200), measured at its flange.

    All frames are parallel to the root frame at zero; axes Z Y Y X Y X. The table's J3 is the angle of the
    upper arm to the ground, held by the parallel bar:  motion of link 3 = J3 - J2.

    No masses of this arm are published. Those here are of an arm of the same size (FANUC R-2000iC), and each
    centre of mass is put midway between its joint's origin and the next (the flange, for the last).
    """
    size = DIMENSIONS[name]
    origins = np.array(
        [
            [0.0, 0.0, 0.0],
            [size["a1"], 0.0, size["d1"]],
            [0.0, 0.0, size["a2"]],
            [0.0, 0.0, size["a3"]],
            [size["d4"], 0.0, 0.0],
            [0.0, 0.0, 0.0],
            [size["d6"], 0.0, 0.0],
        ]
    )
    links = tuple(
        Link(f"J{i + 1}", shift(origins[i]), axis, mass, origins[i + 1] / 2)
        for i, (axis, mass) in enumerate(zip(AXES, SURROGATE_MASSES, strict=True))
    )
    coupling = np.eye(6)
    coupling[2, 1] = -1.0
    return SerialChain(
        name=name,
        links=links,
        tool=shift(origins[6]),
        joint_names=tuple(link.name for link in links),
        coupling=coupling,
        limits=np.radians(LIMITS_DEG),
        tool_frame="flange",
    )

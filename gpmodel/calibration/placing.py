"""Sensitivity of every observation to placement: registration, tool, and the instruments' unknowns."""

import numpy as np

from gpmodel.arrays import Array
from gpmodel.mechanism.protocol import AXES
from gpmodel.model.error_model import Placement, Poses
from gpmodel.model.observed import Observed
from gpmodel.numerics import se3


def placement_columns(poses: Poses, observed: Observed, placement: Placement) -> tuple[list[Array], list[str]]:
    """Columns (N, m, P) of registration, tool and what instruments have of their own, in blocks, and their names."""
    data = poses.dataset
    blocks: list[Array] = []
    names: list[str] = []
    if any(kind.absolute for kind in observed.kinds):
        turn = observed.registration_sensitivity(observed.tip[:, :3, 3].mean(axis=0))
        for name in placement.registration:
            blocks.append(turn * (data.label("setup") == name)[:, None, None])
            names += [f"registration{f' {name}' if name else ''} {axis}" for axis in AXES]
    axes = _tool_axes(observed)
    tool = observed.tool_sensitivity()[:, :, :axes]
    for name in placement.tool:
        blocks.append(tool * (data.label("tool") == name)[:, None, None])
        names += [f"tool{f' {name}' if name else ''} {axis}" for axis in AXES[:axes]]
    for kind in observed.kinds:
        if kind.own:
            blocks.append(observed.own_sensitivity(kind))
            names += [f"{key} {own}" for key, each in kind.own.items() for own in each]
    return blocks, names


def _tool_axes(observed: Observed) -> int:
    """Return the number of observable components of the tool's pose: 3 for its point, 6 with orientation."""
    return 6 if any(kind.oriented for kind in observed.kinds) else 3


def placement_after(observed: Observed, placement: Placement, step: Array) -> Placement:
    """The placement moved by a step (P,), m and rad, of the columns `linearise` gives it, in their order.

    Registrations turn about the middle of the predicted points, tools in their own axes; orientations stay rotations.
    """
    i = 0
    registration, tool, anchors = dict(placement.registration), dict(placement.tool), dict(placement.anchors)
    centre = observed.tip[:, :3, 3].mean(axis=0)
    if any(kind.absolute for kind in observed.kinds):
        for name, frame in registration.items():
            registration[name] = se3.shift(centre) @ se3.exp(step[i : i + 6]) @ se3.shift(-centre) @ frame
            i += 6
    axes = _tool_axes(observed)
    for name, frame in tool.items():
        twist = np.zeros(6)
        twist[:axes] = step[i : i + axes]
        tool[name] = frame @ se3.exp(twist)
        i += axes
    for kind in observed.kinds:
        for key, names in kind.own.items():
            anchors[key] = kind.moved(key, observed.own[key], step[i : i + len(names)])
            i += len(names)
    return Placement(registration, tool, anchors)

"""Initial values of a fit: registration and tool point in closed form, then the unknowns of each instrument."""

from collections.abc import Iterator

import numpy as np
from scipy import optimize

from gpmodel.arrays import Array, IntArray
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import AXES
from gpmodel.model.error_model import Placement, Poses
from gpmodel.model.observation import Tips, observations
from gpmodel.model.observed import Observed
from gpmodel.model.touches import Touches
from gpmodel.numerics import se3
from gpmodel.table.dataset import Dataset


def placement_columns(poses: Poses, observed: Observed, placement: Placement) -> tuple[list[Array], list[str]]:
    """Return the derivatives of each pose's measurements with respect to the unknowns of registration, tool and
    instruments, in blocks, and the names of the unknowns."""
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
    """Return registration and tool after a step, m and rad, in the order of the columns of `placement_columns`.

    Registrations rotate about the mean of the predicted points, tools about their own axes. Rotations stay orthonormal.
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


START_POSES = 400
"""Largest number of poses used for the initial values. The fit after the initial values uses all poses."""

TOOL_PULL = 1e-4
"""Penalty on the distance of the tool point from the flange, m of error per m. The penalty matters only if the poses do
not determine the tool point."""

GOOD_START = 1e-4
"""RMS error, m, of initial values below which no further initial values are tried. Poses in one plane have a mirrored
solution, which fits far worse."""

TRIED_TOOLS = np.vstack([np.zeros(3), *(0.15 * sign * axis for axis in np.eye(3) for sign in (1.0, -1.0))])
"""Initial tool points of a calibration, m: the flange, and 0.15 m from the flange in each direction."""


def start_placements(poses: Poses) -> Iterator[Placement]:
    """Yield initial values: registration by Kabsch for each trial tool point, tool points by least squares.

    If only balls were touched, every trial tool point gives one start, because the fit has several local minima: a ball
    of unknown position fits another tool with another radius. Initial values without a valid ball are skipped.
    The unknowns of each instrument are initialised from the predicted tips. Raises InputError if a set-up has fewer
    than 3 measured poses, or an instrument has too few measurements for its unknowns.
    """
    data = poses.dataset
    slots = se3.chain(poses.transforms)
    frames = slots[poses.tip_slot, np.arange(len(poses))]
    setups, setup = data.codes("setup")
    tools, tool = data.codes("tool")
    measured = np.asarray(np.isfinite(data.position).all(axis=1))
    if not measured.any():
        registration = {name: np.eye(4) for name in setups}
        for i, tried in enumerate(TRIED_TOOLS if _balls(data) else TRIED_TOOLS[:1]):
            try:
                yield _with_tools(poses, slots, registration, np.tile(tried, (len(tools), 1)))
            except InputError:
                if not i:
                    raise
        return
    for i, name in enumerate(setups):
        if (count := int(measured[setup == i].sum())) < 3:
            label = f"{data.source}, setup '{name}'" if name else data.source
            raise InputError(f"{label}: {count} poses with x, y and z; registration needs at least 3")
    rows = np.flatnonzero(measured)
    fit_rows = rows[:: max(1, len(rows) // START_POSES)]
    points = _tool_points(frames, data.position, setup, tool, fit_rows, len(tools))
    tips = _tips(frames, points, tool)
    registration = {}
    for i, name in enumerate(setups):
        chosen = measured & (setup == i)
        turn, shift = se3.fit_rotation(tips[chosen], data.position[chosen])
        registration[name] = se3.frame(turn, shift)
    yield _with_tools(poses, slots, registration, points)


def _balls(data: Dataset) -> bool:
    """Return whether any measurement touched a spherical surface."""
    touches = (kind for kind in observations(data) if isinstance(kind, Touches))
    return any(f.surface == "on_sphere" for kind in touches for body in kind.bodies for f in body.features)


def _with_tools(poses: Poses, slots: Array, registration: dict[str, Array], points: Array) -> Placement:
    """Add the unknowns of the instruments to given registrations and tool points, m.

    The orientations of the tools are the measured orientations. slots: frames of the nominal mechanism at every pose.
    """
    data, frames = poses.dataset, slots[poses.tip_slot, np.arange(len(poses))]
    tool_frames = {name: se3.shift(point) for name, point in zip(data.codes("tool")[0], points, strict=True)}
    if data.has_rotation:
        tool_frames = _turn_tools(poses, frames, registration, tool_frames)
    root = frames @ np.stack([tool_frames[name] for name in data.label("tool").tolist()])
    register = np.stack([registration[name] for name in data.label("setup").tolist()])
    predicted = Tips(root, register @ root, slots)
    own: dict[str, Array] = {}
    for kind in observations(data):
        try:
            own |= kind.start(predicted)
        except InputError as error:
            raise InputError(f"{data.source}: {error.said}") from None
    return Placement(registration, tool_frames, own)


def _tips(frames: Array, points: Array, tool: IntArray) -> Array:
    return frames[:, :3, 3] + (frames[:, :3, :3] @ points[tool][:, :, None])[..., 0]


def _tool_points(frames: Array, position: Array, setup: IntArray, tool: IntArray, rows: IntArray, count: int) -> Array:
    frames, tool = frames[rows], tool[rows]
    of_setup = [setup[rows] == i for i in np.unique(setup[rows])]
    parts = [(chosen, position[rows][chosen]) for chosen in of_setup]

    def misfit(flat: Array) -> Array:
        tips = _tips(frames, flat.reshape(count, 3), tool)
        out = np.empty_like(tips)
        for chosen, measured in parts:
            seen = tips[chosen]
            turn, shift = se3.fit_rotation(seen, measured)
            out[chosen] = measured - seen @ turn.T - shift
        return np.append(out.ravel(), TOOL_PULL * flat)

    moved = np.einsum("nij,nt->nitj", frames[:, :3, :3], np.eye(count)[tool]).reshape(len(frames), 3, -1)

    def derivative(flat: Array) -> Array:
        tips = _tips(frames, flat.reshape(count, 3), tool)
        out = np.empty_like(moved)
        for chosen, measured in parts:
            turn, _ = se3.fit_rotation(tips[chosen], measured)
            out[chosen] = -se3.without_registration(tips[chosen] @ turn.T, turn @ moved[chosen])
        return np.vstack([out.reshape(-1, 3 * count), TOOL_PULL * np.eye(3 * count)])

    best = None
    for tried in TRIED_TOOLS:
        found = optimize.least_squares(
            misfit, np.tile(tried, count), derivative, method="trf", x_scale=0.1, max_nfev=30
        )
        if best is None or found.cost < best.cost:
            best = found
        if np.sqrt(2 * best.cost / len(rows)) < GOOD_START:
            break
    assert best is not None
    return np.asarray(best.x.reshape(count, 3))


def _turn_tools(
    poses: Poses, frames: Array, registration: dict[str, Array], tools: dict[str, Array]
) -> dict[str, Array]:
    data = poses.dataset
    seen = np.isfinite(data.rotation).all(axis=1)
    out = {}
    for name, frame in tools.items():
        chosen = seen & (data.label("tool") == name)
        register = np.stack([registration[s] for s in data.label("setup")[chosen].tolist()])
        flange = register[:, :3, :3] @ frames[chosen, :3, :3]
        twists = np.hstack([np.zeros((int(chosen.sum()), 3)), data.rotation[chosen]])
        mean = (np.swapaxes(flange, 1, 2) @ se3.exp(twists)[:, :3, :3]).mean(axis=0)
        out[name] = se3.frame(se3.nearest_rotation(mean), frame[:3, 3])
    return out

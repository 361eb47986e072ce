"""Contract checks of a mechanism (frames, transforms, drives, loads) and of a representation of programs."""

from collections.abc import Callable, Sequence

import numpy as np

from gpmodel.arrays import Array
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.projection import regression
from gpmodel.evolution.representation import Representation, program_of
from gpmodel.evolution.search import evolve
from gpmodel.evolution.settings import Budget, Settings
from gpmodel.mechanism.branches import random_poses
from gpmodel.mechanism.protocol import AXES, ClosedLoops, Mechanism, closed
from gpmodel.numerics.se3 import chain, hat, right_jacobian


def check_representation(representation: Representation, *, population: int = 64, seed: int = 0) -> None:
    """Check a representation of programs: initial programs, breeding, and a search for a simple formula.

    Populations of programs have the requested size. `take` and `join` do not change programs. The result of a search
    depends on the seed alone. The search finds a - b, which differs from b - a.
    """
    rng = np.random.default_rng(seed)
    inputs = Inputs(("a", "b"), rng.normal(size=(2, 40)))
    layout = representation.layout(inputs, ())
    first, again = (representation.initial(layout, population, np.random.default_rng(seed)) for _ in range(2))
    assert len(first) == population, f"initial returns {len(first)} programs, expected {population}"
    rows = np.arange(population)
    children = representation.offspring(layout, first, rows, rows[::-1].copy(), np.random.default_rng(seed + 1))
    assert len(children) == population, f"offspring returns {len(children)} children, expected {population}"
    text = [str(program_of(first, row, layout)) for row in range(population)]
    assert text == [str(program_of(again, row, layout)) for row in range(population)], (
        "two calls of initial with one seed differ; expected equal programs"
    )
    moved = first.take(rows[::-1].copy()).join(first)
    there = [str(program_of(moved, row, layout)) for row in (0, population)]
    assert there == [text[-1], text[0]], "take and join change programs; expected unchanged programs"
    _check_search(representation, inputs, seed)


def _check_search(representation: Representation, inputs: Inputs, seed: int) -> None:
    law = inputs["a"] - inputs["b"]
    problem = SlotProblem(inputs, regression(law))
    settings = Settings(representation, budget=Budget(256, 20, seconds=1e9))
    best = [evolve(problem, settings, np.random.default_rng(seed)).best for _ in range(2)]
    assert str(best[0].program) == str(best[1].program), "two searches with one seed differ; expected equal programs"
    assert best[0].gain > 0.999, f"a - b is not found by 256 programs in 20 generations: {best[0].program}"


PAYLOAD = 10.0
"""Payload in the check of a mechanism, kg, large enough for its weight to be visible in the loads."""
DOWN = (0.0, 0.0, -1.0)
"""Default direction of gravity in the root frame of a checked mechanism."""
ERROR, STEP = 1e-3, 1e-5
"""Errors of a checked mechanism, m and rad, larger than a machine's; step of central differences, with errors of
1e-10."""

GRAVITY = (9.7, 9.9)
"""Range of gravity on Earth, m/s²: 9.780 at the equator, 9.832 at the poles, and a margin."""


def check_mechanism(mechanism: Mechanism, *, down: Sequence[float] = DOWN, poses: int = 12, seed: int = 0) -> None:
    """Check the frames (slots), transforms, drives and loads of a mechanism, signs included.

    down: direction of gravity in the root frame.
    Slots are base, both sides of each joint, and tool. Transforms are rigid and independent of other poses. A drive is
    the derivative of the pose with respect to its joint value. A payload adds its weight times its lever arms to the
    loads; its torque about a joint is minus the slope of its potential energy. With closed loops, the motion of the
    tool by a further error twist is checked too, with errors at every frame.
    """
    q = random_poses(mechanism, poses, np.random.default_rng(seed))
    _check_slots(mechanism)
    _check_transforms(mechanism, q)
    _check_drives(mechanism, q)
    if loops := closed(mechanism):
        _check_loops(mechanism, loops, q, np.random.default_rng(seed))
    _check_loads(mechanism, q, np.asarray(down, dtype=float) / np.linalg.norm(down))


def _check_slots(mechanism: Mechanism) -> None:
    slots = mechanism.slots
    assert (slots[0], slots[-1]) == ("base", "tool"), f"slots {slots}: expected 'base' first and 'tool' last"
    assert len(set(slots)) == len(slots), f"slots {slots}: expected different names"
    for joint in mechanism.joints:
        assert joint.kind in ("revolute", "prismatic"), (
            f"{joint.name}: kind '{joint.kind}', expected 'revolute' or 'prismatic'"
        )
        assert joint.lower < joint.upper, f"{joint.name}: the lower limit is not below the upper limit"
        assert joint.drive, f"{joint.name}: has no drive; expected a slot and axis that the joint value moves"
        for side in ("fixed", "moving"):
            assert f"{joint.name}.{side}" in slots, f"{joint.name}: slot '{joint.name}.{side}' is missing"
        for slot, axis, _ in joint.drive:
            assert slot in slots, f"{joint.name}: the drive acts at '{slot}', expected a slot of the mechanism"
            assert axis in AXES, f"{joint.name}: the drive acts along '{axis}', expected one of {AXES}"


def _check_transforms(mechanism: Mechanism, q: Array) -> None:
    transforms = mechanism.transforms(q)
    expected = (len(mechanism.slots), len(q), 4, 4)
    assert transforms.shape == expected, f"transforms have shape {transforms.shape}, expected {expected}"
    turns = transforms[..., :3, :3]
    orthogonal = np.allclose(turns @ np.swapaxes(turns, -1, -2), np.eye(3), atol=1e-9)
    assert orthogonal, "transforms are not rigid: a rotation is not orthogonal"
    assert np.allclose(np.linalg.det(turns), 1.0), "transforms are not rigid: a rotation is a mirror"
    assert np.allclose(transforms[..., 3, :], (0, 0, 0, 1)), "transforms: expected the last row (0, 0, 0, 1) in each"
    alone = mechanism.transforms(q[1:2])
    assert np.allclose(alone, transforms[:, 1:2], atol=1e-12), "transforms of a pose depend on the other poses"


def _check_drives(mechanism: Mechanism, q: Array) -> None:
    frames, loops = chain(mechanism.transforms(q)), closed(mechanism)

    tool: Array = frames[-1]

    def rate(slot: int, axis: str) -> Array:
        if loops:
            return tool @ _twisted(loops.carried(frames, slot)[:, :, AXES.index(axis)])
        turned: Array = frames[slot] @ _twisted(np.eye(6)[None, AXES.index(axis)])
        return turned @ np.linalg.inv(frames[slot]) @ tool

    for column, joint in enumerate(mechanism.joints):
        numeric = _slope(lambda at: chain(mechanism.transforms(at))[-1], q, column)
        rates = (weight * rate(mechanism.slots.index(slot), axis) for slot, axis, weight in joint.drive)
        miss = np.abs(sum(rates) - numeric).max()
        assert miss < 1e-6, (
            f"{joint.name}: a small change of the joint value moves the tool by another amount than the drive; "
            f"difference {miss:.2g} per unit (a sign, an axis, or the side of the motion)"
        )


def _check_loops(mechanism: Mechanism, loops: ClosedLoops, q: Array, rng: np.random.Generator) -> None:
    places = range(len(mechanism.slots))
    assert {slot for slot, _ in loops.constants} <= set(mechanism.slots), (
        "constants act at unknown slots; expected slots of the mechanism"
    )
    straight, frames = loops.assembled(q, {}), chain(mechanism.transforms(q))
    assert np.allclose(straight, frames, atol=1e-9), "without errors the closed loops differ from the transforms"
    twists = {slot: ERROR * rng.normal(size=(len(q), 6)) for slot in places}
    frames = loops.assembled(q, twists)
    for slot in places:
        carried = loops.carried(frames, slot) @ right_jacobian(twists[slot])
        for k, axis in enumerate(AXES):
            step = np.zeros(6)
            step[k] = STEP
            ends = [loops.assembled(q, {**twists, slot: twists[slot] + d})[-1] for d in (step, -step)]
            miss = np.abs((ends[0] - ends[1]) / (2 * STEP) - frames[-1] @ _twisted(carried[:, :, k])).max()
            assert miss < 1e-6, (
                f"{mechanism.slots[slot]} {axis}: an error moves the tool otherwise than carried, {miss:.2g}"
            )


def _check_loads(mechanism: Mechanism, q: Array, down: Array) -> None:
    bare, loaded = (mechanism.loads(q, np.full(len(q), mass)) for mass in (0.0, PAYLOAD))
    added = {name: values - bare.get(name, np.zeros(len(q))) for name, values in loaded.items()}
    assert added, "loads are empty with a payload: a payload needs no masses of the links"
    missing = {f"torque_{j.name}" for j in mechanism.joints} - set(added)
    assert not missing, f"loads do not contain {sorted(missing)}"
    base = chain(mechanism.transforms(q))[0]
    force, moment = (
        np.einsum("nij,nj->ni", base[:, :3, :3], np.column_stack([added[f"{kind}_base_{a}"] for a in "xyz"]))
        for kind in ("force", "moment")
    )
    weight = force / PAYLOAD
    size = np.linalg.norm(weight, axis=1)
    assert ((size > GRAVITY[0]) & (size < GRAVITY[1])).all(), (
        f"a payload of {PAYLOAD:g} kg adds {PAYLOAD * size.mean():.4g} N at the base, expected the weight"
    )
    assert np.allclose(weight / size[:, None], down, atol=1e-3), (
        f"the force of a payload on the base points along {np.round(weight[0] / size[0], 3).tolist()} of the root, "
        f"expected along gravity, {down.tolist()} (the sign of loads, or another mounting: argument `down`)"
    )
    centre = _payload_centre(mechanism, q, base, moment, weight)
    for column, joint in enumerate(mechanism.joints):
        height = _slope(lambda at: _payload_point(mechanism, at, centre), q, column)
        work = PAYLOAD * np.einsum("ni,ni->n", height, weight)
        miss = np.abs(added[f"torque_{joint.name}"] - work).max()
        assert miss < 1e-4 * PAYLOAD * 10.0, (
            f"torque_{joint.name} of a payload differs from minus the derivative of the potential energy by "
            f"{miss:.3g} of {np.abs(work).max():.3g} (positive where gravity pushes the coordinate up)"
        )


def _payload_centre(mechanism: Mechanism, q: Array, base: Array, moment: Array, weight: Array) -> Array:
    """Return the centre c of mass of a payload in the tool frame, m, from (p + R c - o) × m g = moment."""
    tool = chain(mechanism.transforms(q))[-1]
    arm = tool[:, :3, 3] - base[:, :3, 3]
    left = moment / PAYLOAD - np.cross(arm, weight)
    columns = np.cross(np.swapaxes(tool[:, :3, :3], 1, 2), weight[:, None, :]).swapaxes(1, 2)
    centre: Array = np.linalg.lstsq(columns.reshape(-1, 3), left.ravel(), rcond=None)[0].astype(np.float64)
    miss = np.abs(columns.reshape(-1, 3) @ centre - left.ravel()).max()
    assert miss < 1e-6, "moments of a payload at the base differ from weight times a lever arm fixed to the tool"
    return centre


def _payload_point(mechanism: Mechanism, q: Array, centre: Array) -> Array:
    tool: Array = chain(mechanism.transforms(q))[-1]
    return tool[:, :3, 3] + tool[:, :3, :3] @ centre


def _slope(function: Callable[[Array], Array], q: Array, column: int) -> Array:
    step = np.zeros(q.shape[1])
    step[column] = 1e-6
    return (function(q + step) - function(q - step)) / 2e-6


def _twisted(twists: Array) -> Array:
    """Return the matrices of twists, m and rad, whose matrix exponentials are rigid motions."""
    out = np.zeros((len(twists), 4, 4))
    out[:, :3, :3], out[:, :3, 3] = hat(twists[:, 3:]), twists[:, :3]
    return out

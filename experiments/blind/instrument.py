"""Simulate errors of a laser tracker at the origin of its frame, with z along its standing axis.

p = r (cos el cos az, cos el sin az, sin el). An effect of the robot that replaces such an error is a false finding.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from experiments.blind.shapes import Motion, Shape, World, fixed, mixed, shift
from experiments.blind.simulator import Arm, Array


def polar(point: Array) -> tuple[Array, Array, Array]:
    """Range (N,), azimuth (N,) and elevation (N,) of points (N, 3)."""
    flat = np.hypot(point[:, 0], point[:, 1])
    return np.linalg.norm(point, axis=1), np.arctan2(point[:, 1], point[:, 0]), np.arctan2(point[:, 2], flat)


def along_azimuth(point: Array, angle: Array) -> Array:
    """(N, 3) shift of a point by a small angle of azimuth."""
    return angle[:, None] * np.column_stack([-point[:, 1], point[:, 0], np.zeros(len(point))])


def along_elevation(point: Array, angle: Array) -> Array:
    """(N, 3) shift of a point by a small angle of elevation."""
    distance, azimuth, elevation = polar(point)
    down = -np.sin(elevation)
    tangent = np.column_stack([down * np.cos(azimuth), down * np.sin(azimuth), np.cos(elevation)])
    return (angle * distance)[:, None] * tangent


def _of_instrument(shape: Shape, words: tuple[str, ...]) -> Shape:
    named = [*shape.named, *[[f"*{w}*"] for w in (*words, "tracker", "instrument")]]
    called = [f"*{w}*" for w in (*words, "tracker", "instrument")]
    return replace(shape, named=named, called=called, place="instrument")


def range_scale(arm: Arm, rng: np.random.Generator) -> Shape:
    """Every distance a little too long: the same robot in a larger size, hidden in its geometry."""
    return _of_instrument(fixed(lambda w: shift(w.point), []), ("range", "scale"))


def range_offset(arm: Arm, rng: np.random.Generator) -> Shape:
    """Every distance too long by the same length."""
    return _of_instrument(fixed(lambda w: shift(w.point / polar(w.point)[0][:, None]), []), ("range", "distance"))


def azimuth_eccentric(arm: Arm, rng: np.random.Generator) -> Shape:
    """The encoder of the standing axis runs out: once per turn."""
    phase = rng.uniform(0, 2 * np.pi)

    def basis(w: World) -> list[Motion]:
        azimuth = polar(w.point)[1]
        return [shift(along_azimuth(w.point, wave(azimuth))) for wave in (np.sin, np.cos)]

    shape = mixed(basis, np.array([np.cos(phase), np.sin(phase)]), [], phase=phase)
    return _of_instrument(shape, ("azimuth",))


def elevation_index(arm: Arm, rng: np.random.Generator) -> Shape:
    """The zero of the elevation is off."""
    return _of_instrument(
        fixed(lambda w: shift(along_elevation(w.point, np.ones(len(w.q)))), []), ("elevation", "index")
    )


def instrument_field(arm: Arm, rng: np.random.Generator, waves: int = 3) -> Shape:
    """A smooth error over space: each coordinate is off by a few waves of 1.5 to 4 m length."""
    directions = rng.normal(size=(waves, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    numbers = 2 * np.pi * directions / rng.uniform(1.5, 4.0, (waves, 1))
    weights = rng.normal(size=6 * waves)

    def basis(w: World) -> list[Motion]:
        phases = w.point @ numbers.T
        return [
            shift(wave(phase)[:, None] * axis) for wave in (np.sin, np.cos) for phase in phases.T for axis in np.eye(3)
        ]

    return _of_instrument(mixed(basis, weights, [[a] for a in "xyz"]), ("field", "smooth"))


def instrument_drift(arm: Arm, rng: np.random.Generator) -> Shape:
    """The instrument creeps during the session and comes back in part: a ramp and half a wave along the rows."""
    weights = rng.normal(size=6)

    def basis(w: World) -> list[Motion]:
        forms = (w.row, np.sin(np.pi * w.row))
        return [shift(form[:, None] * axis) for form in forms for axis in np.eye(3)]

    return _of_instrument(mixed(basis, weights, [["row"], ["time"]]), ("drift", "creep", "set-up"))


KINDS: tuple[Callable[..., Shape], ...] = (
    range_scale, range_offset, azimuth_eccentric, elevation_index, instrument_field, instrument_drift,
)  # fmt: skip

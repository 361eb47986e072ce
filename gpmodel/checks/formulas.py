"""Search jointly for other signs, zeros and couplings of the joint columns, and describe them as formulas."""

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from gpmodel.arrays import Array
from gpmodel.checks.notes import POOR_SHARE, flange, least_misfit, spread_of
from gpmodel.checks.readings import ALIKE, SCREENED, Reading, listed
from gpmodel.mechanism.protocol import Mechanism

QUARTERS = (0.0, 90.0, -90.0, 180.0)
"""Differences between the joint zeros of a controller and of a description, deg, in multiples of a right angle."""
WIDTH = 120
"""Number of interpretations of the joint columns that the beam search keeps at each level. Arbitrary signs, zeros and
one coupling were found for 32 of 32 tables of four arms; with 60 interpretations, for 30."""
EQUALLY = "equally well"
"""Words before a second interpretation of joint columns with an equal residual, such as a base upside down."""
ROUNDS, MIRRORED = 8, 8
"""Number of alternating fits of a similarity transform and of the tool point, and number of interpretations of the
joint columns for which all signs are compared."""


def formula_readings(mechanism: Mechanism, q: Array, p: Array) -> Iterator[Reading]:
    """Yield the joint columns' interpretation with the fewest changes that fits the measured points, if any fits.

    A change is another zero or sign of a joint column, or a coupling of two joint columns. A beam search adds one
    change at a level and compares lower bounds of the residual, which do not depend on the unit of `p` and cannot see a
    mirror image. If a lower bound is small, all signs of joints are compared by fits of a similarity transform. The
    zeros of the first and of the last joint are not changed: registration and tool absorb them. A second fitting
    interpretation with as few changes is named too.
    """
    changes, patterns = _changes(mechanism), np.array(list(product((1.0, -1.0), repeat=q.shape[1])))
    tried = np.eye(q.shape[1], q.shape[1] + 1)[None]
    known, good = {tried.tobytes()}, POOR_SHARE * spread_of(p)
    for _ in range(q.shape[1] + 2):
        bounds = _misfits(mechanism, tried, q, p, mirrored=True)
        beam = tried[np.argsort(bounds)[:WIDTH]]
        if bounds.min() < good:
            few = tried[np.argsort(bounds)[:MIRRORED]]
            signed = _wrapped(patterns[:, None, :, None] * few).reshape(-1, *few.shape[1:])
            left = _misfits(mechanism, signed, q, p, mirrored=False)
            if left.min() < good:
                fitting = sorted(np.unique(signed[left < ALIKE * left.min()], axis=0), key=_complexity)
                equal = [f for f in fitting if _complexity(f)[0] == _complexity(fitting[0])[0]]
                said = f", or {EQUALLY} ".join(_described(mechanism, f) for f in equal[:2])
                yield Reading(said, _applied(fitting[0][None], q)[0], p)
                return
        changed = [f for f in (_changed(m, change) for m in beam for change in changes) if _new(f, known)]
        if not changed:
            return
        tried = np.array(changed)


def _changes(mechanism: Mechanism) -> list[tuple[int, Array]]:
    """Return elementary changes: the index of a joint, and its new value as factors of all joints and a constant, deg.

    An elementary change is another sign and zero of a joint, or its sum or difference with a neighbouring joint.
    """
    count = len(mechanism.joints)
    turning = [i for i, joint in enumerate(mechanism.joints) if joint.kind == "revolute"]
    own = np.eye(count + 1)
    changes = []
    for i in range(count):
        zeros = QUARTERS if i in turning and 0 < i < count - 1 else QUARTERS[:1]
        changes += [(i, s * own[i] + z * own[count]) for s, z in product((1.0, -1.0), zeros) if (s, z) != (1.0, 0.0)]
        near = [k for k in (i - 1, i + 1) if k in turning and i in turning]
        changes += [(i, own[i] + sign * own[k]) for k, sign in product(near, (1.0, -1.0))]
    return changes


def _changed(formulas: Array, change: tuple[int, Array]) -> Array:
    """Return formulas of joint values, as factors and constants (joints, joints + 1), after a change of one joint."""
    joint, row = change
    out = formulas.copy()
    out[joint] = row[:-1] @ formulas
    out[joint, -1] += row[-1]
    return _wrapped(out)


def _wrapped(formulas: Array) -> Array:
    """Wrap the constants of formulas of joint values to the range from -180 to 180 deg."""
    out = formulas + 0.0
    out[..., -1] = 180.0 - (180.0 - out[..., -1]) % 360.0
    return out


def _new(formulas: Array, known: set[bytes]) -> bool:
    """Return whether formulas of joint values are new and valid (factors of at most one, at most two columns per
    joint); add new formulas to `known`."""
    factors, text = np.abs(formulas[:, :-1]), formulas.tobytes()
    if text in known or factors.max() > 1.0 or factors.sum(axis=1).max() > 2.0:
        return False
    known.add(text)
    return True


def _applied(formulas: Array, q: Array) -> Array:
    """Compute joint values (..., poses, joints), rad and m, by formulas (..., joints, joints + 1)."""
    return np.asarray(q @ np.swapaxes(formulas[..., :-1], -1, -2) + np.radians(formulas[..., None, :, -1]))


def _misfits(mechanism: Mechanism, formulas: Array, q: Array, p: Array, *, mirrored: bool) -> Array:
    """Return a residual for each formula of joint values: its lower bound, or after a fit of similarity and tool."""
    out = []
    for part in np.split(formulas, range(SCREENED, len(formulas), SCREENED)):
        values = _applied(part, q)
        frames = flange(mechanism, values.reshape(-1, q.shape[1])).reshape(*values.shape[:2], 4, 4)
        out.append(least_misfit(frames, p) if mirrored else _similarity_misfit(frames, p))
    return np.concatenate(out)


def _similarity_misfit(frames: Array, p: Array) -> Array:
    """Return RMS residuals (...) of a similarity transform and tool point fitted to frames (..., poses, 4, 4)."""
    points, turns = frames[..., :3, 3], frames[..., :3, :3]
    points, turns = points - points.mean(axis=-2, keepdims=True), turns - turns.mean(axis=-3, keepdims=True)
    normal = np.einsum("...nij,...nik->...jk", turns, turns) + 1e-9 * np.eye(3)
    seen, tool = p - p.mean(axis=0), np.zeros((*frames.shape[:-3], 3))
    for _ in range(ROUNDS):
        reached = points + np.einsum("...nij,...j->...ni", turns, tool)
        left, values, right = np.linalg.svd(np.swapaxes(seen, -1, -2) @ reached)
        signs = np.ones_like(values)
        signs[..., 2] = np.sign(np.linalg.det(left @ right))
        turn = (left * signs[..., None, :]) @ right
        scale = np.sum(values * signs, axis=-1) / np.maximum(np.sum(reached**2, axis=(-2, -1)), 1e-12)
        misfits = np.sum(seen**2) - scale * np.sum(values * signs, axis=-1)
        there = (seen @ turn) / np.maximum(scale, 1e-12)[..., None, None]
        tool = np.linalg.solve(normal, np.einsum("...nij,...ni->...j", turns, there - points)[..., None])[..., 0]
    return np.asarray(np.sqrt(np.maximum(misfits, 0.0) / len(p)))


def _complexity(formulas: Array) -> tuple[int, int, int]:
    """Return the number of changed zeros and couplings, of changed zeros, and of changed joints."""
    changed = formulas != np.eye(*formulas.shape)
    coupled = np.abs(formulas[:, :-1]).sum(axis=1) > 1.0
    zeros = formulas[:, -1] != 0.0
    return int(coupled.sum() + zeros.sum()), int(zeros.sum()), int(changed.any(axis=1).sum())


def _described(mechanism: Mechanism, formulas: Array) -> str:
    """Describe joints of opposite sign, and other changed joints as formulas of the joint columns."""
    names = [joint.name for joint in mechanism.joints]
    own = np.eye(*formulas.shape)
    flipped = [name for name, row, same in zip(names, formulas, own, strict=True) if (row == -same).all()]
    said = []
    if flipped:
        some = "columns {} probably have" if len(flipped) > 1 else "column {} probably has"
        said.append(f"{some.format(listed(flipped))} the opposite sign")
    for i, row in enumerate(formulas):
        if (np.abs(row) != own[i]).any():
            said.append(f"column '{names[i]}' should probably be {_formula(names, i, row)}")
    return " and ".join(said) + ": the description has another joint zero" * bool(formulas[:, -1].any())


def _formula(names: Sequence[str], i: int, row: Array) -> str:
    own_first = sorted(np.flatnonzero(row[:-1]).tolist(), key=lambda k: k != i)
    terms = [f" {'-' if row[k] < 0 else '+'} '{names[k]}'" for k in own_first]
    terms += [f" {'-' if row[-1] < 0 else '+'} {abs(row[-1]):g} deg"] * bool(row[-1])
    return f"{terms[0].replace(' + ', '').replace(' - ', '-')}{''.join(terms[1:])}"

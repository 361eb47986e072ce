"""Simulated sessions that the layouts are written from, and the writing of files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import gpmodel as gp
from gpmodel.arrays import Array
from gpmodel.checks.misfit import flange, registered
from gpmodel.mechanism.protocol import Mechanism


@dataclass(frozen=True)
class Session:
    """arm: what --mechanism is. q: (N, n) joint values, deg. p: (N, 3) measured, mm. turn: measured orientations. own,
    own_turn: flange of the controller's own forward kinematics, mm. second: (N, 3) another reflector, mm. warm: (N,)
    temperatures, degC. no: (N,) from 1."""

    arm: str
    mechanism: Mechanism
    q: Array
    p: Array
    turn: Rotation
    own: Array
    own_turn: Rotation
    second: Array
    warm: Array
    no: Array

    def rows(self, kept: Sequence[int]) -> Session:
        """Some of the rows."""
        parts = {name: value[list(kept)] for name, value in vars(self).items() if isinstance(value, np.ndarray)}
        return replace(self, turn=self.turn[list(kept)], own_turn=self.own_turn[list(kept)], **parts)


@dataclass(frozen=True)
class Case:
    """files: what was written. truth: the session that is to come out, None where it is to be refused. told: how often
    each pose is in it."""

    files: tuple[Path, ...]
    arm: str
    truth: Session | None
    told: int = 1


def session(arm: str, rows: int, seed: int) -> Session:
    """Poses of an arm with geometric errors, measured by a tracker, digits as instruments write them."""
    rng = np.random.default_rng(seed)
    made = gp.simulate(arm, ["joint_compliance J2=1e-6"], poses=rows, noise="0.02mm", geometry_sigma="0.3mm", seed=seed)
    mechanism, data = gp.load_mechanism(arm), made.table
    frames = flange(mechanism, data.q)
    found = registered(frames, data.position)
    mount = Rotation.from_rotvec(rng.normal(size=3))
    shaken = Rotation.from_rotvec(2e-4 * rng.normal(size=(rows, 3)))
    turn = Rotation.from_matrix(found.turn @ frames[:, :3, :3]) * mount * shaken
    tool = found.tool + np.array([0.08, -0.05, 0.06])
    second = (frames[:, :3, 3] + frames[:, :3, :3] @ tool) @ found.turn.T + found.shift
    second += data.position - found.points(frames) + 2e-5 * rng.normal(size=(rows, 3))
    return Session(
        arm, mechanism, np.round(np.degrees(data.q), 4), np.round(1e3 * data.position, 4), turn,
        np.round(1e3 * frames[:, :3, 3], 3), Rotation.from_matrix(frames[:, :3, :3]), np.round(1e3 * second, 4),
        np.round(20.0 + np.linspace(0, 3, rows) + 0.1 * rng.normal(size=rows), 2), np.arange(1, rows + 1),
    )  # fmt: skip


def radians(s: Session, digits: int = 7) -> Array:
    """Joint values, rad."""
    return np.asarray(np.round(np.radians(s.q), digits))


def table(*blocks: object, by: str = ",", comma: bool = False) -> list[str]:
    """Lines of blocks side by side: numbers (N,) or (N, k), or N texts; one text or number stands in every line."""
    count = max(len(b) for b in blocks if np.ndim(b))  # type: ignore[arg-type]
    wide = [np.asarray(b if np.ndim(b) else [b] * count, dtype=object).reshape(count, -1) for b in blocks]
    lines = [by.join(str(cell) for cell in row) for row in np.hstack(wide)]
    return [line.replace(".", ",") for line in lines] if comma else lines


def names(form: str, count: int = 6, first: int = 1) -> list[str]:
    """Numbered names."""
    return [form.format(i) for i in range(first, first + count)]


def write(path: Path, lines: Sequence[str], encoding: str = "utf-8") -> Path:
    """A file of lines."""
    path.write_text("\n".join(lines) + "\n", encoding=encoding)
    return path

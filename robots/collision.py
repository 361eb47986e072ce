"""Collisions of an arm with itself and with the instrument's line of sight, from the geometry of its URDF."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin

from gpmodel.arrays import Array, Mask
from gpmodel.errors import InputError
from gpmodel.table.units import identifier


def parse_model(path: Path) -> pin.Model:
    """Return Pinocchio's model of a URDF file, without its meshes.

    Raises InputError with the first message of the parser. A message about an inertia is also an error, although the
    parser would ignore the inertia.
    """
    try:
        with _quiet() as said:
            model = pin.buildModelFromUrdf(str(path))
        if any("inertial" in line for line in said):
            raise ValueError(said)
        return model
    except (ValueError, RuntimeError) as error:
        complaint = next((line for line in said if line.strip()), str(error).splitlines()[0])
        raise InputError(
            f"{path}: the URDF cannot be read ({complaint.strip().removeprefix('Error:').strip()})"
        ) from error


@contextmanager
def _quiet() -> Iterator[list[str]]:
    """Redirect the terminal output of C libraries to a list of lines."""
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


ALWAYS = 0.95
"""Fraction of random poses in collision from which two parts count as joined, as in MoveIt's setup assistant."""

PROBES = 200
CLEARANCE = 0.01
"""Least distance between parts of an arm, m. The clearance allows for reflector nest and cables, which a URDF lacks."""

BEAM = 0.02
"""Radius of the laser beam and of the reflector at its end, m: the radius of a 1.5 inch reflector."""


@dataclass(frozen=True, eq=False)
class Shape:
    """The collision geometry of a URDF.

    joints: names of the moving joints of the arm; all other joints of the URDF stay at their neutral position.
    tip: Pinocchio's index of the joint that carries the measured link.
    """

    model: pin.Model
    geometry: pin.GeometryModel
    joints: tuple[str, ...]
    tip: int

    @classmethod
    def read(cls, path: Path, joints: Sequence[str], frame: str) -> Shape | None:
        """Read the collision geometry of a URDF file; None if it has none or its meshes are missing."""
        model = parse_model(path)
        folders = [str(p) for p in path.resolve().parents]
        folders += [p for p in os.environ.get("ROS_PACKAGE_PATH", "").split(":") if p]
        try:
            geometry = pin.buildGeomFromUrdf(model, str(path), pin.GeometryType.COLLISION, package_dirs=folders)
        except (ValueError, RuntimeError):
            return None
        if geometry.ngeoms < 2:
            return None
        geometry.addAllCollisionPairs()
        tip = model.frames[model.getFrameId(frame, pin.FrameType.BODY)].parentJoint
        shape = cls(model, geometry, tuple(joints), tip)
        shape._forget_neighbours()
        return shape

    def collides(self, q: Array) -> Mask:
        """Return for each row of joint values whether two parts of the arm are closer than the clearance of 10 mm."""
        return np.asarray(self._meetings(q).any(axis=1))

    def hides(self, q: Array, points: Array, instrument: Array) -> Mask:
        """Return for each pose whether a part of the arm blocks the beam from a point (3,) to the instrument (3,), m.
        The part of the arm that carries the reflector is ignored."""
        data, geometry = self.model.createData(), pin.GeometryData(self.geometry)
        parts = [i for i, g in enumerate(self.geometry.geometryObjects) if g.parentJoint != self.tip]
        out = np.zeros(len(q), dtype=bool)
        for k, row in enumerate(self._configurations(q)):
            pin.updateGeometryPlacements(self.model, data, self.geometry, geometry, row)
            beam = instrument - points[k]
            length = float(np.linalg.norm(beam))
            turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), beam / length).matrix()
            capsule = coal.Capsule(BEAM, length)
            placed = coal.Transform3s(turn, points[k] + 0.5 * beam)
            out[k] = any(self._meets(i, geometry.oMg[i], capsule, placed) for i in parts)
        return out

    def _meets(self, part: int, at: pin.SE3, capsule: coal.Capsule, placed: coal.Transform3s) -> bool:
        body = self.geometry.geometryObjects[part].geometry
        where = coal.Transform3s(at.rotation, at.translation)
        return bool(coal.collide(body, where, capsule, placed, coal.CollisionRequest(), coal.CollisionResult()))

    def _meetings(self, q: Array) -> Mask:
        """Return for each row of joint values and each pair of parts whether the two parts collide."""
        data, geometry = self.model.createData(), pin.GeometryData(self.geometry)
        for request in geometry.collisionRequests:
            request.security_margin = CLEARANCE
        out = np.zeros((len(q), len(self.geometry.collisionPairs)), dtype=bool)
        for k, row in enumerate(self._configurations(q)):
            pin.updateGeometryPlacements(self.model, data, self.geometry, geometry, row)
            out[k] = [pin.computeCollision(self.geometry, geometry, i) for i in range(out.shape[1])]
        return out

    def _configurations(self, q: Array) -> Array:
        """Return Pinocchio's configuration vectors for joint values (poses, joints)."""
        rows = np.repeat(pin.neutral(self.model)[None], len(q), axis=0)
        names = {identifier(name): i for i, name in enumerate(self.model.names)}
        for column, name in enumerate(self.joints):
            joint = self.model.joints[names[name]]
            if joint.nq == 2:
                rows[:, joint.idx_q], rows[:, joint.idx_q + 1] = np.cos(q[:, column]), np.sin(q[:, column])
            else:
                rows[:, joint.idx_q] = q[:, column]
        return rows

    def _forget_neighbours(self) -> None:
        """Remove from the collision pairs: parts of one body, a body and its parent, and pairs that always collide."""
        parents = self.model.parents
        bodies = [g.parentJoint for g in self.geometry.geometryObjects]
        pairs = [(p.first, p.second) for p in self.geometry.collisionPairs]
        apart = [(a, b) for a, b in pairs if bodies[a] not in (bodies[b], parents[bodies[b]])]
        self._keep([(a, b) for a, b in apart if bodies[b] != parents[bodies[a]]])
        low, high = self._limits()
        met = self._meetings(np.random.default_rng(0).uniform(low, high, (PROBES, len(low)))).mean(axis=0)
        pairs = [(p.first, p.second) for p in self.geometry.collisionPairs]
        self._keep([pair for pair, share in zip(pairs, met.tolist(), strict=True) if share <= ALWAYS])

    def _keep(self, pairs: Sequence[tuple[int, int]]) -> None:
        self.geometry.removeAllCollisionPairs()
        for first, second in pairs:
            self.geometry.addCollisionPair(pin.CollisionPair(first, second))

    def _limits(self) -> tuple[Array, Array]:
        names = {identifier(name): i for i, name in enumerate(self.model.names)}
        at = [self.model.joints[names[name]] for name in self.joints]
        low = [self.model.lowerPositionLimit[j.idx_q] if j.nq == 1 else -np.pi for j in at]
        high = [self.model.upperPositionLimit[j.idx_q] if j.nq == 1 else np.pi for j in at]
        return np.clip(low, -np.pi, np.pi), np.clip(high, -np.pi, np.pi)

"""Define one blind robot: the files of its user, and the true values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from experiments.blind.case import Case
from experiments.blind.shapes import Motion, Shape, World
from experiments.blind.simulator import Arm, Array, gravity_loads, points


@dataclass(frozen=True)
class Sheet:
    """Poses as a user would have them, and where they are: clean and measured (N, 3), metres, in the tracker.

    pose (N,): rows with the same number are repeats of one pose, or of one cluster.
    """

    q: Array
    extra: dict[str, Array]
    row: Array
    clean: Array
    measured: Array
    outliers: Array
    pose: Array


def world_of(
    arm: Arm, q: Array, extra: dict[str, Array], row: Array, tool: Array, placement: Array | None = None
) -> World:
    """Return the inputs and loads of an arm of these masses; the payload hangs at the tool point."""
    loads = gravity_loads(arm, q, extra.get("payload"), tool)
    point = points(arm, q, np.eye(4) if placement is None else placement, tool, {})
    return World(arm, q, extra, row, loads, tool, point)


@dataclass(frozen=True)
class Robot:
    """arm: what its description says.  beyond: fresh poses outside the range of the table.  by_row: row k of a fresh
    sheet means what row k of the table does."""

    case: Case
    seed: int
    arm: Arm
    shapes: list[Shape]
    amounts: list[float]
    placement: Array
    tool: Array
    train: Sheet
    fresh: list[Sheet]
    beyond: list[Sheet]
    by_row: bool

    def columns(self, sheet: Sheet, tool: Array, placement: Array | None = None) -> list[Motion]:
        """Return the columns of the oracle, which knows tool and placement nearly, and not the robot's placement in
        the hall.
        """
        world = world_of(self.arm, sheet.q, sheet.extra, sheet.row, tool, placement)
        return [column for shape in self.shapes for column in shape.basis(world)]

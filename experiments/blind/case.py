"""Define the specification of a blind robot, and the table of all specifications.

`size` is the 3-D RMS in millimetres that an undeclared effect leaves after a fit of the standard model to noise-free
poses. `noise` is the standard deviation of one coordinate. The cases `aside` are reserved for a last test.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

Undeclared = tuple[str, dict[str, Any], float]


@dataclass(frozen=True)
class Case:
    """family: the table it is reported in.  What else is unlike eighty independent poses of all joints:

    noise: gaussian, distance (grows with the distance to the tracker) or student (t with 3 degrees of freedom);
    shared_mm: of noise common to the repeats of a pose, or to a cluster; walk_mm: 3-D rms of a random walk of the
    instrument in the table; outliers: share of the rows.
    order: independent, walk (moves of up to a fifth of the range) or clusters (of ten); in_order: the past matters;
    repeats: of every pose, in rounds, labelled by a column or known by jittering joint values only; minutes: of a
    session; narrow: share of every joint's range; moving: the joints that do (empty: all);
    trained: joint, and the part of its range as two fractions, in the table; above the second are other fresh poses.
    tracker: anywhere, or levelled and at 2.5 to 4 m.
    masses: right, none in the description, or wrong by 30 to 50 % on the links in `wrong`; masses_off: all of them.
    """

    name: str
    arm: str
    poses: int
    noise_mm: float
    effects: tuple[Undeclared, ...] = ()
    noise: str = "gaussian"
    outliers: float = 0.0
    columns: tuple[str, ...] = ()
    masses_off: float = 0.0
    aside: bool = False
    family: str = "single"
    order: str = "independent"
    in_order: bool = False
    repeats: int = 1
    labelled: bool = False
    shared_mm: float = 0.0
    walk_mm: float = 0.0
    minutes: float = 120.0
    narrow: float = 1.0
    moving: tuple[int, ...] = ()
    trained: tuple[int, float, float] | None = None
    tracker: str = "anywhere"
    masses: str = "right"
    wrong: tuple[int, ...] = ()


def effect(kind: str, size: float, **settings: Any) -> Undeclared:
    """An undeclared effect; with `amount` among the settings it has that and no stated size."""
    return kind, settings, size

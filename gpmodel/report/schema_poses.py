"""Numbers pose by pose, from which the pictures and the table of poses are made, and the accuracy they add up to."""

import math
from collections.abc import Collection
from dataclasses import dataclass, field

from gpmodel.arrays import Count, NotNegative

Vectors = tuple[tuple[float | None, ...], ...]


@dataclass(frozen=True)
class SideErrors:
    """3-D errors, mm, of the training and of the held-out poses, each in the order of the rows."""

    train: tuple[float | None, ...] = ()
    heldout: tuple[float | None, ...] = ()


@dataclass(frozen=True)
class ShapeRecord:
    """Partial residual of an effect over its first input, at the poses of the `rows` of the file, and the fitted curve
    where it reads that input alone."""

    effect: Count
    x_name: str = "row"
    x_unit: str = "1"
    y_unit: str = ""
    x: tuple[float | None, ...] = ()
    partial: tuple[float | None, ...] = ()
    heldout: tuple[bool, ...] = ()
    rows: tuple[int, ...] = ()
    curve_x: tuple[float | None, ...] = ()
    curve_y: tuple[float | None, ...] = ()


@dataclass(frozen=True)
class PlotRecord:
    """rows: (N,) rows of the file. points_mm: (N, 3) nominal positions in the mechanism's root frame.

    residual_mm: measured minus modelled (N, 3) in the same frame, of "registration", "standard" and "final".
    turn_mrad: angle (N,) between measured and modelled orientation, of the same; empty where none was measured.
    error_mm: by step of the ladder. chain_mm: the slots' origins (S, 3) of the poses `chain_poses`, to draw the arm.
    slots: their names.
    """

    rows: tuple[int, ...] = ()
    points_mm: Vectors = ()
    heldout_mask: tuple[bool, ...] = ()
    residual_mm: dict[str, Vectors] = field(default_factory=dict)
    turn_mrad: dict[str, tuple[float | None, ...]] = field(default_factory=dict)
    error_mm: dict[str, SideErrors] = field(default_factory=dict)
    shapes: tuple[ShapeRecord, ...] = ()
    slots: tuple[str, ...] = ()
    chain_poses: tuple[Count, ...] = ()
    chain_mm: tuple[Vectors, ...] = ()

    def turned(self, name: str, outliers: Collection[int]) -> tuple[int, float | None]:
        """Number of held-out poses, or of all where none are, with an angle of that name, and its RMS, mrad.

        outliers: rows of the file that do not count.
        """
        held, angles = any(self.heldout_mask), self.turn_mrad.get(name, ())
        each = zip(angles, self.heldout_mask, self.rows, strict=True) if angles else ()
        known = [a for a, out, row in each if a is not None and out >= held and row not in outliers]
        return len(known), math.sqrt(sum(a**2 for a in known) / len(known)) if known else None


@dataclass(frozen=True)
class ReadingRecord:
    """Readings of one kind: how many rows, and the RMS in their own unit of what registration and the last step leave
    of them, held out where any are."""

    name: str
    unit: str
    rows: Count
    before: NotNegative | None = None
    after: NotNegative | None = None


@dataclass(frozen=True)
class Repeatability:
    """ISO 9283 (1998) pose repeatability RP = l + 3 S_l, l the distances of repeats from their mean; over the poses.

    rms_mm: of these distances. rp_stderr_mm: standard uncertainty of the mean; None of one pose.
    """

    poses: Count
    measurements: Count
    rms_mm: NotNegative
    rp_mean_mm: NotNegative
    rp_max_mm: NotNegative
    rp_stderr_mm: NotNegative | None = None


@dataclass(frozen=True)
class Positioning:
    """ISO 9283 (1998) pose accuracy AP, the distance of the mean of a pose's repeats from where it should be: with the
    nominal geometry before, with the model after; mean over the poses with its standard uncertainty, and the largest.

    heldout: whether of poses that the model was not fitted to.
    """

    poses: Count
    heldout: bool
    before_mm: NotNegative
    before_stderr_mm: NotNegative
    after_mm: NotNegative
    after_stderr_mm: NotNegative
    after_max_mm: NotNegative


@dataclass(frozen=True)
class InstrumentRecord:
    """The specification of the instrument as it was given; limit_mm: of a coordinate at the typical distance of the
    poses, noise_mm: the standard deviation of a coordinate that it leads to expect."""

    specification: str
    limit_mm: NotNegative
    noise_mm: NotNegative

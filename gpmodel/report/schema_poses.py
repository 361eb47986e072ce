"""Numbers pose by pose, from which the pictures and the table of poses are made."""

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
    error_mm: by step of the ladder. chain_mm: the slots' origins (S, 3) of the poses `chain_poses`, to draw the arm.
    slots: their names.
    """

    rows: tuple[int, ...] = ()
    points_mm: Vectors = ()
    heldout_mask: tuple[bool, ...] = ()
    residual_mm: dict[str, Vectors] = field(default_factory=dict)
    error_mm: dict[str, SideErrors] = field(default_factory=dict)
    shapes: tuple[ShapeRecord, ...] = ()
    slots: tuple[str, ...] = ()
    chain_poses: tuple[Count, ...] = ()
    chain_mm: tuple[Vectors, ...] = ()


@dataclass(frozen=True)
class ReadingRecord:
    """Readings of one kind: how many rows, and the RMS in their own unit of what registration and the last step leave
    of them, held out where any are."""

    name: str
    unit: str
    rows: Count
    before: NotNegative | None = None
    after: NotNegative | None = None

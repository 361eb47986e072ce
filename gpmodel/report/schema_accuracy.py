"""What report.json says of accuracy and repeatability, each with its uncertainty."""

from dataclasses import dataclass

from gpmodel.arrays import Count, NotNegative


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

"""The acceptance rule: every limit in one place, and the verdict that its tests add up to."""

from collections.abc import Callable
from dataclasses import dataclass

from gpmodel import wording


@dataclass(frozen=True)
class Criteria:
    """The limits that a candidate has to pass before it becomes a finding, and how they are measured.

    Tests of one candidate:
    significance: largest p-value on permuted residuals.
    minimum_nats: least gain of any group in description length, and part of its price, nats; pure noise reaches 4.2,
        five is a Bayes factor of 150, "very strong" (Kass and Raftery 1995).
    minimum_cv_t: least cross-validated gain of a named effect over random folds, in standard errors of its mean. Zero:
        evidence and permutation null decide whether it is there, and it must not predict worse. At 1.5 the model of 90
        poses of a measured cobot lost a third of its effects, and its error rose by a fifth (CONTRIBUTING).
    apart_cv_t: least such gain over stretches of rows, where these are in order or read, and over machines; half of 3,
        as an effect of t standard errors lowers the squared error by t² σ² and noise moves that by 2 t σ².
    clear_cv_t: least such gain of an unnamed expression, over none, over a named effect and over any part of it: the
        two-sided 5 %, as the more ways there are, the more of them predict a little better.
    minimum_share: least share of its motion of the readings that nothing enabled explains; below it the rest is a
        hundred times as large, and a change of the model by a hundredth of that decides the number.
    scored_share: least unique share of a column that is scored at all; below it the coefficient is rounding.
    largest_between: largest ratio of a basis between the measured poses to its size at them; more is a pole.

    Naming:
    head_start: nats by which an unnamed expression has to beat a named effect, the price of reading it.
    naming_margin: nats that a reader loses by a curve that names no part, where its formulas are offered.
    tie: nats within which the expression that is shortest to read represents its like.

    Selection of groups:
    one_pose_share: largest share of a group's gain that one pose brings; with more the group is bent to an outlier.

    Poses:
    fewest_bundles: least groups of poses that are permuted whole; below it too few orders differ to tell a p-value,
        and only repeats of a pose are kept together.
    blocks: stretches of rows, and regions of space, within which poses may depend on one another; ten leave each long
        enough to hold what drifts through a session.
    outlier_sigmas: robust standard deviations beyond which a residual is winsorised; beyond six a Gaussian has one
        pose in 5e8.
    folds: of cross-validation, the usual ten (Kohavi 1995).
    shuffles: permutations of the residual that the catalogue is scored on.
    confirmation: largest one-sided p-value, on the held-out poses, that the findings predict no better than the
        standard model; above it the standard model is shipped.
    input_significance: largest p-value of an input in the histogram, corrected for their number.
    """

    significance: float = 0.01
    minimum_nats: float = 5.0
    minimum_cv_t: float = 0.0
    apart_cv_t: float = 1.5
    clear_cv_t: float = 2.0
    minimum_share: float = 0.01
    scored_share: float = 0.02
    head_start: float = 5.0
    naming_margin: float = 8.0
    tie: float = 1.0
    largest_between: float = 4.0
    one_pose_share: float = 0.5
    outlier_sigmas: float = 6.0
    fewest_bundles: int = 20
    blocks: int = 10
    confirmation: float = 0.1
    folds: int = 10
    shuffles: int = 199
    input_significance: float = 0.05


@dataclass(frozen=True)
class Test:
    """One test of a candidate: what was measured, the limit it was held against, and whether it passed."""

    __test__ = False
    name: str
    value: float
    limit: float
    passed: bool


_WORDS: dict[str, Callable[[Test], str]] = {
    "chance": lambda t: f"chance of it on shuffled residuals {wording.chance(t.value)}, limit {t.limit}",
    "nats": lambda t: f"description length saved {t.value:.1f} nats, limit {t.limit}",
    "cross-validation": lambda t: f"cross-validated gain {t.value:.1f} deviations, limit {t.limit}",
    "stretches": lambda t: f"gain on stretches of rows left out {t.value:.1f} deviations, limit {t.limit}",
    "unique share": lambda t: f"unique share {t.value:.3f}, limit {t.limit}",
    "repeats": lambda t: f"repeats counted once, it saves {t.value:.1f} nats, limit {t.limit}",
    "rows": lambda t: f"what drifts along the rows taken off, it saves {t.value:.1f} nats, limit {t.limit}",
    "space": lambda t: f"what varies over the space taken off, it saves {t.value:.1f} nats, limit {t.limit}",
}


@dataclass(frozen=True)
class Verdict:
    """The tests of one candidate in order; it is accepted where all of them pass."""

    tests: tuple[Test, ...]

    @property
    def accepted(self) -> bool:
        """True if every test is passed."""
        return all(test.passed for test in self.tests)

    @property
    def why(self) -> str:
        """Failed tests in words; empty if none failed."""
        return "; ".join(_WORDS[test.name](test) for test in self.tests if not test.passed)

    def passed(self, name: str) -> bool:
        """Return whether the test of that name passed or did not apply."""
        return all(test.passed for test in self.tests if test.name == name)

"""The limits of all acceptance tests of a candidate effect, and the verdict from the tests."""

from collections.abc import Callable
from dataclasses import dataclass

from gpmodel import wording
from gpmodel.arrays import Array


@dataclass(frozen=True)
class Criteria:
    """Limits that a candidate effect has to pass to become a finding, and settings of the tests.

    Limits of the tests of one candidate effect:
        significance: largest p-value of a candidate effect against residuals with random signs.
        minimum_nats: least gain in description length of any candidate, nats. The gain on pure noise reaches 4.2 nats;
            5 nats are a Bayes factor of 150, "very strong" (Kass and Raftery 1995).
        minimum_cv_t: least cross-validated gain of a named effect over random folds, in standard errors of its mean.
            With a limit of 0, predictions must not become worse. With a limit of 1.5 the model of 90 poses of a
            measured cobot lost a third of its effects, and its error rose by a fifth (CONTRIBUTING).
        apart_cv_t: least cross-validated gain over stretches of ordered rows, and over machines, in standard errors.
            1.5 = 3 / 2: an effect of t standard errors lowers the squared error by t² σ², noise changes it by 2 t σ².
        clear_cv_t: least cross-validated gain of an unnamed formula over no effect, over a named effect and over a part
            of the formula, in standard errors: two-sided 5 %, as some of many formulas gain by chance.
        minimum_share: least share of an effect's motion that the other effects of the model do not explain. With a
            smaller share, a relative model error of 0.01 decides the coefficient.
        scored_share: least unique share of a scored column; with less, the column's coefficient is a rounding error.
        largest_between: largest ratio of a basis function between poses to its size at the poses; beyond is a pole.
    Limits for naming effects:
        head_start: gain, nats, by which an unnamed formula, without a cause, has to exceed a named effect.
        naming_margin: penalty of a smooth term for which formulas are candidates too, nats.
        tie: difference in gain within which the shortest of several formulas is selected, nats.
    Selection of groups of effects:
        one_pose_share: largest share of a group's gain from a single pose; with more, the group fits an outlier.
    Poses:
        fewest_blocks: least number of blocks of poses for a test with random signs or orders of blocks; fewer blocks
            have too few for a p-value, and then only the repeats of a pose form a block.
        blocks: number of stretches of rows, and of regions of space, with dependent errors; with ten, each stretch is
            long enough to contain a drift.
        outlier_sigmas: robust standard deviations beyond which a residual is winsorised; one Gaussian value in 5e8
            exceeds six.
        folds: number of folds of cross-validation, the usual ten (Kohavi 1995).
        shuffles: number of residuals with random signs on which the catalogue is scored.
        confirmation: largest one-sided p-value of the held-out test that the findings predict better than the standard
            model; with a larger p-value the standard model is saved.
        input_significance: largest p-value of an input in the histogram, corrected for the number of inputs.
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
    fewest_blocks: int = 20
    blocks: int = 10
    confirmation: float = 0.1
    folds: int = 10
    shuffles: int = 199
    input_significance: float = 0.05

    def rests_on_one_pose(self, gained: Array) -> bool:
        """Return whether one pose, an outlier, gives most of a group's gain. gained: decrease of residual² by pose."""
        return float(gained.max()) > self.one_pose_share * float(gained.sum())


@dataclass(frozen=True)
class Test:
    """A test of one candidate effect: measured value, limit, and whether the candidate passed."""

    __test__ = False
    name: str
    value: float
    limit: float
    passed: bool


_WORDS: dict[str, Callable[[Test], str]] = {
    "chance": lambda t: f"probability on residuals with random signs {wording.chance(t.value)}, limit {t.limit}",
    "nats": lambda t: f"net gain {t.value:.1f} nats, limit {t.limit}",
    "cross-validation": lambda t: f"cross-validated gain {t.value:.1f} standard errors, limit {t.limit}",
    "stretches": lambda t: f"gain with folds of rows {t.value:.1f} standard errors, limit {t.limit}",
    "unique share": lambda t: f"unique share {t.value:.3f}, limit {t.limit}",
    "noise": lambda t: f"net gain with unequal noise of the poses {t.value:.1f} nats, limit {t.limit}",
    "repeats": lambda t: f"net gain with repeats counted once {t.value:.1f} nats, limit {t.limit}",
    "rows": lambda t: f"net gain without drift along the rows {t.value:.1f} nats, limit {t.limit}",
    "space": lambda t: f"net gain without variation over space {t.value:.1f} nats, limit {t.limit}",
}


@dataclass(frozen=True)
class Verdict:
    """The tests of one candidate effect, in order. The candidate is accepted if all tests pass."""

    tests: tuple[Test, ...]

    @property
    def accepted(self) -> bool:
        """True if the candidate effect passed every test."""
        return all(test.passed for test in self.tests)

    @property
    def why(self) -> str:
        """Failed tests of the candidate effect in words; empty if the candidate passed all tests."""
        return "; ".join(_WORDS[test.name](test) for test in self.tests if not test.passed)

    def passed(self, name: str) -> bool:
        """Return whether the candidate effect passed the test `name`, or the test did not apply."""
        return all(test.passed for test in self.tests if test.name == name)

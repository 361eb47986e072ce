"""The acceptance rule: every limit in one place, and the verdict that its tests add up to."""

from collections.abc import Callable
from dataclasses import dataclass

from gpmodel import wording


@dataclass(frozen=True)
class Criteria:
    """Limits that a candidate has to pass before it becomes a finding, and how its chance is measured.

    significance: largest chance of its score on shuffled residuals, and of what laws evolved without some poses gain on
    these. minimum_nats: description length saved beyond its own cost, nats; selection under pure noise reaches 4.2 at
    most, five is a Bayes factor of 150 ("very strong", Kass and Raftery 1995). minimum_cv_t: gain in cross-validation
    in standard deviations of its mean, pose by pose: half of minimum_sigmas, since an effect of t deviations lowers the
    sum of squared errors by t² σ² and noise moves that by 2 t σ², so it shows t/2 at most; over random folds, and over
    stretches of rows where these are in order or read. clear_cv_t: the same of an expression that nobody named, over
    having it at all, over a named effect and over any part of it, the usual two-sided 5 %: the more ways there are, the
    more of them predict a little better. minimum_sigmas: largest coefficient in its standard deviations. minimum_share:
    unique share of its column, below which 97 % of it is explained by the model already. scored_share: columns of a
    smaller unique share are not scored at all, their coefficient would be rounding.

    likeness: correlation of projected columns above which two candidates are one finding at several possible places.
    head_start: nats by which an expression nobody named has to be better than a named effect, the price of reading it.
    naming_margin: nats that the catalogue's word may cost against the expression it names. tie: nats within which the
    expression with fewest operators speaks for its like. fewest_poses, fewest_share: the poses, and the share of
    them, that every part of an unnamed expression must speak for: fewer is a spike at the worst poses.
    largest_between: how many times larger than at the measured poses a basis may be between them; more is a pole.

    While groups are chosen, each has to save minimum_nats. part_nats: what each place of a group at several places has
    to save, its share of that, since the kind is paid for already. swap_nats: by which a group has to be better to take
    another's place, more than is settled of either; one that is cheaper to name, and no larger, takes it where it is no
    worse. rival_nats: within which another in its place is told as a rival, a factor of twenty in likelihood (Jeffreys
    1961: "strong"). one_pose_share: of what a group gains that one pose may bring; more than half is an outlier the
    group has bent itself to.

    fewest_bundles: groups of poses below which too few orders of whole groups differ to tell chance, and only repeats
    of a pose are kept together. blocks: stretches of rows, and regions of space, in which poses are
    allowed to depend on one another; ten leave each long enough to hold what drifts through a session.
    confirmation: one-sided chance, on the held-out poses, that what was found predicts no better than the standard
    model; above it the standard model is shipped.

    outlier_sigmas: robust standard deviations beyond which a pose's residual is winsorised; beyond six a Gaussian has
    one pose in 5e8. folds: of cross-validation, the usual ten (Kohavi 1995). shuffles: permutations of the residual
    the catalogue is scored on. input_significance: of an input in the histogram, after correction for their number.
    """

    significance: float = 0.01
    minimum_nats: float = 5.0
    minimum_cv_t: float = 1.5
    clear_cv_t: float = 2.0
    minimum_sigmas: float = 3.0
    minimum_share: float = 0.03
    scored_share: float = 0.02
    likeness: float = 0.95
    head_start: float = 5.0
    naming_margin: float = 8.0
    tie: float = 1.0
    standard_errors: float = 1.0
    fewest_poses: float = 5.0
    fewest_share: float = 0.05
    largest_between: float = 4.0
    part_nats: float = 1.0
    swap_nats: float = 1.0
    rival_nats: float = 3.0
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
    "cross-fitting": lambda t: (
        f"chance of what laws evolved without some poses gain on these {wording.chance(t.value)}, limit {t.limit}"
    ),
    "walk": lambda t: f"a random walk of the instrument saves {-t.value:.1f} nats more",
    "coefficient": lambda t: f"coefficient {t.value:.1f} sigma, limit {t.limit}",
    "sign": lambda t: "sign changes between folds",
    "unique share": lambda t: f"unique share {t.value:.3f}, limit {t.limit}",
    "repeats": lambda t: f"repeats counted once, it saves {t.value:.1f} nats, limit {t.limit}",
    "rows": lambda t: f"what drifts along the rows taken off, it saves {t.value:.1f} nats, limit {t.limit}",
    "space": lambda t: f"what varies over the space taken off, it saves {t.value:.1f} nats, limit {t.limit}",
}


@dataclass(frozen=True)
class Verdict:
    """The tests of one candidate, in the order they are told; accepted where all of them passed."""

    tests: tuple[Test, ...]

    @property
    def accepted(self) -> bool:
        """Whether every test is passed."""
        return all(test.passed for test in self.tests)

    @property
    def why(self) -> str:
        """What failed, in words; empty where nothing did."""
        return "; ".join(_WORDS[test.name](test) for test in self.tests if not test.passed)

    def passed(self, name: str) -> bool:
        """Whether the test of that name passed, or was not asked of this candidate."""
        return all(test.passed for test in self.tests if test.name == name)

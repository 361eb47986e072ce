"""The candidates of one round with what each saves, and what chance saves."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gpmodel.arrays import Array
from gpmodel.discovery.residual import Residual
from gpmodel.discovery.score import Score, scores
from gpmodel.families.candidate import Candidate
from gpmodel.numerics.null_distribution import chance


@dataclass(frozen=True)
class Pool:
    """Candidates of one round, their scores, and the null maxima of where each came from."""

    candidates: tuple[Candidate, ...]
    scores: tuple[Score, ...]
    nulls: Mapping[str, Array]

    def p_value(self, i: int) -> float:
        """Chance of the score among shuffled residuals, times the number of searches that competed."""
        null = self.nulls[self.candidates[i].found_by]
        return min(1.0, len(self.nulls) * chance(self.scores[i].nats, null))


def pool_of(residual: Residual, candidates: Sequence[Candidate], nulls: Mapping[str, Array]) -> Pool:
    """Candidates scored on a residual."""
    return Pool(tuple(candidates), scores(residual, candidates), nulls)

"""The candidates of one round with what each saves, and what chance saves."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from gpmodel.arrays import Array
from gpmodel.evidence.residual import Residual
from gpmodel.evidence.score import Score, scores
from gpmodel.evolution.chance import Chance, chance
from gpmodel.families.candidate import Candidate


@dataclass(frozen=True)
class Pool:
    """Candidates of one round, their scores, and the null maxima of where each came from."""

    candidates: tuple[Candidate, ...]
    scores: tuple[Score, ...]
    nulls: Mapping[str, Array]

    def chance(self, i: int) -> Chance:
        """Chance of the score among shuffled residuals, times the number of searches that competed."""
        found = chance(self.scores[i].nats, self.nulls[self.candidates[i].found_by])
        return replace(found, p=min(1.0, len(self.nulls) * found.p))


def pool_of(residual: Residual, candidates: Sequence[Candidate], nulls: Mapping[str, Array]) -> Pool:
    """Candidates scored on a residual."""
    return Pool(tuple(candidates), scores(residual, candidates), nulls)

"""Test the two selection schemes and a user-defined scheme."""

from dataclasses import dataclass

import numpy as np
import pytest

from gpmodel.evolution.code import Scores
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.projection import regression
from gpmodel.evolution.search import evolve
from gpmodel.evolution.settings import Budget, SelectionScheme, Settings, Tournament, Truncation


def scored(*score: float) -> Scores:
    scores = Scores.empty(len(score))
    scores.score[:] = score
    return scores


def test_survivors_of_a_tournament_are_the_best_of_each_score_first() -> None:
    scores = scored(3.0, 1.0, 1.0, 2.0, 1.0, 5.0)
    assert Tournament().survivors(scores, 4).tolist() == [1, 3, 0, 5]


def test_parents_by_truncation_are_among_the_best_share() -> None:
    scores = scored(*np.random.default_rng(0).permutation(100))
    parents = Truncation(0.1).parents(scores, np.random.default_rng(1))
    assert parents.shape == (2, 100)
    assert set(scores.score[parents.ravel()]) == set(range(10))
    assert Truncation(0.1).survivors(scores, 100) is None


def test_larger_tournaments_choose_better_parents() -> None:
    scores = scored(*np.random.default_rng(0).permutation(500))
    means = [scores.score[Tournament(n).parents(scores, np.random.default_rng(1))].mean() for n in (1, 2, 7)]
    assert means[0] > means[1] > means[2]
    assert means[0] == pytest.approx(249.5, abs=25)


@dataclass(frozen=True)
class LinearRanking:
    """Parents in proportion to their rank (Baker 1985); the best ``kept`` parents live on with all the children."""

    kept: int = 5

    def eligible(self, population: int) -> int:
        return population

    def parents(self, scores: Scores, rng: np.random.Generator) -> np.ndarray:
        count = len(scores.score)
        order = np.argsort(scores.score, kind="stable")
        weights = np.arange(count, 0, -1.0)
        return order[rng.choice(count, (2, count), p=weights / weights.sum())]

    def survivors(self, scores: Scores, population: int) -> np.ndarray:
        best = np.argsort(scores.score[:population], kind="stable")[: self.kept]
        children = population + np.argsort(scores.score[population:], kind="stable")[: population - self.kept]
        return np.concatenate([best, children])


@pytest.mark.parametrize("selection", [Tournament(3), Truncation(0.2), LinearRanking()], ids=lambda s: type(s).__name__)
def test_every_scheme_finds_a_simple_law(selection: SelectionScheme) -> None:
    inputs = Inputs(("a", "b"), np.random.default_rng(0).uniform(-2, 2, (2, 50)))
    problem = SlotProblem(inputs, regression(np.sin(inputs["a"]) * inputs["b"]))
    settings = Settings(selection=selection, budget=Budget(300, 60, seconds=1e9, target=0.999))
    assert evolve(problem, settings, np.random.default_rng(0)).best.gain > 0.99

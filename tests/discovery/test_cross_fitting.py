"""What is evolved without some of the poses predicts them where something is there, and not where nothing is."""

import numpy as np
import pytest
from effect_cases import mechanism
from residual_cases import seen

from gpmodel.discovery.cross_fitting import cross_fitted, gain_of_search
from gpmodel.discovery.explore import Turn
from gpmodel.discovery.journal import Forgetful
from gpmodel.discovery.search import Search
from gpmodel.evidence.sign_flips import FLIPS, sign_flip_chance
from gpmodel.model.sites import sites_of
from gpmodel.progress import Teller, silent

TURN = Turn(1, Teller(silent, ""), Forgetful())
SMALL = Search(population=128, generations=8, climb=0, workers=1)
SITES = tuple(site for site in sites_of(mechanism("irb6400r")) if site.slot in ("J3.moving", "J4.moving"))


@pytest.mark.parametrize(("planted", "predicts"), [("gear error, 2 per turn, J4", True), ("nothing", False)])
def test_only_what_is_there_is_predicted_by_what_was_evolved_elsewhere(planted: str, predicts: bool) -> None:
    gains = [gain_of_search(seen(planted), SITES, SMALL, np.random.default_rng(seed), TURN) for seed in (0, 0)]
    np.testing.assert_array_equal(gains[0], gains[1])
    assert (sign_flip_chance(gains[0]).p < 0.01) == predicts


def test_nothing_is_evolved_again_where_nothing_passed() -> None:
    assert cross_fitted(seen("nothing"), (), (), SMALL, np.random.default_rng(0), TURN) == ()


def test_the_chance_of_a_gain_is_exact() -> None:
    rng = np.random.default_rng(0)
    drawn = np.array([sign_flip_chance(rng.standard_t(3, 30)).p for _ in range(400)])
    for level in (0.01, 0.05, 0.2):
        assert np.mean(drawn <= level) == pytest.approx(level, abs=3 * np.sqrt(level * (1 - level) / 400))
    assert sign_flip_chance(np.ones(40)).p == 1 / (1 + FLIPS)
    assert sign_flip_chance(np.zeros(40)).p == 1.0

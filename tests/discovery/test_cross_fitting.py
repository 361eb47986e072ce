"""What is evolved without some of the poses predicts them where something is there, and not where nothing is."""

import numpy as np
import pytest
from effect_cases import mechanism
from residual_cases import seen

from gpmodel.discovery.cross_fitting import cross_fitted, gain_of_search
from gpmodel.discovery.explore import Turn
from gpmodel.discovery.journal import Forgetful
from gpmodel.discovery.search import Search
from gpmodel.model.sites import sites_of
from gpmodel.progress import Teller, silent

TURN = Turn(1, Teller(silent, ""), Forgetful())
SMALL = Search(population=128, generations=8, climb=0, workers=1)
SITES = tuple(site for site in sites_of(mechanism("irb6400r")) if site.slot in ("J3.moving", "J4.moving"))


@pytest.mark.parametrize(("planted", "predicts"), [("gear error, 2 per turn, J4", True), ("nothing", False)])
def test_only_what_is_there_is_predicted_by_what_was_evolved_elsewhere(planted: str, predicts: bool) -> None:
    gains = [gain_of_search(seen(planted), SITES, SMALL, np.random.default_rng(seed), TURN) for seed in (0, 0)]
    assert gains[0] == gains[1]
    assert (gains[0] > 2.0) == predicts


def test_nothing_is_evolved_again_where_nothing_passed() -> None:
    assert cross_fitted(seen("nothing"), (), (), SMALL, np.random.default_rng(0), TURN) == ()

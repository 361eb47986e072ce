"""The size of a machine of which no reading shows it: as near to the description as all constants together say."""

from typing import Any

import numpy as np
import pytest
from instrument_cases import ARM, ready, simulated, tool_error

import gpmodel as gp
from gpmodel.arrays import IntArray
from gpmodel.calibration import gauge
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.size import MOST, spread
from gpmodel.model.error_model import ErrorModel
from gpmodel.model.sites import geometric_effects


@pytest.mark.parametrize("reach", [1e-4, 3e-4, 2e-3])
def test_how_far_a_description_is_off_is_read_from_what_its_constants_explain(reach: float) -> None:
    rng = np.random.default_rng(3)
    columns, placed = rng.normal(size=(300, 40)), rng.normal(size=(300, 9))
    said = columns @ rng.normal(0.0, reach, 40) + placed @ rng.normal(size=9) + rng.normal(0.0, 3e-5, 300)
    assert spread(columns, said, placed, MOST)[0] == pytest.approx(reach, rel=0.25)


@pytest.mark.long
def test_the_size_does_not_depend_on_which_constants_stand_for_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first of equivalent constants are held. With the turns of the joints last, others are held and the fit
    does not change.
    """
    made = simulated("points", 160)
    model, chosen = ErrorModel(made.truth.mechanism, geometric_effects(made.truth.mechanism)), gauge.preference
    fit = calibrate(model, ready(made))

    def turned_round(*given: Any) -> IntArray:
        order = chosen(*given)
        lengths = np.array([model.effects[i].unit == "m" for i in order])
        return np.concatenate([order[lengths], order[~lengths][::-1]])

    monkeypatch.setattr(gauge, "preference", turned_round)
    other = calibrate(model, ready(made))
    assert (fit.kept != other.kept).any()
    errors = [tool_error(made, each) for each in (fit, other)]
    np.testing.assert_allclose(errors[0], errors[1], atol=3e-6)


@pytest.mark.long
def test_the_size_is_the_best_guess_of_all_constants_together() -> None:
    """Errors of 0.3 mm each; with half of the constants as the guess the median is 0.46 mm."""
    off = []
    for seed in range(6):
        made = gp.simulate(ARM, [], poses=160, instrument="points", geometry_sigma="0.3 mm", seed=seed)
        fit = calibrate(ErrorModel(made.truth.mechanism, geometric_effects(made.truth.mechanism)), ready(made))
        off.append(np.sqrt(np.mean(tool_error(made, fit) ** 2)))
    assert np.median(off) < 0.4e-3

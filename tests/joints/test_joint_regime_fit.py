"""Fit of the stiffness regimes: planted recovery, curves that miss a regime, and bad data."""

from dataclasses import asdict

import numpy as np
import pytest

from gpmodel.errors import InputError
from joints.regime_fit import fit_regimes
from joints.stiffness import RegimeCurve

# Table 4.3: contact 26, transition 1.2, fluid 4.5 N/um
CURVES = [
    RegimeCurve(26e6, 1.2e6, 4.5e6, 90.0, -50e-6, 0.0, 15e-6, 0.794e-3),
    RegimeCurve(40e6, 2e6, 8e6, 60.0, -10e-6, 20e-6, 26e-6, 0.3e-3),
    RegimeCurve(15e6, 0.5e6, 3e6, 120.0, 0.0, 60e-6, 110e-6, 1.5e-3),
]


def span(curve: RegimeCurve, rows: int = 400) -> np.ndarray:
    reach = curve.film_end - curve.contact_end
    return np.linspace(curve.contact_end - 0.2 * reach, curve.film_end + 3 * reach, rows)


@pytest.mark.parametrize("curve", CURVES, ids=["Table 4.3", "stiff", "soft"])
def test_noiseless_curves_are_recovered(curve: RegimeCurve) -> None:
    x = span(curve)
    fit = fit_regimes(x, curve.force(x))
    assert fit.status == "ok"
    assert fit.rms < 1e-3
    for name, value in asdict(curve).items():
        assert getattr(fit.curve, name) == pytest.approx(value, rel=1e-3, abs=1e-8)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("curve", CURVES, ids=["Table 4.3", "stiff", "soft"])
def test_planted_stiffnesses_come_back_within_their_errors(curve: RegimeCurve, seed: int) -> None:
    x = span(curve)
    fit = fit_regimes(x, curve.force(x) + np.random.default_rng(seed).normal(0, 1.0, x.size))
    assert fit.status == "ok"
    assert fit.rms == pytest.approx(1.0, abs=0.15)
    for name in ("contact_stiffness", "transition_stiffness", "film_stiffness", "peak_force"):
        assert abs(getattr(fit.curve, name) - getattr(curve, name)) < 4 * fit.stderr[name]


def test_order_of_rows_does_not_matter() -> None:
    x = span(CURVES[0])
    force = CURVES[0].force(x) + np.random.default_rng(1).normal(0, 1.0, x.size)
    shuffle = np.random.default_rng(2).permutation(x.size)
    assert fit_regimes(x[shuffle], force[shuffle]).curve == fit_regimes(x, force).curve


def test_a_straight_line_is_not_taken_for_four_regimes() -> None:
    x = np.linspace(0, 1e-4, 100)
    fit = fit_regimes(x, 1e6 * x + np.random.default_rng(0).normal(0, 0.1, 100))
    assert fit.status != "ok"


def test_a_compressed_magnet_is_not_a_joint() -> None:
    x = span(CURVES[0])
    fit = fit_regimes(x, -CURVES[0].force(x))
    assert fit.status.startswith("not a preloaded joint's curve: ")


@pytest.mark.parametrize(
    ("x", "f", "words"),
    [
        (np.arange(5.0), np.arange(5.0), "5 displacements and 5 forces, expected at least 12 pairs"),
        (np.arange(20.0), np.arange(19.0), "20 displacements and 19 forces"),
        (np.arange(20.0), np.r_[np.nan, np.arange(19.0)], "force = nan, expected finite numbers"),
        (np.ones(20), np.arange(20.0), "range of displacement = 0"),
    ],
)
def test_bad_data_is_refused(x: np.ndarray, f: np.ndarray, words: str) -> None:
    with pytest.raises(InputError, match=words):
        fit_regimes(x, f)


def smooth_contact_and_film(x: np.ndarray) -> np.ndarray:
    """Tension of no `RegimeCurve`: Hertz contact on a bed of asperities, an exponential film, magnets of two poles."""
    magnets = 90.0 * (0.794e-3 / (0.794e-3 + np.maximum(x, 0.0))) ** 2
    asperities = 1.2e6 * 3e-6 * np.logaddexp(0.0, -x / 3e-6)
    hertz = 2.4e9 * np.maximum(-50e-6 - x, 0.0) ** 1.5
    film = 70.0 * np.exp(-np.maximum(x, 0.0) / 12e-6)
    return magnets - asperities - hertz - film


def test_data_of_another_formula_is_followed_and_its_slopes_are_named() -> None:
    """Every stiffness is the data's own mean slope over the regime that was found, and the pull beyond is the pull.

    The contact has to be pressed until it leads the misfit: from -58 um on, the film's curve is split in two instead.
    """
    x = np.linspace(-66e-6, 250e-6, 500)
    force = smooth_contact_and_film(x) + np.random.default_rng(0).normal(0, 0.5, x.size)
    fit = fit_regimes(x, force)
    assert fit.status == "ok"
    assert fit.rms < 2.5
    c = fit.curve
    assert -56e-6 < c.contact_end < -45e-6
    ends = {"contact": (x[0], c.contact_end), "transition": (c.contact_end, c.transition_end)}
    for name, (low, high) in {**ends, "film": (c.transition_end, c.film_end)}.items():
        mean_slope = np.diff(smooth_contact_and_film(np.array([low, high])))[0] / (high - low)
        assert getattr(c, f"{name}_stiffness") == pytest.approx(mean_slope, rel=0.15)
    far = np.linspace(100e-6, 250e-6, 20)
    np.testing.assert_allclose(c.force(far), smooth_contact_and_film(far), atol=2.0)


@pytest.mark.long
def test_the_magnets_coefficient_has_an_error_that_its_scatter_confirms() -> None:
    curve, x = CURVES[0], span(CURVES[0], 200)
    fits = [fit_regimes(x, curve.force(x) + np.random.default_rng(seed).normal(0, 1.0, x.size)) for seed in range(12)]
    found = np.array([f.curve.magnet_coefficient for f in fits])
    stated = np.mean([f.stderr["magnet_coefficient"] for f in fits])
    assert 0.5 * stated < found.std(ddof=1) < 2.0 * stated
    assert abs(found.mean() - curve.magnet_coefficient) < 4 * stated / np.sqrt(len(fits))

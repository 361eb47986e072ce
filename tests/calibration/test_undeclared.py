"""Test that constants that touches do not determine stay near the description."""

from functools import cache
from typing import Any

import numpy as np
import pytest
import scipy
from instrument_cases import ARM, ready, simulated, tool_error

import gpmodel as gp
from experiments.touches.run import EFFECTS, judged
from gpmodel.arrays import Array, IntArray
from gpmodel.calibration import gauge
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.overall_scale import MOST, spread
from gpmodel.calibration.result import Calibration, problem_at
from gpmodel.calibration.undeclared import SinusoidProducts, Undeclared, apart_from_effects
from gpmodel.calibration.unobservable import errors_by_region, region_sentences
from gpmodel.model.error_model import ErrorModel, Poses, prepare
from gpmodel.model.sites import geometric_effects, standard_effects


@cache
def touched(
    guilty: bool, pattern: str = "*", zeros: float = 0.0
) -> tuple[list[Calibration], Poses, list[tuple[float, float]]]:
    """Fits of the description and of constants to touches of three planes, and their errors inside and outside."""
    lost = [f"J{k}.moving:Rz:1={zeros} mrad" for k in (2, 3, 4)] if zeros else []
    planted = [*(EFFECTS if guilty else ()), *lost]
    made = gp.simulate(ARM, planted, poses=100, instrument="planes", geometry_sigma="0.3 mm", noise="0.05 mm", seed=1)
    arm = made.truth.mechanism
    poses = prepare(arm, made.table)
    models = [ErrorModel(arm, effects) for effects in ((), standard_effects(arm, (pattern,)))]
    fits = [apart_from_effects(calibrate(model, poses), poses) for model in models]
    return fits, poses, judged(made, fits)


@pytest.mark.parametrize("guilty", [False, pytest.param(True, marks=pytest.mark.long)])
def test_touches_leave_an_arm_no_worse_inside_or_outside_than_its_description(guilty: bool) -> None:
    (nominal_inside, nominal_outside), (inside, outside) = touched(guilty)[2]
    assert inside < 0.1 * nominal_inside
    assert outside < 0.3 * nominal_outside


@pytest.mark.long
@pytest.mark.parametrize("seed", [8, pytest.param(12, marks=pytest.mark.long)])
def test_a_bar_corrects_an_arm_with_undeclared_effects(seed: int) -> None:
    made = gp.simulate(ARM, EFFECTS, poses=120, instrument="bar", geometry_sigma="0.3 mm", noise="0.05 mm", seed=seed)
    arm = made.truth.mechanism
    poses = prepare(arm, made.table)
    models = [ErrorModel(arm, effects) for effects in ((), standard_effects(arm), standard_effects(arm, ("* Rz",)))]
    nominal, *fitted = judged(made, [apart_from_effects(calibrate(model, poses), poses) for model in models])
    for after in fitted:
        assert after[0] < 0.3 * nominal[0]
        assert after[1] < 0.8 * nominal[1]


@pytest.mark.long
def test_later_touches_of_a_machine_with_undeclared_effects_hold() -> None:
    made = gp.simulate(ARM, EFFECTS, poses=160, instrument="planes", geometry_sigma="0.3 mm", noise="0.05 mm", seed=22)
    order = np.random.default_rng(0).permutation(160)
    fitted, later = (made.table.subset(np.sort(part)) for part in (order[:100], order[100:]))
    assert gp.verify(gp.calibrate(ARM, fitted).model, later).verdict.startswith("The model holds")


@pytest.mark.long
def test_joint_zeros_that_were_lost_are_found_whatever_a_maker_tolerates() -> None:
    nominal, after = touched(False, "* Rz", zeros=8.0)[2]
    assert max(after) < 0.3 * min(nominal)


@pytest.mark.first(1)
@pytest.mark.parametrize("guilty", [False, True])
def test_errors_are_foreseen_inside_and_outside_and_said_first(guilty: bool) -> None:
    fits, poses, errors = touched(guilty)
    fit = fits[1]
    unknown = Undeclared.estimated(problem_at(fit, poses), fit.model, fit.theta)
    _, *foreseen = errors_by_region(fit, poses, unknown)
    said = list(region_sentences(fit, poses))
    assert said[0].startswith(f"expected error of a predicted point: {1e3 * foreseen[0]:.2g} mm RMS within")
    assert said[-1].startswith("these measurements do not determine ")
    ratio = 1e3 * np.array(foreseen) / np.array(errors[1])
    assert np.all((ratio > 0.8) & (ratio < 3.0))


@pytest.mark.first(1)
@pytest.mark.parametrize("guilty", [False, True])
def test_a_residual_of_more_than_noise_is_said_and_noise_is_not(guilty: bool) -> None:
    fits, poses, _ = touched(guilty)
    said = " ".join(region_sentences(fits[1], poses))
    assert ("exceeds the noise" in said) == ("gpmodel discover searches" in said) == guilty
    assert "discover" not in " ".join(region_sentences(fits[1], poses, searched=True))


def test_functions_gain_as_much_as_the_likelihood_says() -> None:
    fits, poses, _ = touched(True)
    problem, mechanism = problem_at(fits[1], poses), fits[1].model.mechanism
    effects = problem.columns[:, problem.placement :]
    basis = scipy.linalg.null_space(problem.columns[:, : problem.placement].T)
    waves = SinusoidProducts.of(problem, fits[1].model).values(problem.poses.dataset.q)[problem.pose_of_row]
    known = basis.T @ (problem.residual + effects @ fits[1].theta)
    unknown = Undeclared.estimated(problem, fits[1].model, fits[1].theta)

    def density(sizes: Array, constant: float, noise: float) -> float:
        axes = problem.effect_rows(geometric_effects(mechanism), fits[1].model)
        covariance = (
            ((axes * sizes**2) @ axes.T) * (waves @ waves.T)
            + constant**2 * axes @ axes.T
            + noise**2 * np.eye(len(axes))
        )
        return float(scipy.stats.multivariate_normal.logpdf(known, cov=basis.T @ covariance @ basis))

    without = scipy.optimize.minimize(
        lambda logs: -density(0.0 * unknown.sizes, *np.exp(logs)), np.log([3e-4, 1e-3]), method="Nelder-Mead"
    )
    gain = density(unknown.sizes, unknown.constant, unknown.noise) + without.fun
    assert abs(gain - unknown.gain) < 0.01 * gain


def test_points_in_the_frame_of_an_instrument_show_constants() -> None:
    made = gp.simulate(ARM, poses=40, geometry_sigma="0.3 mm")
    arm = made.truth.mechanism
    poses = prepare(arm, made.table)
    assert not list(region_sentences(calibrate(ErrorModel(arm, standard_effects(arm, ("*",))), poses), poses))


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
    model, chosen = ErrorModel(made.truth.mechanism, geometric_effects(made.truth.mechanism)), gauge.inclusion_order
    fit = calibrate(model, ready(made))

    def turned_round(*given: Any) -> IntArray:
        order = chosen(*given)
        lengths = np.array([model.effects[i].unit == "m" for i in order])
        return np.concatenate([order[lengths], order[~lengths][::-1]])

    monkeypatch.setattr(gauge, "inclusion_order", turned_round)
    other = calibrate(model, ready(made))
    assert (fit.free != other.free).any()
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

"""Scores by projection against plain least squares on the full columns."""

import numpy as np
import pytest

from gpmodel.errors import InputError
from gpmodel.evolution.projection import Targets, regression

POSES, SITES, ENABLED = 40, 5, 6


def planted(seed: int = 0) -> tuple[Targets, np.ndarray, np.ndarray, np.ndarray]:
    """Targets with the sensitivities (S, N, 3), orthonormal columns (3N, K) and residual they came from."""
    rng = np.random.default_rng(seed)
    sensitivity = rng.normal(size=(SITES, POSES, 3))
    columns, _ = np.linalg.qr(rng.normal(size=(3 * POSES, ENABLED)))
    residual = rng.normal(size=3 * POSES)
    residual -= columns @ (columns.T @ residual)
    weight = np.square(sensitivity).sum(axis=2)
    cross = np.einsum("snc,nck->skn", sensitivity, columns.reshape(POSES, 3, ENABLED))
    pull = np.einsum("snc,nc->sn", sensitivity, residual.reshape(POSES, 3))
    names = tuple(f"site {k}" for k in range(SITES))
    return Targets(weight, cross, pull, float(residual @ residual), names), sensitivity, columns, residual


def explained(new: np.ndarray, columns: np.ndarray, residual: np.ndarray) -> tuple[float, np.ndarray]:
    outside = new - columns @ (columns.T @ new)
    coefficients = np.linalg.lstsq(outside, residual, rcond=None)[0]
    left = residual - outside @ coefficients
    return 1.0 - float(left @ left) / float(residual @ residual), coefficients


def test_single_gains_are_those_of_least_squares() -> None:
    targets, sensitivity, columns, residual = planted()
    values = np.random.default_rng(1).normal(size=(7, POSES)) * np.logspace(-6, 6, 7)[:, None]
    gains = np.stack([targets.gains(values, site) for site in range(SITES)], axis=1)
    for p, site in np.ndindex(7, SITES):
        new = (sensitivity[site] * values[p][:, None]).reshape(-1, 1)
        expected, _ = explained(new / np.abs(new).max(), columns, residual)
        assert gains[p, site] == pytest.approx(expected, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("members", [1, 2, 4])
def test_a_set_is_solved_together(members: int) -> None:
    targets, sensitivity, columns, residual = planted(2)
    values = np.random.default_rng(3).normal(size=(members, POSES))
    new = np.stack([(sensitivity[2] * v[:, None]).ravel() for v in values], axis=1)
    gain, coefficients = targets.set_gain(values, 2)
    expected, solution = explained(new, columns, residual)
    assert gain == pytest.approx(expected, rel=1e-9)
    np.testing.assert_allclose(coefficients, solution, rtol=1e-8)
    assert targets.gain_of(values, coefficients, 2) == pytest.approx(gain, rel=1e-9)


def test_a_repeated_direction_adds_nothing_and_gets_no_coefficient() -> None:
    targets, *_ = planted(4)
    value = np.random.default_rng(5).normal(size=POSES)
    alone, _ = targets.set_gain(value[None], 1)
    gain, coefficients = targets.set_gain(np.stack([value, 3.0 * value]), 1)
    assert gain == pytest.approx(alone, rel=1e-9)
    assert np.count_nonzero(coefficients) == 1


def test_a_column_inside_the_enabled_span_scores_nothing() -> None:
    rng = np.random.default_rng(6)
    phi = rng.normal(size=POSES)
    basis, _ = np.linalg.qr(np.stack([phi, np.ones(POSES)], axis=1))
    residual = rng.normal(size=POSES)
    targets = Targets(np.ones((1, POSES)), basis.T[None], residual[None], float(residual @ residual), ("a",))
    assert targets.gains((phi + 1e-5 * rng.normal(size=POSES))[None])[0] == 0.0
    assert targets.set_gain(phi[None], 0)[0] == 0.0


@pytest.mark.parametrize("bad", [np.nan, np.inf, 0.0])
def test_a_basis_that_is_zero_or_not_finite_scores_nothing(bad: float) -> None:
    targets, *_ = planted()
    values = np.full((1, POSES), bad)
    assert not targets.gains(values).any()


def test_regression_is_the_coefficient_of_determination() -> None:
    rng = np.random.default_rng(7)
    x = rng.normal(size=50)
    y = 3.0 + 2.0 * x + 0.3 * rng.normal(size=50)
    gain, coefficients = regression(y).set_gain(x[None], 0)
    assert gain == pytest.approx(np.corrcoef(x, y)[0, 1] ** 2)
    assert coefficients[0] == pytest.approx(np.polyfit(x, y, 1)[0])


def test_shuffling_a_regression_permutes_its_residual() -> None:
    targets = regression(np.random.default_rng(8).normal(size=30))
    shuffled = targets.shuffled(np.random.default_rng(8))
    np.testing.assert_allclose(np.sort(shuffled.pull), np.sort(targets.pull), atol=1e-12)
    assert not np.allclose(shuffled.pull, targets.pull)


def test_shuffled_gains_are_those_of_noise_even_close_to_the_enabled_columns() -> None:
    targets, sensitivity, columns, residual = planted()
    rng = np.random.default_rng(9)
    site, other = 2, rng.normal(size=(400, POSES))
    close = 1.0 + 0.05 * other
    enabled, _ = np.linalg.qr(np.column_stack([columns, sensitivity[site].ravel()]))
    residual = residual - enabled @ (enabled.T @ residual)
    near = Targets(
        targets.weight[[site]],
        np.einsum("nc,nck->kn", sensitivity[site], enabled.reshape(POSES, 3, -1))[None],
        np.einsum("nc,nc->n", sensitivity[site], residual.reshape(POSES, 3))[None],
        float(residual @ residual),
        ("elbow",),
    )
    gram = np.diag(near.weight[0]) - near.cross[0].T @ near.cross[0]
    everything = near.pull[0] @ np.linalg.pinv(gram, rcond=1e-9) @ near.pull[0] / near.energy
    expected = everything / POSES
    for values in (other, close):
        mean = np.mean([near.shuffled(np.random.default_rng(k)).gains(values).mean() for k in range(30)])
        assert mean == pytest.approx(expected, rel=0.15)


@pytest.mark.parametrize("response", [np.ones(5), np.array([1.0, np.nan, 2.0]), np.ones(2)])
def test_a_response_with_nothing_to_explain_is_refused(response: np.ndarray) -> None:
    with pytest.raises(InputError, match="response: "):
        regression(response)


def test_shapes_that_disagree_are_named() -> None:
    targets, *_ = planted()
    with pytest.raises(InputError, match="cross"):
        Targets(targets.weight, targets.cross[:, :, :-1], targets.pull, 1.0, targets.names)


@pytest.mark.parametrize("bad", [None, 0.0, np.nan])
def test_gains_given_a_function_are_those_of_both_together(bad: float | None) -> None:
    targets, *_ = planted(4)
    values = np.random.default_rng(5).normal(size=(21, POSES)) * np.logspace(-4, 4, 21)[:, None]
    values[3], values[4] = 0.0, np.nan
    given = 1e3 * values[20] if bad is None else np.full(POSES, bad)
    gains = targets.gains(values, 1, given)
    for one, gain in zip(values, gains, strict=True):
        usable = np.array([row for row in (one, given) if np.isfinite(row).all()]).reshape(-1, POSES)
        assert gain == pytest.approx(targets.set_gain(usable, 1)[0] if len(usable) else 0.0, rel=1e-9, abs=1e-12)

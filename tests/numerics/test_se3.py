"""Rigid motions against the matrix exponential and their own inverses."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from gpmodel.numerics import se3

twists = st.lists(st.floats(-3.0, 3.0), min_size=6, max_size=6).map(np.array)


@given(twists, st.sampled_from([1.0, 1e-3, 1e-5, 1e-9, 0.0]))
def test_exp_is_the_matrix_exponential(twist: np.ndarray, size: float) -> None:
    twist = size * twist
    generator = np.zeros((4, 4))
    generator[:3, :3], generator[:3, 3] = se3.hat(twist[3:]), twist[:3]
    np.testing.assert_allclose(se3.exp(twist), expm(generator), atol=1e-12)


def test_exp_is_continuous_where_the_series_takes_over() -> None:
    twist = np.array([1.0, -2.0, 0.5, 0.6, 0.0, 0.8])
    twist[3:] *= 1e-4
    below, above = (twist * np.array([1, 1, 1, f, f, f]) for f in (1 - 1e-9, 1 + 1e-9))
    np.testing.assert_allclose(se3.exp(below), se3.exp(above), atol=1e-12)


def test_hat_is_the_cross_product() -> None:
    a, b = np.random.default_rng(0).normal(size=(2, 7, 3))
    np.testing.assert_allclose((se3.hat(a) @ b[..., None])[..., 0], np.cross(a, b), atol=1e-15)


def test_rotation_vector_inverts_exp() -> None:
    turns = np.random.default_rng(1).uniform(-1.7, 1.7, (2, 5, 3))
    rotations = se3.exp(np.concatenate([np.zeros_like(turns), turns], axis=-1))[..., :3, :3]
    np.testing.assert_allclose(se3.rotation_vector(rotations), turns, atol=1e-12)


def test_chain_multiplies_from_the_root() -> None:
    a, b, c = se3.exp(np.random.default_rng(2).normal(size=(3, 4, 6)))
    np.testing.assert_allclose(se3.chain(np.stack([a, b, c]))[2], a @ b @ c, atol=1e-12)


@pytest.mark.parametrize("points", [3, 20])
def test_fit_rotation_finds_the_motion_and_never_a_mirror_image(points: int) -> None:
    rng = np.random.default_rng(points)
    source = rng.normal(size=(points, 3))
    motion = se3.exp(rng.normal(size=6))
    turn, shift = se3.fit_rotation(source, source @ motion[:3, :3].T + motion[:3, 3])
    np.testing.assert_allclose(turn, motion[:3, :3], atol=1e-12)
    np.testing.assert_allclose(shift, motion[:3, 3], atol=1e-12)
    mirrored, _ = se3.fit_rotation(source, source * np.array([1.0, 1.0, -1.0]))
    assert np.linalg.det(mirrored) == pytest.approx(1.0)


@pytest.mark.long
@given(twists, st.sampled_from([0.3, 1e-2, 1e-4, 1e-8, 0.0]))
def test_right_jacobian_is_the_whole_series_however_few_of_its_terms_are_summed(twist: np.ndarray, size: float) -> None:
    twist = size * twist
    ad = np.block([[se3.hat(twist[3:]), se3.hat(twist[:3])], [np.zeros((3, 3)), se3.hat(twist[3:])]])
    whole, term = np.eye(6), np.eye(6)
    for k in range(1, 30):
        term = -term @ ad / (k + 1)
        whole = whole + term
    np.testing.assert_allclose(se3.right_jacobian(np.vstack([twist, 0.5 * twist]))[0], whole, atol=1e-12)


@pytest.mark.parametrize("size", [0.0, 1e-6, 0.3, 2.0, 3.1])
def test_a_small_turn_about_the_outer_axes_changes_the_rotation_vector_as_said(size: float) -> None:
    vector = size * np.array([0.6, -0.48, 0.64])
    there = se3.exp(np.concatenate([np.zeros(3), vector]))[:3, :3]
    step = 1e-6
    found = [
        (se3.rotation_vector(se3.exp(np.concatenate([np.zeros(3), s * step * axis]))[:3, :3] @ there))
        for axis in np.eye(3)
        for s in (1, -1)
    ]
    differences = (np.array(found[::2]) - np.array(found[1::2])).T / (2 * step)
    np.testing.assert_allclose(se3.vector_change(vector), differences, atol=1e-6)

"""Selection on a sample of many poses, and a fit to all."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from effect_cases import bare, measure, mechanism
from group_cases import ARM
from hypothesis import given
from hypothesis import strategies as st

from gpmodel.discovery.loop import discover
from gpmodel.discovery.search import Search
from gpmodel.discovery.state import evenly
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import effect_at
from gpmodel.model.error_model import Poses, prepare

SAMPLE = 60


@cache
def poses_of(count: int) -> Poses:
    return prepare(mechanism(ARM), bare(ARM, count, 4, payload=False))


@given(st.integers(1, 40), st.integers(40, 120), st.integers(0, 9))
def test_of_every_stretch_of_rows_one_is_drawn_and_all_of_few(most: int, count: int, skipped: int) -> None:
    rows = np.arange(count)[skipped:]
    drawn = evenly(poses_of(120), rows, most)
    if 2 * len(rows) <= 3 * most:
        np.testing.assert_array_equal(drawn, rows)
        return
    assert len(drawn) == most
    stretch = (drawn - skipped) * most // len(rows)
    np.testing.assert_array_equal(stretch, np.arange(most))


def test_a_programme_that_steps_through_a_grid_is_seen_at_every_step() -> None:
    """Ten poses have different angles each: every tenth would be at one of them."""
    drawn = evenly(poses_of(1000), np.arange(1000), 100)
    assert len(np.unique(drawn % 10)) == 10


def test_what_was_measured_of_a_pose_again_is_drawn_with_it() -> None:
    poses = poses_of(100)
    again = poses.subset(np.repeat(np.arange(100), 3))
    noise = np.random.default_rng(0).normal(scale=1e-5, size=(300, 3))
    again = prepare(mechanism(ARM), replace(again.dataset, position=noise))
    drawn = evenly(again, np.arange(300), 60)
    assert len(drawn) == 60
    assert (np.unique(drawn // 3, return_counts=True)[1] == 3).all()


@pytest.mark.parametrize(("count", "drawn"), [(60, 60), (61, 61), (90, 90), (91, 60), (300, 60)])
def test_all_are_taken_where_a_third_or_less_would_be_left_out(count: int, drawn: int) -> None:
    assert len(evenly(poses_of(300), np.arange(count), SAMPLE)) == drawn


@pytest.mark.long
@pytest.mark.parametrize("stays", [np.arange(0), np.arange(3), np.arange(1)], ids=["none", "three", "one"])
def test_what_is_found_of_a_sample_is_fitted_to_all_whatever_of_a_set_up_is_in_it(stays: np.ndarray) -> None:
    few, drawn = np.full(300, "first"), evenly(poses_of(300), np.arange(300), SAMPLE)
    few[np.setdiff1d(np.arange(300), drawn)[:4]] = "other"
    few[drawn[stays]] = "other"
    drive = effect_at("drive", "J3.moving", "Ry", Expression("torque_J3"))
    data = replace(bare(ARM, 300, 4, payload=False), labels={"setup": few})
    truth = measure(ARM, (drive,), [3e-7], 4, dataset=data)
    arm, poses = truth.model.mechanism, truth.poses
    train = np.arange(300)
    found = discover(arm, poses, train, train[:0], search=Search(runs=0, scored_poses=SAMPLE))
    (finding,) = found.findings
    assert finding.candidate.name == "joint compliance, J3"
    assert len(found.final.error) == 300
    at = [e.name for e in found.final.model.effects].index(finding.candidate.effects[0].name)
    assert abs(found.final.theta[at] - 3e-7) < 3 * found.final.stderr[at]
    assert set(found.final.placement.registration) == {"first", "other"}
    assert np.abs(found.final.error[few == "other"]).max() < 2e-4

"""Observable parameters of the Jacobian, with known and with free angles."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from spherical_cases import JOINT

from experiments.spherical_joint.reductions import (
    COINCIDENT,
    condition_number,
    most_common_reduction,
    observable_in_words,
    reduce_by_svd,
    reduce_in_order,
)
from gpmodel.errors import InputError
from gpmodel.planning.poses import spread_poses
from joints.budget import thesis_columns

PUBLISHED = (1, 2, 3, 4, 5, 6, 11, 12, 14, 15, 19, 22, 25, 26, 27)
POSES = spread_poses(JOINT, 100, np.random.default_rng(0))
ON_AXIS = replace(JOINT, tooling_ball=(0.0, 0.0, 0.04521))


def test_a_hundred_poses_determine_fifteen_parameters_and_the_published_ones_are_kept() -> None:
    columns = thesis_columns(JOINT, POSES)
    assert np.linalg.matrix_rank(columns) == 15
    reduction = reduce_in_order(columns)
    assert reduction.kept == PUBLISHED
    assert reduction.condition < 50


@pytest.mark.parametrize(("either", "other"), list(product((14, 20), (11, 23))))
def test_every_choice_of_table_3_2_has_rank_fifteen(either: int, other: int) -> None:
    chosen = sorted({*PUBLISHED} - {14, 11} | {either, other})
    columns = thesis_columns(JOINT, POSES)[:, [i - 1 for i in chosen]]
    assert np.linalg.matrix_rank(columns) == 15


def test_dropped_parameters_name_the_kept_ones_they_repeat() -> None:
    explained = reduce_in_order(thesis_columns(JOINT, POSES)).explained
    assert (explained[20], explained[23], explained[7], explained[21]) == ((14,), (11,), (1,), (27,))


def test_repeated_trials_by_svd_agree_with_the_published_choices() -> None:
    best, counts = most_common_reduction(JOINT, np.random.default_rng(1), trials=20)
    assert sum(counts.values()) == 20
    for kept in counts:
        assert len(kept) == 15
        assert not set(kept) & set(COINCIDENT)
        assert len({14, 20} & set(kept)) == len({11, 23} & set(kept)) == 1
    assert best.condition < 50
    again, _ = most_common_reduction(JOINT, np.random.default_rng(1), trials=20)
    assert again == best


@pytest.mark.parametrize(("ball", "condition"), [((0.010, 0.008, 0.043), 13.5), ((0.0005, 0.0003, 0.045), 297.0)])
def test_the_condition_depends_on_the_distance_from_the_yaw_axis(
    ball: tuple[float, float, float], condition: float
) -> None:
    columns = thesis_columns(replace(JOINT, tooling_ball=ball), POSES)
    assert condition_number(columns[:, [i - 1 for i in PUBLISHED]]) == pytest.approx(condition, rel=0.1)


def test_on_the_yaw_axis_two_are_lost() -> None:
    columns = thesis_columns(ON_AXIS, POSES)
    assert np.linalg.matrix_rank(columns) == 13
    near = thesis_columns(replace(JOINT, tooling_ball=(1e-6, 0.0, 0.045)), POSES)
    reduction = reduce_by_svd(near, np.random.default_rng(2))
    assert len(reduction.kept) == 13
    assert reduction.condition < 50


def test_a_limit_that_base_and_tooling_ball_exceed_is_refused() -> None:
    with pytest.raises(InputError, match="farther off the yaw axis"):
        reduce_by_svd(thesis_columns(JOINT, POSES), np.random.default_rng(2), limit=1.1)


@pytest.mark.parametrize(("joint", "count", "offsets"), [(JOINT, 7, (14, 15, 19)), (ON_AXIS, 5, (15,))])
def test_free_angles_leave_seven_combinations_or_five(joint, count: int, offsets: tuple[int, ...]) -> None:
    columns = thesis_columns(joint, POSES, angles_known=False)
    assert np.linalg.matrix_rank(columns, tol=1e-9) == count
    words = observable_in_words(joint, POSES)
    assert f"{count} combinations" in words
    for index in (14, 15, 19):
        assert (f"(index {index})" in words) == (index in offsets)

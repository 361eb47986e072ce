"""Held-out poses: never split what belongs together."""

from dataclasses import replace

import numpy as np
import pytest
from effect_cases import bare
from hypothesis import given
from hypothesis import strategies as st

from gpmodel.errors import InputError
from gpmodel.table.dataset import Dataset
from gpmodel.table.split import bundles, folds, hold_out, noise_floor

DATA = bare("ur5", 40)


def labelled(column: str, labels: list[str]) -> Dataset:
    return replace(DATA.subset(np.arange(len(labels))), labels={column: np.array(labels)})


tables = st.builds(
    labelled, st.sampled_from(["group", "repeat"]),
    st.lists(st.sampled_from(["", "a", "b", "c", "d", "long name"]), min_size=12, max_size=40),
).filter(lambda d: bundles(d).max() > 2)  # fmt: skip


@given(tables, st.floats(0.05, 0.6), st.integers(0, 1000))
def test_groups_and_repeats_are_never_split(data: Dataset, fraction: float, seed: int) -> None:
    try:
        train, heldout = hold_out(data, fraction, np.random.default_rng(seed))
    except InputError:
        return
    assert sorted([*train, *heldout]) == list(range(len(data)))
    assert len(train) > 0
    assert len(heldout) > 0
    column = next(iter(data.labels))
    there = [set(data.label(column)[rows]) - {""} for rows in (train, heldout)]
    assert not there[0] & there[1]


@given(tables, st.integers(2, 8), st.integers(0, 1000))
def test_folds_never_split_them_either(data: Dataset, count: int, seed: int) -> None:
    fold = folds(data, count, np.random.default_rng(seed))
    column = next(iter(data.labels))
    for label in set(data.label(column)) - {""}:
        assert len(set(fold[data.label(column) == label])) == 1
    assert set(fold) == set(range(min(count, bundles(data).max() + 1)))


@given(st.integers(0, 1000), st.sampled_from([0.1, 0.3, 0.5]))
def test_single_poses_are_held_out_to_the_number(seed: int, fraction: float) -> None:
    assert len(hold_out(DATA, fraction, np.random.default_rng(seed))[1]) == round(fraction * 40)


def test_a_pose_measured_twice_without_a_label_stays_together() -> None:
    q = DATA.q.copy()
    q[30:] = q[:10]
    data = replace(DATA, q=q, payload=np.zeros(40))
    for seed in range(10):
        _, heldout = hold_out(data, 0.3, np.random.default_rng(seed))
        assert {h % 30 for h in heldout if h % 30 < 10} == {h - 30 for h in heldout if h >= 30}


def test_the_seed_alone_decides() -> None:
    first, second, other = (hold_out(DATA, 0.3, np.random.default_rng(s))[1].tolist() for s in (3, 3, 4))
    assert first == second != other


@pytest.mark.parametrize("fraction", [0.0, 1.0, -0.3, 30.0])
def test_a_share_is_between_0_and_1(fraction: float) -> None:
    with pytest.raises(InputError, match=r"--holdout .*expected a share between 0 and 1"):
        hold_out(DATA, fraction, np.random.default_rng(0))


def test_one_group_leaves_nothing_to_hold_out() -> None:
    with pytest.raises(InputError, match="expected at least 2 groups"):
        hold_out(labelled("group", ["all"] * 20), 0.3, np.random.default_rng(0))


def test_the_noise_floor_is_the_three_dimensional_spread_of_repeats() -> None:
    rng = np.random.default_rng(0)
    sigma = 4e-5
    labels = [str(i // 4) for i in range(400)]
    position = np.repeat(rng.normal(size=(100, 3)), 4, axis=0) + sigma * rng.normal(size=(400, 3))
    data = Dataset(
        joints=("J1",), q=np.zeros((400, 1)), position=position, rotation=np.full((400, 3), np.nan),
        row=np.arange(400), payload=np.zeros(400), labels={"repeat": np.array(labels)},
    )  # fmt: skip
    assert noise_floor(data) == pytest.approx(np.sqrt(3) * sigma, rel=0.08)


def test_no_noise_floor_without_repeats() -> None:
    assert noise_floor(DATA) is None
    assert noise_floor(labelled("repeat", [str(i) for i in range(20)])) is None

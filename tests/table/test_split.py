"""Test that held-out splits never divide poses that belong together."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_cases import one_line, run
from effect_cases import bare
from hypothesis import given
from hypothesis import strategies as st

import gpmodel as gp
from gpmodel.errors import InputError
from gpmodel.table.blocks import check_repeats, folds, hold_out, noise_floor, repeat_blocks, replicates
from gpmodel.table.dataset import Dataset, unmeasured

DATA = bare("ur5", 40)


def labelled(column: str, labels: list[str]) -> Dataset:
    return replace(DATA.subset(np.arange(len(labels))), labels={column: np.array(labels)})


tables = st.builds(
    labelled, st.sampled_from(["group", "repeat"]),
    st.lists(st.sampled_from(["", "a", "b", "c", "d", "long name"]), min_size=12, max_size=40),
).filter(lambda d: repeat_blocks(d).max() > 2)  # fmt: skip


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
    assert set(fold) == set(range(min(count, repeat_blocks(data).max() + 1)))


@given(st.integers(0, 1000), st.sampled_from([0.2, 0.3, 0.5]))
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
    with pytest.raises(InputError, match=r"holdout: .*expected a share above 0 and below 1"):
        hold_out(DATA, fraction, np.random.default_rng(0))


def test_one_group_of_all_rows_separates_nothing() -> None:
    alone, grouped = (
        hold_out(d, 0.3, np.random.default_rng(0))
        for d in (labelled("tool", [""] * 20), labelled("group", ["all"] * 20))
    )
    np.testing.assert_array_equal(alone[1], grouped[1])
    one_repeat = labelled("repeat", ["all"] * 20)
    with pytest.raises(InputError, match="expected at least 2 groups"):
        hold_out(one_repeat, 0.3, np.random.default_rng(0))


def test_the_noise_floor_is_the_three_dimensional_spread_of_repeats() -> None:
    rng = np.random.default_rng(0)
    sigma = 4e-5
    labels = [str(i // 4) for i in range(400)]
    position = np.repeat(rng.normal(size=(100, 3)), 4, axis=0) + sigma * rng.normal(size=(400, 3))
    data = replace(unmeasured(["J1"], np.zeros((400, 1))), position=position, labels={"repeat": np.array(labels)})
    assert noise_floor(data) == pytest.approx(np.sqrt(3) * sigma, rel=0.08)


def test_no_noise_floor_without_repeats() -> None:
    assert noise_floor(DATA) is None
    assert noise_floor(labelled("repeat", [str(i) for i in range(20)])) is None


def repeated(jitter: float, times: int = 3, count: int = 20) -> Dataset:
    """Poses measured again and again, the joint values read back with a jitter (rad, standard deviation)."""
    rng = np.random.default_rng(1)
    data = DATA.subset(np.arange(count).repeat(times))
    position = rng.normal(size=(count, 3)).repeat(times, axis=0) + 1e-5 * rng.normal(size=(count * times, 3))
    return replace(
        data, q=data.q + jitter * rng.normal(size=data.q.shape), position=position, payload=np.zeros(len(data))
    )


@pytest.mark.parametrize("jitter", [0.0, 1e-6, 5e-5])
def test_repeats_are_recognised_by_their_joint_values(jitter: float) -> None:
    data = repeated(jitter)
    expected = np.arange(20).repeat(3)
    for codes in (repeat_blocks(data), replicates(data)):
        assert len(np.unique(np.column_stack([codes, expected]), axis=0)) == len(np.unique(codes)) == 20
    assert noise_floor(data) == pytest.approx(np.sqrt(3) * 1e-5, rel=0.3)
    fold = folds(data, 5, np.random.default_rng(0))
    assert len(np.unique(np.column_stack([fold, expected]), axis=0)) == 20


def test_the_order_of_the_rows_does_not_change_the_bundles() -> None:
    data, order = repeated(5e-5), np.random.default_rng(0).permutation(60)
    np.testing.assert_array_equal(repeat_blocks(data.subset(order)), repeat_blocks(data)[order])


def test_a_slow_motion_is_no_single_pose() -> None:
    data = DATA.subset(np.zeros(300, dtype=int))
    moving = replace(data, q=data.q + 1e-4 * np.arange(300)[:, None])
    assert 25 < repeat_blocks(moving).max() < 60


def test_repeats_at_another_payload_or_set_up_stay_in_the_bundle_but_are_no_replicates() -> None:
    data = repeated(0.0, 2)
    other = replace(data, payload=np.tile([0.0, 5.0], 20))
    moved = replace(data, labels={"setup": np.tile(["a", "b"], 20)})
    for changed in (other, moved):
        assert repeat_blocks(changed).max() == 19
        assert noise_floor(changed) is None


def test_a_copied_row_is_no_measurement_of_noise() -> None:
    data = repeated(0.0, 2)
    assert noise_floor(data.subset([*range(40), 7, 9])) == pytest.approx(noise_floor(data))
    assert repeat_blocks(data.subset([*range(40), 7])).max() == 19


def test_one_reading_that_failed_is_no_noise_and_one_far_off_no_repeat() -> None:
    data = repeated(0.0, 2)
    off = np.zeros((40, 3))
    off[7, 0] = 0.02
    there = replace(data, position=data.position + off)
    check_repeats(there)
    assert noise_floor(there) == pytest.approx(noise_floor(data), rel=0.1)
    with pytest.raises(
        InputError, match=r"rows \d+ and \d+ are one pose, but their points lie 1151 mm apart; expected"
    ):
        check_repeats(replace(data, position=data.position + 1.151 / 0.02 * off))


def test_approximate_joint_values_are_repeats_only_by_their_label() -> None:
    data = replace(repeated(0.0, 2), joints_approximate=True)
    assert noise_floor(data) is None
    assert noise_floor(replace(data, labels={"repeat": np.arange(20).repeat(2).astype(str)})) is not None


def test_labelled_repeats_that_are_far_apart_are_refused_by_row() -> None:
    label = np.array([str(i % 20) for i in range(60)])
    check_repeats(replace(repeated(5e-5), labels={"repeat": np.arange(20).repeat(3).astype(str)}))
    with pytest.raises(InputError, match=r"rows \d+ and \d+ have the same repeat label '\d+', but .* differs by"):
        check_repeats(replace(repeated(0.0), labels={"repeat": label}))


@pytest.mark.parametrize("labels", [[], ["a", "a", "b"]])
def test_a_share_that_leaves_nothing_to_train_on_is_said_so(labels: list[str]) -> None:
    data = labelled("group", [*labels, *map(str, range(40 - len(labels)))])
    with pytest.raises(InputError, match=r"holdout: 0\.999 of 40 poses.* leaves none to train on; expected less"):
        hold_out(data, 0.999, np.random.default_rng(0))


SLIDE_AND_TURN = """<robot name="r"><link name="a"/><link name="b"/><link name="c"/>
<joint name="slide" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="0 0 2"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="turn" type="revolute"><parent link="b"/><child link="c"/><origin xyz="0.1 0 0" rpy="0 0 0.5"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


@pytest.mark.parametrize(
    ("turn", "keys"),
    [
        ("turn", ("turn", "turn_x")),
        ("α: axis #1", (r'"\u03b1: axis #1"', "'α: axis #1_x'")),
        ("arm's turn", ('"arm\'s turn"', "'arm''s turn_x'")),
    ],
)
def test_offsets_of_joints_are_what_their_readings_lack(turn: str, keys: tuple[str, str], tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text(SLIDE_AND_TURN.replace('"turn"', f'"{turn}"'), encoding="utf-8")
    lines = ("# found", "slide: 0.01", f"{keys[0]}: 0.2", f"{keys[1]}: 0.003  # m", "head_camera_fx: 0.02")
    (tmp_path / "found.yaml").write_text("\n".join(lines), encoding="utf-8")
    options = ("--nominal", tmp_path / "r.urdf", "--out", tmp_path / "c.urdf")
    done = run("import", tmp_path / "found.yaml", *options)
    assert (done.exit_code, done.stderr) == (0, "left out, no joint of r.urdf: head_camera_fx\n")
    before, after = (gp.load_mechanism(str(tmp_path / name)) for name in ("r.urdf", "c.urdf"))
    q, more = np.array([[0.1, 0.3]]), np.array([[0.11, 0.5]])
    ends = [np.linalg.multi_dot([*arm.transforms(v)[:, 0]]) for arm, v in ((before, more), (after, q))]
    shift = ends[1][:3, 3] - ends[0][:3, 3]
    np.testing.assert_allclose(shift, 0.003 * np.array([np.cos(0.5), np.sin(0.5), 0.0]), atol=1e-12)
    np.testing.assert_allclose(ends[1][:3, :3], ends[0][:3, :3], atol=1e-12)
    assert "left out, no joint of r.urdf: head_camera_fx" in (tmp_path / "c.urdf").read_text()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("elbow: 0.1\n", "found.yaml: has offsets, but none of a joint of r.urdf: elbow"),
        ("slide 0.1\n", "found.yaml, line 1: 'slide 0.1'; expected robot_calibration's offsets, a line `NAME: number`"),
        ("slide: nan\n", "found.yaml, line 1: 'slide: nan'; expected"),
    ],
)
def test_offsets_that_cannot_be_are_one_line(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text(SLIDE_AND_TURN)
    (tmp_path / "found.yaml").write_text(text)
    assert said in one_line(run("import", tmp_path / "found.yaml", "--nominal", tmp_path / "r.urdf"), 2)

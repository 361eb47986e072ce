"""Test the thirty parameters: thesis order, exact kinematics, columns, loads."""

from dataclasses import replace
from itertools import product
from pathlib import Path

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
from gpmodel.mechanism.protocol import AXES, GRAVITY
from gpmodel.mechanism.source import load_mechanism
from gpmodel.numerics import se3
from gpmodel.planning.poses import spread_poses
from joints.budget import ErrorSource, budget_joint, error_budget, read_budget, thesis_columns
from joints.passive_joint import FRAMES, PARAMETERS, THESIS_PARAMETERS, parameter, tooling_ball_position
from joints.settings import DATA
from joints.studies.contact import contact_types

BALL = np.asarray(JOINT.tooling_ball)
POSES = np.random.default_rng(0).uniform(-1.2, 1.2, (40, 3))


def elementary(axis: int, value: float) -> np.ndarray:
    twist = np.zeros(6)
    twist[axis] = value
    return se3.exp(twist)


def thesis_product(q: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    """Figures 3.13 and 3.14 literally: five frames, each Trans Rx Ry Rz with its own joint angle in its own entry."""
    frame = np.eye(4)
    for i in range(len(FRAMES)):
        entries = parameters[6 * i : 6 * i + 6].copy()
        if 1 <= i <= 3:
            entries[2 + i] += q[i - 1]
        if i == 4:
            entries[:3] += BALL
        for axis, value in enumerate(entries):
            frame = frame @ elementary(axis, value)
    return frame[:3, 3]


def test_extended_kinematics_is_the_product_of_the_five_frames() -> None:
    rng = np.random.default_rng(1)
    parameters = np.where(np.arange(PARAMETERS) % 6 < 3, 0.01, 0.3) * rng.standard_normal((40, PARAMETERS))
    expected = [thesis_product(q, p) for q, p in zip(POSES, parameters, strict=True)]
    np.testing.assert_allclose(tooling_ball_position(POSES, parameters, BALL), expected, atol=1e-15)


def test_without_errors_it_is_the_mechanism() -> None:
    tip = se3.chain(JOINT.transforms(POSES))[-1][:, :3, 3]
    np.testing.assert_allclose(tooling_ball_position(POSES, np.zeros(PARAMETERS), BALL), tip, atol=1e-16)


def test_parameters_are_in_the_order_of_the_thesis() -> None:
    assert [p.index for p in THESIS_PARAMETERS] == list(range(1, 31))
    assert all(p.axis == AXES[(p.index - 1) % 6] and p.frame == FRAMES[(p.index - 1) // 6] for p in THESIS_PARAMETERS)
    named = {
        11: ("Ts_Tbr", "Ry"),
        14: ("Tbr_Tbp", "Ty"),
        15: ("Tbr_Tbp", "Tz"),
        22: ("Tbp_Tby", "Rx"),
        25: ("Tby_TCP", "Tx"),
    }
    assert {i: (parameter(i).frame, parameter(i).axis) for i in named} == named


@pytest.mark.parametrize("index", range(1, 31))
def test_the_engines_column_is_the_derivative_of_the_exact_kinematics(index: int) -> None:
    step = np.zeros(PARAMETERS)
    step[index - 1] = 1e-6
    difference = (tooling_ball_position(POSES, step, BALL) - tooling_ball_position(POSES, -step, BALL)) / 2e-6
    column = thesis_columns(JOINT, POSES)[:, index - 1].reshape(-1, 3)
    np.testing.assert_allclose(column, difference, atol=1e-9)


def test_a_payload_turns_the_joints_by_the_slope_of_its_potential() -> None:
    payload = np.full(len(POSES), 1.5)
    loads = JOINT.loads(POSES, payload)
    for k in range(3):
        step = np.zeros(3)
        step[k] = 1e-6
        rise = [tooling_ball_position(POSES + s * step, np.zeros(PARAMETERS), BALL)[:, 2] for s in (1, -1)]
        torque = -1.5 * GRAVITY * (rise[0] - rise[1]) / 2e-6
        np.testing.assert_allclose(loads[f"torque_J{k + 1}"], torque, atol=1e-8)
    assert JOINT.loads(POSES, np.zeros(len(POSES))) == {}


def test_it_is_loaded_by_name_with_no_joint_measured() -> None:
    joint = load_mechanism("spherical-joint")
    assert [(j.name, j.measured) for j in joint.joints] == [("J1", False), ("J2", False), ("J3", False)]
    assert joint.slots == JOINT.slots


def test_impossible_joints_are_refused_in_one_line() -> None:
    with pytest.raises(InputError, match="at the centre of the joint"):
        replace(JOINT, tooling_ball=(0.0, 0.0, 0.0))
    with pytest.raises(InputError, match="no frame named 'flange'"):
        load_mechanism("spherical-joint", frame="flange")
    with pytest.raises(InputError, match="expected \\(poses, 3\\)"):
        JOINT.transforms(np.zeros((4, 2)))


PUBLISHED = (1, 2, 3, 4, 5, 6, 11, 12, 14, 15, 19, 22, 25, 26, 27)
POSES_REDUCTION = spread_poses(JOINT, 100, np.random.default_rng(0))
ON_AXIS = replace(JOINT, tooling_ball=(0.0, 0.0, 0.04521))


def test_a_hundred_poses_determine_fifteen_parameters_and_the_published_ones_are_kept() -> None:
    columns = thesis_columns(JOINT, POSES_REDUCTION)
    assert np.linalg.matrix_rank(columns) == 15
    reduction = reduce_in_order(columns)
    assert reduction.kept == PUBLISHED
    assert reduction.condition < 50


@pytest.mark.parametrize(("either", "other"), list(product((14, 20), (11, 23))))
def test_every_choice_of_table_3_2_has_rank_fifteen(either: int, other: int) -> None:
    chosen = sorted({*PUBLISHED} - {14, 11} | {either, other})
    columns = thesis_columns(JOINT, POSES_REDUCTION)[:, [i - 1 for i in chosen]]
    assert np.linalg.matrix_rank(columns) == 15


def test_dropped_parameters_name_the_kept_ones_they_repeat() -> None:
    explained = reduce_in_order(thesis_columns(JOINT, POSES_REDUCTION)).explained
    assert (explained[20], explained[23], explained[7], explained[21]) == ((14,), (11,), (1,), (27,))


@pytest.mark.long
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
    columns = thesis_columns(replace(JOINT, tooling_ball=ball), POSES_REDUCTION)
    assert condition_number(columns[:, [i - 1 for i in PUBLISHED]]) == pytest.approx(condition, rel=0.1)


def test_on_the_yaw_axis_two_are_lost() -> None:
    columns = thesis_columns(ON_AXIS, POSES_REDUCTION)
    assert np.linalg.matrix_rank(columns) == 13
    near = thesis_columns(replace(JOINT, tooling_ball=(1e-6, 0.0, 0.045)), POSES_REDUCTION)
    reduction = reduce_by_svd(near, np.random.default_rng(2))
    assert len(reduction.kept) == 13
    assert reduction.condition < 50


def test_a_limit_that_base_and_tooling_ball_exceed_is_refused() -> None:
    with pytest.raises(InputError, match="farther off the yaw axis"):
        reduce_by_svd(thesis_columns(JOINT, POSES_REDUCTION), np.random.default_rng(2), limit=1.1)


@pytest.mark.parametrize(("joint", "count", "offsets"), [(JOINT, 7, (14, 15, 19)), (ON_AXIS, 5, (15,))])
def test_free_angles_leave_seven_combinations_or_five(joint, count: int, offsets: tuple[int, ...]) -> None:
    columns = thesis_columns(joint, POSES_REDUCTION, angles_known=False)
    assert np.linalg.matrix_rank(columns, tol=1e-9) == count
    words = observable_in_words(joint, POSES_REDUCTION)
    assert f"{count} combinations" in words
    for index in (14, 15, 19):
        assert (f"(index {index})" in words) == (index in offsets)


def budget(*sources: ErrorSource, seed: int = 0, poses: int = 100, draws: int = 1000):
    return error_budget(JOINT, sources, "systematic", np.random.default_rng(seed), poses, draws)


def source(index: int, half_range: float, distribution: str = "normal") -> ErrorSource:
    return ErrorSource(index, half_range, "systematic", distribution, "test")


def test_three_equal_offsets_give_a_maxwell_distribution() -> None:
    """|e| of three normal components of sigma 1 um: mean 2 sqrt(2/pi), variance 3 - 8/pi. Source: Maxwell."""
    found = budget(*(source(i, 3e-6) for i in (13, 14, 15)))
    mean = 2e-6 * np.sqrt(2 / np.pi)
    assert found.mean == pytest.approx(mean, rel=0.01)
    assert found.worst_case == pytest.approx(mean + 3e-6 * np.sqrt(3 - 8 / np.pi), rel=0.01)
    np.testing.assert_allclose(found.shares, 1 / 3, atol=1e-12)


def test_a_rotation_counts_by_its_lever() -> None:
    """The mean square is four times as large at twice the lever; an offset does not change."""
    sources = source(12, 3e-4), source(14, 3e-6)
    twice = replace(JOINT, tooling_ball=tuple(2 * v for v in JOINT.tooling_ball))
    short, long = (
        error_budget(joint, sources, "systematic", np.random.default_rng(0)).shares for joint in (JOINT, twice)
    )
    assert long[0] / long[1] == pytest.approx(4 * short[0] / short[1])
    assert sum(short) == pytest.approx(1.0)


def test_uniform_and_normal_differ_by_their_deviation_only_in_the_mean_square() -> None:
    flat, bell = budget(source(14, 3e-6, "uniform")), budget(source(14, 3e-6))
    assert np.sqrt(np.mean(flat.distances**2)) == pytest.approx(3e-6 / np.sqrt(3), rel=0.02)
    assert np.sqrt(np.mean(bell.distances**2)) == pytest.approx(1e-6, rel=0.02)
    assert flat.distances.max() <= 3e-6 + 1e-15


def test_the_same_seed_gives_the_same_budget_and_its_histogram_counts_every_draw() -> None:
    first, again = budget(source(14, 3e-6), draws=100), budget(source(14, 3e-6), draws=100)
    np.testing.assert_array_equal(first.distances, again.distances)
    shares, edges = first.histogram(20)
    assert shares.sum() == pytest.approx(1.0)
    assert len(edges) == 21


def test_the_shipped_budget_comes_near_the_published_totals() -> None:
    """Figures 3.18 and 3.19: 0.1 um repeatability, 10 um accuracy, for ranges chosen to that end."""
    sources, settings = read_budget()
    for kind, published in (("stochastic", 0.1e-6), ("systematic", 10e-6)):
        found = error_budget(JOINT, sources, kind, np.random.default_rng(0), settings["poses"], settings["draws"])
        assert found.distances.shape == (100, 1000)
        assert found.worst_case == pytest.approx(published, rel=0.1)


ENTRY = 'range = "1 um"\nkind = "systematic"\ndistribution = "normal"\nsource = "x"\n'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f"[[translation]]\nindex = 31\n{ENTRY}", "index 31; expected 1 to 30"),
        (f"[[translation]]\nindex = 12\n{ENTRY}", "index 12 is 12 Rz Ts_Tbr"),
        (f"[[translation]]\nindex = 14\n{ENTRY}".replace("1 um", "-1 um"), "0 or more"),
        (f"[[translation]]\nindex = 14\n{ENTRY}".replace("1 um", "1"), "quantity with a unit"),
        (f"[[translation]]\nindex = 14\n{ENTRY}".replace("normal", "bell"), "uniform or normal"),
        (f"[[translation]]\nindex = 14\n{ENTRY}".replace("systematic", "both"), "systematic or stochastic"),
        ("[[translation]]\nindex = 14\n", "has no 'range'"),
        ("spin = 1\n", "unknown key 'spin'"),
    ],
)
def test_a_bad_budget_is_refused_in_one_line(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "budget.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=said) as caught:
        read_budget(path)
    assert "\n" not in str(caught.value)


def test_a_budget_of_nothing_is_refused() -> None:
    with pytest.raises(InputError, match="0 systematic sources"):
        error_budget(JOINT, (), "systematic", np.random.default_rng(0))


def test_contact_types_hold_the_figures_the_text_prints() -> None:
    types = {t.name: t for t in contact_types()}
    assert list(types) == ["point", "rolling", "sliding", "fluid"]
    assert [types[n].sphere_fit_max for n in types] == pytest.approx([22e-6, 12e-6, 16e-6, 16e-6])
    assert types["rolling"].calibrated_max == pytest.approx(8e-6)


TYPES = (DATA / "contact_types.toml").read_text()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[[type]]\nname = "magnetic"\n', "type 1: Object missing required field `contact`"),
        (TYPES.replace('name = "point"', "name = true"), "type 1: Expected `str`, got `bool`"),
        (TYPES.replace("supports = 3", "supports = -1", 1), r"type 1: Expected `int` >= 0 - at `\$.supports`"),
        (TYPES.replace('"22 um"', '"-22 um"'), "sphere_fit_max = -2.2e-05, expected above 0 m"),
        (TYPES.replace('"22 um"', '"5 km"'), "sphere_fit_max: '5 km', expected at most 100 m"),
    ],
)
def test_a_contact_type_that_is_none_is_refused(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "types.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=said):
        contact_types(path)


def test_a_tooling_ball_of_radius_zero_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "budget.toml"
    path.write_text('tooling_ball = ["0 mm", "0 mm", "0 mm"]\n')
    _, settings = read_budget(path)
    with pytest.raises(InputError, match="at the centre of the joint"):
        budget_joint(JOINT, settings)

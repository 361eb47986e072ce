"""Test that `check` reports unusual tables and no correct one."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from cli_cases import robot, run, table, write
from instances import some

from gpmodel.checks.judge import check_dataset, refuse
from gpmodel.checks.mixed_up import mixed_up
from gpmodel.checks.notes import flange, least_misfit, registered, unknowns
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import effect_at
from gpmodel.model.error_model import ErrorModel, observe, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.numerics.se3 import exp, rotation_vector
from gpmodel.planning.simulate import Simulation
from gpmodel.table.dataset import Dataset

ARMS = ["irb6400r", "ur5", "panda"]


def warnings_of(mechanism: Mechanism, dataset: Dataset) -> list[str]:
    findings = check_dataset(mechanism, dataset)
    assert {f.severity for f in findings} <= {"warning", "note"}, findings
    return [f.text for f in findings if f.severity == "warning"]


@pytest.mark.parametrize("seed", some(range(3), 0))
@pytest.mark.parametrize("arm", ARMS)
def test_good_tables_of_real_arms_pass_without_a_warning(arm: str, seed: int) -> None:
    mechanism, made = robot(60, seed, arm)
    assert warnings_of(mechanism, made.dataset) == []


def test_nothing_undeclared_is_taken_for_a_misreading() -> None:
    mechanism, made = robot(
        60, geometry_sigma=2e-3, effects=("base_compliance=5e-6", "joint_compliance J3=2e-6"), noise=3e-4
    )
    assert mixed_up(mechanism, made.dataset) is None


def copied(made: Simulation) -> Dataset:
    return made.dataset.subset([*range(60), 7])


def measured_again(made: Simulation) -> Dataset:
    again = made.dataset.subset([*range(60), 7])
    return replace(again, position=again.position + np.array([0.0, 0.0, 1e-5]) * (np.arange(61) == 60)[:, None])


def stretched(made: Simulation) -> Dataset:
    """Measured on an arm whose upper arm is longer than its description."""
    arm = made.model.mechanism
    poses = prepare(arm, made.dataset)
    longer = ErrorModel(arm, (*made.model.effects, effect_at("longer", "J2.moving", "Tz")))
    tip = observe(longer, poses, np.append(made.theta, 0.0496), made.placement).tip[:, :3, 3]
    return replace(made.dataset, position=tip + np.random.default_rng(1).normal(0.0, 3e-5, tip.shape))


def wandering(made: Simulation) -> Dataset:
    """The instrument's error changes every few rows, back and forth."""
    swing = 2e-4 * np.sin(2 * np.pi * np.arange(60) / 8)[:, None]
    return replace(made.dataset, position=made.dataset.position + swing * np.array([1.0, 1.0, 0.0]))


def moved_between_repeats(made: Simulation) -> Dataset:
    """Twenty poses three times each, one of the rows half a millimetre off."""
    again = made.dataset.subset(np.arange(20).repeat(3))
    position = again.position + np.random.default_rng(0).normal(0.0, 2e-5, (60, 3))
    position[12] += 5e-4
    return replace(again, position=position, row=np.arange(1, 61))


def outlier(made: Simulation) -> Dataset:
    shift = np.zeros((60, 3))
    shift[[11, 39]] = (0.004, -0.003, 0.0)
    return replace(made.dataset, position=made.dataset.position + shift)


def moved(made: Simulation) -> Dataset:
    after = (np.arange(60) >= 25)[:, None]
    return replace(made.dataset, position=made.dataset.position + after * np.array([2e-4, 0.0, 1e-4]))


def slipped(made: Simulation) -> Dataset:
    """The reflector half a millimetre farther along the axis of the flange from row 31 on."""
    tip = observe(made.model, prepare(made.model.mechanism, made.dataset), made.theta, made.placement).tip
    after = (np.arange(60) >= 30)[:, None]
    return replace(made.dataset, position=made.dataset.position + 5e-4 * after * tip[:, :3, 2])


def turned_tool(made: Simulation) -> Dataset:
    """A tool turned by 3 deg in its holder from row 31 on, about an axis through the reflector."""
    tip = observe(made.model, prepare(made.model.mechanism, made.dataset), made.theta, made.placement).tip
    turn = exp(np.radians(3.0) * (np.arange(60) >= 30)[:, None] * np.eye(6)[3])[:, :3, :3]
    return replace(made.dataset, rotation=rotation_vector(tip[:, :3, :3] @ turn))


def in_kelvin(made: Simulation) -> Dataset:
    warm = np.linspace(293.0, 297.0, 60)
    return replace(made.dataset, extras={"temperature": warm}, extra_units={"temperature": "degC"})


ODD: dict[str, tuple[Callable[[Simulation], Dataset], tuple[str, ...]]] = {
    "a copied row": (copied, ("rows 8 and 8 contain a measurement twice",)),
    "a link described 49.6 mm too short": (stretched, ("J2 Tz deviates by", "expected less than 10")),
    "neighbours alike": (wandering, ("residuals of neighbouring rows are alike", "drift, or neighbouring rows")),
    "outliers": (outlier, ("2 of 60 readings left out (rows 12, 40)", "5")),
    "the tool slipped": (slipped, ("change along the rows", "after row 30", "'tool'")),
    "a tool that turned": (turned_tool, ("residual of the orientations", "rotated in its holder")),
    "kelvin": (in_kelvin, ("column 'temperature': 295 degC looks like kelvin",)),
    "the set-up moved": (moved, ("change along the rows", "after row 2", "'setup'")),
}


@pytest.mark.parametrize("case", some(ODD, *(case for case in ODD if not case.startswith("a link"))))
def test_odd_tables_are_warned_of(case: str) -> None:
    make, said = ODD[case]
    mechanism, made = robot(60)
    warnings = warnings_of(mechanism, make(made))
    assert len(warnings) == 1, warnings
    for words in said:
        assert words in warnings[0]


@pytest.mark.parametrize("count", [2, 3])
def test_one_position_at_several_poses_is_a_lost_target(count: int) -> None:
    mechanism, made = robot(60)
    position = made.dataset.position.copy()
    position[[4, 20, 50][:count]] = 0.0
    said = any(
        "have one position, 0, 0, 0 mm" in text
        for text in warnings_of(mechanism, replace(made.dataset, position=position))
    )
    assert said == (count > 2)


@pytest.mark.parametrize(("span", "said"), [(0.0, "J4 does not move"), (0.1, "J4 moves only")])
def test_small_joint_ranges_are_warned_of(span: float, said: str) -> None:
    mechanism, made = robot(60)
    q = made.dataset.q.copy()
    q[:, 3] = 0.5 + span * np.linspace(0.0, 1.0, 60)
    tips = prepare(mechanism, replace(made.dataset, q=q))
    position = observe(made.model, tips, made.theta, made.placement).tip[:, :3, 3]
    noisy = position + np.random.default_rng(0).normal(0.0, 3e-5, position.shape)
    warnings = warnings_of(mechanism, replace(made.dataset, q=q, position=noisy))
    assert any(said in text for text in warnings)


def with_rotations(turn: np.ndarray) -> tuple[Mechanism, Dataset]:
    mechanism, made = robot(60)
    tip = observe(made.model, prepare(mechanism, made.dataset), made.theta, made.placement).tip
    return mechanism, replace(made.dataset, rotation=rotation_vector(tip[:, :3, :3]) @ turn.T)


def test_rotations_that_fit_pass_and_those_in_other_axes_are_refused() -> None:
    assert warnings_of(*with_rotations(np.eye(3))) == []
    quarter = exp(np.array([0.0, 0.0, 0.0, 0.0, 0.0, np.pi / 2]))[:3, :3]
    (refused,) = check_dataset(*with_rotations(quarter))
    assert refused.severity == "error"
    assert "rx, ry, rz differ" in refused.text


@pytest.mark.parametrize(("arm", "expected"), [("irb6400r", 27), ("ur5", 27), ("panda", 31)])
def test_unknowns_are_registration_tool_and_what_poses_can_tell_apart(arm: str, expected: int) -> None:
    mechanism, made = robot(10, name=arm)
    assert unknowns(mechanism, made.dataset, geometric_effects(mechanism)) == expected
    assert unknowns(mechanism, made.dataset, ()) == 9


def test_more_setups_and_tools_are_more_unknowns() -> None:
    mechanism, made = robot(10)
    half = np.repeat(["a", "b"], 5)
    labelled = replace(made.dataset, labels={"setup": half, "tool": half})
    assert unknowns(mechanism, labelled, ()) == 18


def test_fewer_parameters_need_fewer_poses() -> None:
    mechanism, made = robot(8)
    poses = prepare(mechanism, made.dataset)
    with pytest.raises(InputError, match="24 measured values for 27 unknowns"):
        refuse(mechanism, poses)
    refuse(mechanism, poses, ())


def test_noise_floor_is_noted() -> None:
    mechanism, made = robot(20)
    twice = made.dataset.subset(np.repeat(np.arange(20), 2))
    noisy = twice.position + np.random.default_rng(0).normal(0.0, 1e-5, (40, 3))
    labelled = replace(twice, position=noisy, labels={"repeat": np.repeat(np.arange(20).astype(str), 2)})
    findings = check_dataset(mechanism, labelled)
    (note,) = [f.text for f in findings if f.severity == "note" and f.text.startswith("noise floor")]
    assert float(note.split()[2]) == pytest.approx(1e-2 * np.sqrt(3), rel=0.25)


def test_check_prints_what_it_found(tmp_path: object) -> None:
    from pathlib import Path

    folder = Path(str(tmp_path))
    path = write(table(60), folder / "measured.csv")
    result = run("check", path, "--mechanism", "irb6400r", "--out", folder / "out")
    assert result.exit_code == 0
    assert "60 poses of irb6400r" in result.stdout
    assert "no warnings" in result.stdout
    assert (folder / "out" / "check.json").exists()
    assert run("check", path, "--mechanism", "irb6400r", "--quiet").stdout == ""


def test_distances_that_fit_pass() -> None:
    mechanism, made = robot(60)
    placement = replace(made.placement, anchors={"distance_A": np.array([2.0, 1.0, 0.3, -0.02])})
    named = replace(made.dataset, distances={"distance_A": np.zeros(60)})
    length = observe(made.model, prepare(mechanism, named), made.theta, placement).distances[:, 0]
    noisy = length + np.random.default_rng(0).normal(0.0, 3e-5, 60)
    unmeasured = np.full((60, 3), np.nan)
    assert warnings_of(mechanism, replace(named, position=unmeasured, distances={"distance_A": noisy})) == []


def test_a_few_gross_errors_are_no_misreading() -> None:
    mechanism, made = robot(60)
    position = made.dataset.position.copy()
    position[[3, 30]] = position[[30, 3]]
    assert mixed_up(mechanism, replace(made.dataset, position=position)) is None


@pytest.mark.long
def test_two_tools_are_no_misreading() -> None:
    mechanism, made = robot(60)
    half = np.arange(60) % 2 == 0
    tips = [
        observe(made.model, prepare(mechanism, made.dataset), made.theta, replace(made.placement, tool={"": tool})).tip
        for tool in (made.placement.tool[""], exp(np.array([0.3, 0.2, 0.5, 0.0, 0.0, 0.0])))
    ]
    position = np.where(half[:, None], tips[0][:, :3, 3], tips[1][:, :3, 3])
    labels = {"tool": np.where(half, "short", "long")}
    assert mixed_up(mechanism, replace(made.dataset, position=position)) is not None
    assert mixed_up(mechanism, replace(made.dataset, position=position, labels=labels)) is None


@pytest.mark.parametrize("arm", ARMS)
def test_no_registration_and_tool_come_below_the_least_misfit(arm: str) -> None:
    mechanism, made = robot(40, name=arm)
    position = made.dataset.position + np.random.default_rng(0).normal(0.0, 0.01, (40, 3))
    frames = flange(mechanism, made.dataset.q)
    bound = least_misfit(frames, position)
    reached = root_mean_square(registered(frames, position).errors(frames, position))
    assert 0.5 * reached < bound <= reached


def test_a_repeat_that_lies_elsewhere_is_named() -> None:
    mechanism, made = robot(60)
    said = warnings_of(mechanism, moved_between_repeats(made))
    assert any("rows 13 repeat a pose, but differ by up to 0.8" in text for text in said), said


def test_a_repeated_pose_needs_no_label() -> None:
    mechanism, made = robot(60)
    again = measured_again(made)
    assert warnings_of(mechanism, again) == []
    assert any("noise floor" in text for text in notes_of(mechanism, again))


def notes_of(mechanism: Mechanism, dataset: Dataset) -> list[str]:
    return [f.text for f in check_dataset(mechanism, dataset) if f.severity == "note"]


def test_the_notes_say_what_fits_what_is_left_out_and_what_to_measure_next() -> None:
    mechanism, made = robot(20)
    holes = made.dataset.position.copy()
    holes[4, 2] = np.nan
    data = replace(made.dataset, position=holes, ignored=("operator",), empty_rows=2)
    said = " | ".join(notes_of(mechanism, data))
    for words in (
        ("residual of the fitted poses: registration and "
        "tool"), "standard model 0.0", "20 different poses and 59 measured values",
        "for 27 unknowns: 2.2 each", "masses of the links are known; the tool carries 0 kg", "not used: operator",
        "2 rows without a single cell", "1 rows lack some of x, y, z: 5", "the noise floor is unknown",
        "to measure next: a few poses three times each", "more poses",
    ):  # fmt: skip
        assert words in said, (words, said)

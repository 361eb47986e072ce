"""A joint that hardly moves the reflector, read otherwise than it was meant; rotations in another convention."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from cli_cases import robot
from scipy.spatial.transform import Rotation

from gpmodel.checks.rotations import rotations_flaw
from gpmodel.checks.weak_columns import misread
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.error_model import observe, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics.se3 import shift
from gpmodel.table.dataset import Dataset


def measured(offset: float, seed: int = 1, rotations: bool = False) -> tuple[Mechanism, Dataset]:
    """A ur10 whose reflector stands `offset` m off the axis of its last joint."""
    mechanism, made = robot(60, seed, "ur10")
    flange = np.array([offset, 0.0, 0.05])
    placement = replace(made.placement, tool={"": shift(flange)})
    tip = observe(made.model, prepare(mechanism, made.dataset), made.theta, placement).tip
    noise = np.random.default_rng(seed).normal(0.0, 3e-5, (60, 3))
    data = replace(made.dataset, position=tip[:, :3, 3] + noise)
    return mechanism, replace(data, rotation=Rotation.from_matrix(tip[:, :3, :3]).as_rotvec()) if rotations else data


def column(data: Dataset, change: Callable[[np.ndarray], np.ndarray]) -> Dataset:
    q = data.q.copy()
    q[:, 5] = change(q[:, 5])
    return replace(data, q=q)


WRONG: dict[str, tuple[Callable[[np.ndarray], np.ndarray], str]] = {
    "flipped": (np.negative, "looks counted the other way round"),
    "degrees as radians": (np.degrees, "looks like [deg], given as radians"),
}


@pytest.mark.parametrize("offset", [1.5e-3, pytest.param(3e-4, marks=pytest.mark.long)])
@pytest.mark.parametrize("case", WRONG)
def test_a_wrist_that_is_read_wrongly_is_named_though_it_leaves_a_millimetre(case: str, offset: float) -> None:
    mechanism, data = measured(offset)
    change, said = WRONG[case]
    text = misread(mechanism, column(data, change), geometric_effects(mechanism))
    assert text is not None
    assert f"column '{mechanism.joints[5].name}'" in text
    assert said in text


@pytest.mark.parametrize("change", ["shuffled", "one row late"])
@pytest.mark.parametrize("offset", [1.5e-3, pytest.param(3e-4, marks=pytest.mark.long)])
def test_a_wrist_of_other_poses_is_named(change: str, offset: float) -> None:
    mechanism, data = measured(offset)
    rng = np.random.default_rng(2)
    text = misread(
        mechanism,
        column(data, rng.permutation if change == "shuffled" else lambda q: np.roll(q, 1)),
        geometric_effects(mechanism),
    )
    assert f"column '{mechanism.joints[5].name}' does not belong to these positions" in (text or "")


@pytest.mark.parametrize("offset", [0.0, 3e-4, 1.5e-3])
def test_a_wrist_that_is_read_rightly_is_not(offset: float) -> None:
    mechanism, data = measured(offset)
    assert misread(mechanism, data, geometric_effects(mechanism)) is None


def written(data: Dataset, convention: str) -> Dataset:
    turn = Rotation.from_rotvec(np.array(data.rotation))
    if convention == "wxyz read as xyzw":
        quaternion = turn.as_quat()
        values = Rotation.from_quat(quaternion[:, [3, 0, 1, 2]]).as_rotvec()
    elif convention == "inverse":
        values = turn.inv().as_rotvec()
    elif convention == "radians read as degrees":
        values = np.radians(turn.as_rotvec())
    elif convention == "shuffled":
        values = np.random.default_rng(0).permutation(data.rotation)
    elif convention == "left-handed":
        values = turn.as_rotvec() * [-1.0, 1.0, -1.0]
    else:
        values = turn.as_euler(convention)
    return replace(data, rotation=values)


@pytest.mark.parametrize(
    ("convention", "said"),
    [
        ("wxyz read as xyzw", "as quaternion wxyz they fit"),
        ("xyz", "as fixed XYZ of rx, ry, rz they fit"),
        ("ZYX", "as intrinsic ZYX of rx, ry, rz they fit"),
        ("zyz", "as fixed ZYZ of rx, ry, rz they fit"),
        ("inverse", "as the inverse they fit"),
        ("radians read as degrees", "as rotation vector in radians they fit"),
        ("left-handed", "as left-handed, y mirrored they fit"),
        ("shuffled", "in no convention by less than"),
    ],
)
def test_rotations_in_another_convention_are_refused_with_the_one_that_fits(convention: str, said: str) -> None:
    mechanism, data = measured(0.02, rotations=True)
    assert rotations_flaw(mechanism, data) is None
    assert said in (rotations_flaw(mechanism, written(data, convention)) or "")

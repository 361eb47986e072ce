"""Test mechanisms by name."""

from pathlib import Path

import numpy as np
import pytest
from robots_cases import STANDARD_DH

from gpmodel.errors import InputError
from robots import load_mechanism, mechanism_names


@pytest.mark.parametrize("name", mechanism_names())
def test_every_name_loads_under_its_name(name: str) -> None:
    mechanism = load_mechanism(name)
    assert mechanism is not None
    assert mechanism.name == name
    assert len(mechanism.joints) >= 5


def test_same_family_different_size() -> None:
    reach = {}
    for name in ("ur3", "ur5", "ur10"):
        arm = load_mechanism(name)
        assert arm is not None
        reach[name] = np.linalg.norm(arm.links[2].placement[:3, 3])
    assert reach["ur3"] < reach["ur5"] < reach["ur10"]


@pytest.mark.parametrize("name", ["spherical-joint", "", "arm.csv", "UR5"])
def test_name_of_no_robot_is_left_to_others(name: str) -> None:
    assert load_mechanism(name) is None


def test_path_to_a_table_of_rows(tmp_path: Path) -> None:
    path = tmp_path / "mine.TOML"
    path.write_text(STANDARD_DH)
    arm = load_mechanism(str(path), frame="tool")
    assert arm is not None
    assert arm.name == "mine"


def test_payload_centre_of_mass_shifts_the_moment() -> None:
    at_flange, ahead = load_mechanism("irb6400r"), load_mechanism("irb6400r", payload_com=(0.5, 0.0, 0.0))
    assert at_flange is not None
    assert ahead is not None
    q, payload = np.zeros((1, 6)), np.array([100.0])
    gained = ahead.loads(q, payload)["moment_base_y"] - at_flange.loads(q, payload)["moment_base_y"]
    np.testing.assert_allclose(gained, 100.0 * 9.81 * 0.5, rtol=1e-12)


@pytest.mark.parametrize("frame", ["nowhere", ""])
@pytest.mark.parametrize("name", ["irb6400r", "ur5"])
def test_unknown_frame(name: str, frame: str) -> None:
    with pytest.raises(InputError, match=f"{name}: no .* named '{frame}'"):
        load_mechanism(name, frame=frame)


@pytest.mark.parametrize("com", [(0.1, 0.2), (0.0, 0.0, float("nan"))])
def test_payload_com_must_be_three_lengths(com: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="three lengths"):
        load_mechanism("ur5", payload_com=com)


def test_joint_values_of_the_wrong_width() -> None:
    arm = load_mechanism("ur5")
    assert arm is not None
    with pytest.raises(InputError, match=r"ur5: joint values have shape \(4, 5\), expected \(poses, 6\)"):
        arm.transforms(np.zeros((4, 5)))

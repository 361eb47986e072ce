"""Test calibrated geometry written as URDF and read again."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from robots_cases import CASES, ODD_URDF, poses, robot, slot_frames

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from robots import load_mechanism
from robots.chain import SerialChain
from robots.urdf import read_urdf
from robots.urdf_export import write_calibrated_urdf


def calibrated(chain: SerialChain, twists: dict[str, Array], q: Array) -> Array:
    """Measured frames (N, 4, 4) of the nominal chain with the twists at its slots."""
    pose = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    for slot, transform in zip(chain.slots, chain.transforms(q), strict=True):
        pose = pose @ transform @ pin.exp6(twists.get(slot, np.zeros(6))).homogeneous
    return pose


@pytest.mark.parametrize("size", [0.0, 1e-3, 0.3])
@pytest.mark.parametrize("case", CASES)
def test_written_file_moves_as_the_chain_with_its_twists(case: str, size: float, tmp_path: Path) -> None:
    chain = robot(case, tmp_path)
    rng = np.random.default_rng(7)
    twists = {slot: size * rng.normal(size=6) for slot in chain.slots}
    frame = write_calibrated_urdf(chain, twists, tmp_path / "calibrated.urdf")
    again = read_urdf(tmp_path / "calibrated.urdf", frame=frame)
    q = poses(chain, rng, 10)
    assert again.joint_names == chain.joint_names
    reread = slot_frames(again, q)[-1]
    np.testing.assert_allclose(reread, calibrated(chain, twists, q), atol=1e-9)
    assert frame in (chain.tool_frame, f"{chain.tool_frame}_calibrated")


@pytest.mark.parametrize("frame", ["wrist", "plate", "flap"])
def test_measured_anywhere_on_the_chain(frame: str, tmp_path: Path) -> None:
    (tmp_path / "odd.urdf").write_text(ODD_URDF)
    chain = read_urdf(tmp_path / "odd.urdf", frame=frame)
    rng = np.random.default_rng(8)
    twists = {slot: 0.1 * rng.normal(size=6) for slot in chain.slots}
    again = read_urdf(tmp_path / "out.urdf", frame=chain.write_urdf(tmp_path / "out.urdf", twists))
    q = poses(chain, rng)
    np.testing.assert_allclose(slot_frames(again, q)[-1], calibrated(chain, twists, q), atol=1e-9)


def test_pitch_of_a_quarter_turn_is_exact(tmp_path: Path) -> None:
    (tmp_path / "odd.urdf").write_text(ODD_URDF)
    chain = read_urdf(tmp_path / "odd.urdf")
    twists = {
        "tool": np.array([0.0, 0.0, 0.0, 0.0, -np.pi / 2, 0.0]),
        "turn.moving": np.array([0, 0, 0, 1e-7, 0, 1e-9]),
    }
    again = read_urdf(tmp_path / "out.urdf", frame=chain.write_urdf(tmp_path / "out.urdf", twists))
    q = poses(chain, np.random.default_rng(9))
    np.testing.assert_allclose(slot_frames(again, q)[-1], calibrated(chain, twists, q), atol=1e-12)


def test_what_was_not_calibrated_stays_as_written(tmp_path: Path) -> None:
    (tmp_path / "odd.urdf").write_text(ODD_URDF.replace("<link", "<!-- kept --><link", 1))
    chain = read_urdf(tmp_path / "odd.urdf")
    chain.write_urdf(tmp_path / "out.urdf", {"lift.fixed": np.array([1e-3, 0, 0, 0, 0, 0])})
    text = (tmp_path / "out.urdf").read_text()
    assert "kept" in text
    assert text.count('rpy="0 0 -0.7"') == text.count('rpy="0.1 0.2 0.3"') == 1
    assert 'rpy="0 1.2 0"' not in text


def test_written_arm_weighs_the_same(tmp_path: Path) -> None:
    chain = load_mechanism("irb6400r")
    assert chain is not None
    again = read_urdf(tmp_path / "out.urdf", frame=chain.write_urdf(tmp_path / "out.urdf"))
    q = poses(chain, np.random.default_rng(10))
    loads, reread = chain.loads(q, np.full(8, 150.0)), again.loads(q, np.full(8, 150.0))
    for name in ("moment_base_x", "moment_base_y", "force_base_z", "torque_J2", "torque_J3"):
        np.testing.assert_allclose(loads[name], reread[name], atol=1e-8)
    np.testing.assert_allclose(again.limits, chain.limits)


def test_a_joint_that_moves_by_twice_its_value_is_refused(tmp_path: Path) -> None:
    chain = replace(robot("irb6400r", tmp_path), coupling=np.diag([1.0, 1.0, 2.0, 1.0, 1.0, 1.0]))
    with pytest.raises(InputError, match="J3 moves by 2 times the joint value; expected factor 1 or -1"):
        chain.write_urdf(tmp_path / "out.urdf")


@pytest.mark.parametrize(
    ("slot", "twist"), [("J9.fixed", np.zeros(6)), ("base", np.zeros(3)), ("base", np.full(6, np.nan))]
)
def test_bad_twist(slot: str, twist: Array, tmp_path: Path) -> None:
    chain = load_mechanism("irb6400r")
    assert chain is not None
    with pytest.raises(InputError, match="expected six finite numbers at one of base"):
        chain.write_urdf(tmp_path / "out.urdf", {slot: twist})
    assert not (tmp_path / "out.urdf").exists()


def test_source_that_has_gone(tmp_path: Path) -> None:
    (tmp_path / "odd.urdf").write_text(ODD_URDF)
    chain = read_urdf(tmp_path / "odd.urdf")
    (tmp_path / "odd.urdf").unlink()
    with pytest.raises(InputError, match="No such file"):
        chain.write_urdf(tmp_path / "out.urdf")


def test_folder_that_is_not_there(tmp_path: Path) -> None:
    chain = load_mechanism("irb6400r")
    assert chain is not None
    with pytest.raises(InputError, match="cannot be written"):
        chain.write_urdf(tmp_path / "none" / "out.urdf")

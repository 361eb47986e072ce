"""Where instrument, tool and anchors start: exact on exact data, and clear where it cannot be."""

from dataclasses import replace

import numpy as np
import pytest
from effect_cases import MECHANISMS, measure

import gpmodel as gp
from gpmodel.calibration.start import start_placement
from gpmodel.errors import InputError
from gpmodel.model.error_model import observe, prepare

SEEN = {
    "position": ("position",),
    "pose": ("position", "rotation"),
    "distance": ("distance",),
    "all": ("position", "rotation", "distance"),
}


@pytest.mark.parametrize("name", ["irb6400r", "ur5", "dh"])
@pytest.mark.parametrize("see", ["position", "pose", "all"])
def test_an_innocent_robot_is_placed_exactly(name: str, see: str) -> None:
    truth = measure(name, (), (), 4, count=25, noise=0.0, geometry=0.0, see=SEEN[see])
    start = start_placement(truth.poses)
    seen = observe(truth.model, truth.poses, truth.theta, start)
    np.testing.assert_allclose(seen.tip[:, :3, 3], truth.poses.dataset.position, atol=1e-6)
    np.testing.assert_allclose(start.tool[""][:3, 3], truth.placement.tool[""][:3, 3], atol=1e-5)
    if see != "position":
        true = observe(truth.model, truth.poses, truth.theta, truth.placement).tip
        np.testing.assert_allclose(seen.tip[:, :3, :3], true[:, :3, :3], atol=1e-6)
    for anchor, point in start.anchors.items():
        np.testing.assert_allclose(point, truth.placement.anchors[anchor], atol=1e-4)


@pytest.mark.parametrize("see", ["position", "pose"])
def test_several_setups_and_tools_are_placed_together(see: str) -> None:
    truth = measure("irb6400r", (), (), 4, count=60, noise=0.0, geometry=0.0, setups=3, tools=2, see=SEEN[see])
    start = start_placement(truth.poses)
    assert list(start.registration) == ["s0", "s1", "s2"]
    assert list(start.tool) == ["t0", "t1"]
    for label, frame in truth.placement.registration.items():
        np.testing.assert_allclose(start.registration[label], frame, atol=1e-5)
    for label, frame in truth.placement.tool.items():
        np.testing.assert_allclose(start.tool[label], frame, atol=1e-5)


def test_a_joint_error_of_a_robot_leaves_a_start_of_its_size() -> None:
    truth = measure("irb6400r", (), (), 4, count=40, geometry=1e-3)
    seen = observe(truth.model, truth.poses, np.zeros_like(truth.theta), start_placement(truth.poses))
    assert np.linalg.norm(seen.tip[:, :3, 3] - truth.poses.dataset.position, axis=1).max() < 0.02


@pytest.mark.parametrize("name", MECHANISMS)
def test_too_few_poses_name_the_setup(name: str) -> None:
    truth = measure(name, (), (), 4, count=5, setups=2)
    data = replace(truth.poses.dataset, labels={"setup": np.array(["s0", "s0", "s0", "s0", "later"])})
    with pytest.raises(InputError, match="setup 'later': 1 poses with x, y and z; registration needs at least 3"):
        start_placement(prepare(truth.model.mechanism, data))


def test_too_few_distances_name_the_column() -> None:
    truth = measure("ur5", (), (), 4, count=20, see=("position", "distance"))
    few = {k: np.where(np.arange(20) < 3, v, np.nan) for k, v in truth.poses.dataset.distances.items()}
    with pytest.raises(InputError, match="column 'distance_0': 3 distances; its anchor needs at least 4"):
        start_placement(prepare(truth.model.mechanism, replace(truth.poses.dataset, distances=few)))


@pytest.mark.long
@pytest.mark.parametrize("seed", [2, 7])
def test_balls_touched_by_an_unknown_tool_are_placed_from_whichever_tool_fits_best(seed: int) -> None:
    """From the flange alone both seeds end in another minimum, centimetres off."""
    made = gp.simulate("irb6400r", poses=40, instrument="spheres", geometry_sigma="1 mm", seed=seed)
    fit = gp.calibrate("irb6400r", made.table, holdout=0).fit[0]
    assert fit.status == "converged"
    assert fit.sigma < 2e-4
    off = fit.placement.tool[""][:3, 3] - made.truth.saved.placement.tool[""][:3, 3]
    assert np.linalg.norm(off) < 0.02


@pytest.mark.long
def test_few_touches_of_balls_hold_constants_enough() -> None:
    """Twenty-eight touches fitted for fifteen numbers of three balls and a tool: some constants are held, none too
    many."""
    made = gp.simulate("irb6400r", poses=40, instrument="spheres", geometry_sigma="1 mm", seed=3)
    result = gp.calibrate("irb6400r", made.table)
    assert [step.calibration.status for step in result.calibrated.steps] == ["converged"] * 2
    assert 10 <= result.calibrated.steps[-1].calibration.kept.sum() < 13
    assert result.fit[0].sigma < 2e-4

"""Test that check names the lens of a camera, and only a lens that is not the described one."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from instrument_cases import ARM, simulated

import gpmodel as gp
from gpmodel.model.instruments import with_observations
from gpmodel.table.dataset import Dataset

NOT_THE_LENS = "the lens of a camera is not the described one"
Numbers = Mapping[str, float]


def changed(instrument: str, poses: int = 40, effect: str = "", k1: float = 0.0, focal: float = 1.0) -> Dataset:
    """A table of a camera with radial distortion k1, and described with a factor on the focal length."""
    made = simulated(instrument, poses, effect=effect)
    camera = made.table.described["cameras"]["camera"]["C"]
    length, centre = (np.array(camera[name]) for name in ("focal_px", "centre_px"))
    offset = np.column_stack([made.table.readings[c] for c in "uv"]) - centre
    seen = centre + offset * (1.0 + k1 * np.sum((offset / length) ** 2, axis=1, keepdims=True))
    lens = {
        "focal_px": (focal * length).tolist(),
        "centre_px": centre.tolist(),
    }
    cameras = {"camera": {"C": {**camera, **lens}}}
    data = replace(made.table, readings={**made.table.readings, **dict(zip("uv", seen.T, strict=True))})
    return with_observations(data, made.truth.mechanism, {**made.table.described, "cameras": cameras})


def texts(data: Dataset) -> list[str]:
    return [finding.text for finding in gp.check(ARM, data).findings if finding.severity != "note"]


WRONG: dict[str, tuple[str, Numbers, tuple[str, ...]]] = {
    "distortion": ("camera", {"k1": -0.12}, ("k1 -0.1",)),
    "focal length": ("camera", {"focal": 0.99}, ("fx 24", "fy 24")),
    "slight distortion": ("hand camera", {"k1": -0.01}, ("k1 -0.0",)),
    "distortion of a camera in the hand": ("hand camera", {"k1": -0.12, "focal": 0.99}, ("fx 24", "k1 -0.1")),
    "a far wrong focal length": ("hand camera", {"focal": 1.3}, ("fx 24", "fy 24")),
}


@pytest.mark.long
@pytest.mark.parametrize(
    "case", [case if case == "slight distortion" else pytest.param(case, marks=pytest.mark.long) for case in WRONG]
)
def test_a_lens_that_is_not_the_described_one_is_named_before_the_robot(case: str) -> None:
    instrument, numbers, expected = WRONG[case]
    said = texts(changed(instrument, **numbers))
    assert NOT_THE_LENS in said[0]
    assert all(word in said[0] for word in expected), said[0]
    assert not any("another machine" in text for text in said)


@pytest.mark.first(1)
@pytest.mark.parametrize("instrument", [pytest.param("camera", marks=pytest.mark.long), "hand camera"])
@pytest.mark.parametrize("effect", ["", "joint_compliance J2=3e-6 rad/Nm"])
def test_a_robot_with_the_described_lens_has_no_wrong_lens(instrument: str, effect: str) -> None:
    assert not any(NOT_THE_LENS in text for text in texts(changed(instrument, effect=effect)))

"""What the standard model hides: a constant that something else could be, at these poses and not at others."""

import numpy as np
import pytest
from spherical_cases import JOINT, OFFSETS

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration
from gpmodel.calibration.rivals import TOLD_APART, rivals_in_words, rivals_of_constants
from gpmodel.families import catalogue
from gpmodel.families.candidate import Candidate
from gpmodel.model.error_model import ErrorModel, Poses, prepare
from gpmodel.model.geometric import geometric_effects
from joints.rig import Rig

LOBES = "out-of-round ball, 2 lobes over J2, lift along z"


def fitted(poses: int, seed: int, lobes: float = 0.0, extra: np.ndarray | None = None) -> tuple[Calibration, Poses]:
    """A rig over ±60 deg with the published offsets, its ball out of round by `lobes` [m]."""
    rng = np.random.default_rng(seed)
    rig = Rig(JOINT, parameters=OFFSETS if not lobes else {})
    q = rig.poses(poses, rng)
    q = q if extra is None else np.vstack([q, extra])
    table = rig.measure(q, rng, None, lambda q, extras: {3: lobes * np.cos(2 * q[:, 1])})
    prepared = prepare(JOINT, table)
    return calibrate(ErrorModel(JOINT, geometric_effects(JOINT)), prepared), prepared


def pool(poses: Poses) -> list[Candidate]:
    return [c for c in catalogue.candidates(JOINT, poses.states) if c.family in ("ball_lobes", "axis_run_out")]


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_an_axis_offset_could_be_a_ball_with_two_lobes_and_the_size_is_its_own(seed: int) -> None:
    """No axis is off, the ball has two lobes of 8 µm: the offset that is fitted names them, and their size."""
    fit, poses = fitted(31, seed, lobes=8e-6)
    rivals = rivals_of_constants(fit, poses, pool(poses))
    found = next(r for r in rivals if r.constant == "J1 Tz" and r.candidate.name == LOBES)
    assert abs(found.value) > 10e-6
    assert found.amplitude == pytest.approx(8e-6, rel=0.3)
    assert found.apart < TOLD_APART


def test_the_poses_it_names_tell_the_two_apart() -> None:
    fit, poses = fitted(31, 0)
    rival = next(r for r in rivals_of_constants(fit, poses, pool(poses)) if r.candidate.name == LOBES)
    assert np.all(rival.difference > 5 * fit.sigma)
    again, more = fitted(31, 0, extra=np.repeat(rival.poses, 3, axis=0))
    assert not [r for r in rivals_of_constants(again, more, pool(more)) if r.candidate.name == LOBES]


def test_a_constant_in_the_noise_has_no_rivals_and_many_poses_leave_no_lobes() -> None:
    fit, poses = fitted(31, 0)
    names = {r.constant for r in rivals_of_constants(fit, poses, pool(poses))}
    sizes = dict(zip((e.name for e in fit.model.effects), np.abs(fit.theta) / fit.stderr, strict=True))
    assert names
    assert all(sizes[name] > 3 for name in names)
    many, everywhere = fitted(400, 0)
    offsets = [r for r in rivals_of_constants(many, everywhere, pool(everywhere)) if r.constant == "J1 Tz"]
    assert not [r for r in offsets if r.candidate.family == "ball_lobes"]


def test_the_sentence_says_what_it_could_be_and_where_to_measure() -> None:
    said = rivals_in_words(*fitted(31, 0))
    assert said.startswith("J1 Tz of −24.4 µm could equally be ")
    assert "these joint values (deg) would tell them apart best: " in said


def test_with_measured_angles_nothing_is_said() -> None:
    known = JOINT.with_angles(measured=True)
    poses = fitted(31, 0)[1]
    fit = calibrate(ErrorModel(known, geometric_effects(known)), prepare(known, poses.dataset))
    assert rivals_in_words(fit, prepare(known, poses.dataset)) == ""

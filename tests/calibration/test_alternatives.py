"""Test the effects that may replace constants of the standard model at the measured poses."""

from dataclasses import replace

import numpy as np
import pytest
from spherical_cases import JOINT, OFFSETS

import gpmodel as gp
from experiments.spherical_joint.rig import Rig
from gpmodel.calibration.alternatives import (
    PLAUSIBLE,
    ROW,
    TOLD_APART,
    UNKNOWNS,
    alternatives_of_constants,
    closest_alternatives,
)
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.linearise import effect_columns
from gpmodel.calibration.result import Calibration, problem_at
from gpmodel.errors import LISTED
from gpmodel.families import catalogue
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.branches import random_poses
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import drive_effect
from gpmodel.model.error_model import ErrorModel, Poses, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.planning.simulate import simulate

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
    rivals = alternatives_of_constants(fit, poses, pool(poses))
    found = next(r for r in rivals if r.constant == "J1 Tz" and r.candidate.name == LOBES)
    assert abs(found.value) > 10e-6
    assert found.amplitude == pytest.approx(8e-6, rel=0.3)
    assert found.distance < TOLD_APART


def test_the_poses_it_names_tell_the_two_apart() -> None:
    fit, poses = fitted(31, 0)
    rival = next(r for r in alternatives_of_constants(fit, poses, pool(poses)) if r.candidate.name == LOBES)
    assert np.all(rival.difference > 5 * fit.sigma)
    again, more = fitted(31, 0, extra=np.repeat(rival.poses, 3, axis=0))
    assert not [r for r in alternatives_of_constants(again, more, pool(more)) if r.candidate.name == LOBES]


@pytest.mark.long
def test_a_constant_in_the_noise_has_no_rivals_and_many_poses_leave_no_lobes() -> None:
    fit, poses = fitted(31, 0)
    names = {r.constant for r in alternatives_of_constants(fit, poses, pool(poses))}
    sizes = dict(zip((e.name for e in fit.model.effects), np.abs(fit.theta) / fit.stderr, strict=True))
    assert names
    assert all(sizes[name] > 3 for name in names)
    many, everywhere = fitted(400, 0)
    offsets = [r for r in alternatives_of_constants(many, everywhere, pool(everywhere)) if r.constant == "J1 Tz"]
    assert not [r for r in offsets if r.candidate.family == "ball_lobes"]


def test_the_sentences_say_what_it_could_be_and_where_to_measure() -> None:
    said = [rival.words(["revolute"] * 3) for rival in closest_alternatives(*fitted(31, 0))]
    assert said
    assert all("may instead be " in text for text in said)
    assert any(text.startswith("J1 Tz of −24.4 µm") for text in said)
    assert any("measurements at these joint values (deg) separate the two causes best: " in text for text in said)


def measured_arm(share: float, extra: np.ndarray | None = None) -> tuple[Calibration, Poses, Mechanism]:
    """An IRB 6400R with errors of its geometry alone, measured over a share of its joints' ranges, and at `extra`."""
    arm = gp.load_mechanism("irb6400r")
    q = random_poses(arm, 90, np.random.default_rng(0))
    q = q.mean(axis=0) + share * (q - q.mean(axis=0))
    q = q if extra is None else np.vstack([q, extra])
    poses = prepare(arm, simulate(arm, q, (), np.random.default_rng(1), noise=3e-5, geometry_sigma=3e-4).dataset)
    return calibrate(ErrorModel(arm, geometric_effects(arm)), poses), poses, arm


@pytest.mark.long
def test_every_rival_says_what_tells_it_apart_in_a_hall_that_stays_at_thirty_degrees() -> None:
    """All families except curves and effects of the rows: other poses, another temperature or instrument, or nothing
    separates them.
    """
    fit, poses, arm = measured_arm(0.2)
    warm = np.random.default_rng(2).uniform(29.9, 30.1, len(poses))
    data = replace(poses.dataset, extras={"temperature": warm}, extra_units={"temperature": "degC"})
    poses = prepare(arm, data)
    few = [c for c in catalogue.candidates(arm, poses.states) if len(c.effects) <= UNKNOWNS and ROW not in c.inputs]
    assert {"instrument_range", "unknown_masses", "joint_bending", "thermal_zero"} <= {c.family for c in few}
    ends = {
        "told": "separate the two causes best: ",
        "warm": "with another temperature would",
        "instrument": "with another instrument would",
        "never": "no joint values separate",
    }
    seen = dict.fromkeys(ends, 0)
    for rival in alternatives_of_constants(fit, poses, few):
        by_session = "instrument" if "instrument" in rival.session_inputs else "warm"
        way = by_session if rival.session_inputs else "told" if rival.difference.max() > 1e-9 else "never"
        assert ends[way] in rival.words(["revolute"] * 6)
        seen[way] += 1
    assert min(seen.values()) >= 1
    growth = next(r for r in alternatives_of_constants(fit, poses, few) if "temperature" in r.session_inputs)
    assert growth.candidate.family == "thermal_growth"
    assert growth.amplitude * (30.0 - 20.0) * 1.175 == pytest.approx(abs(growth.value), rel=0.05)


@pytest.mark.long
def test_a_scale_of_the_instrument_could_be_a_length_where_it_is_small_enough_to_be_believed() -> None:
    """A scale does at all joint values what the length of one link does, the others' being fitted too."""
    fit, poses, arm = measured_arm(0.2)
    scales = [c for c in catalogue.candidates(arm, poses.states) if c.name == "range scale of the instrument"]
    rival = next(r for r in alternatives_of_constants(fit, poses, scales) if r.distance < 0.1)
    assert rival.words(["revolute"] * 6).endswith("with another instrument would separate the two causes")
    prior = scales[0].effects[0].prior
    believed, not_believed = (replace(rival, sizes=np.array([PLAUSIBLE * prior * share])) for share in (0.9, 1.1))
    assert believed.plausible
    assert not not_believed.plausible


@pytest.mark.long
def test_beside_curves_finer_than_the_poses_can_tell_what_is_said_keeps_its_size() -> None:
    """Their priors hold the harmonics: without these no constant would be anything beside them, and anything could
    stand for it."""
    plain, poses, arm = measured_arm(0.2)
    curves = [
        drive_effect(f"{f} {k}, {joint.name}", joint, Expression(f"{f}({k}*{joint.name})"), prior=1e-6)
        for joint in arm.joints for k in range(1, 41) for f in ("sin", "cos")
    ]  # fmt: skip
    fit = calibrate(ErrorModel(arm, (*geometric_effects(arm), *curves)), poses, start=plain)
    few = [c for c in catalogue.candidates(arm, poses.states) if len(c.effects) <= UNKNOWNS and ROW not in c.inputs]
    before, beside = (alternatives_of_constants(f, poses, few) for f in (plain, fit))
    sizes = {(r.constant, r.candidate.name): r.amplitude for r in before}
    both = [r for r in beside if (r.constant, r.candidate.name) in sizes]
    assert len(both) >= 10
    for rival in both:
        assert rival.amplitude == pytest.approx(sizes[rival.constant, rival.candidate.name], rel=0.2)
        assert rival.difference.max(initial=0.0) < 0.1


def eccentricities(arm: Mechanism, poses: Poses) -> list[Candidate]:
    return [c for c in catalogue.candidates(arm, poses.states) if c.family == "eccentricity"]


def test_on_a_whole_workspace_nothing_of_an_arm_is_hidden() -> None:
    fit, poses, _ = measured_arm(1.0)
    assert closest_alternatives(fit, poses) == ()


@pytest.mark.long
def test_over_part_of_its_ranges_an_arm_could_have_eccentric_joints_until_it_is_measured_where_told() -> None:
    fit, poses, arm = measured_arm(0.2)
    assert 0 < len(closest_alternatives(fit, poses)) <= LISTED
    found = alternatives_of_constants(fit, poses, eccentricities(arm, poses))
    rival = next(r for r in found if np.all(r.difference > 5 * fit.sigma))
    again, more, _ = measured_arm(0.2, np.repeat(rival.poses, 3, axis=0))
    left = alternatives_of_constants(again, more, eccentricities(arm, more))
    assert (rival.constant, rival.candidate.name) not in {(r.constant, r.candidate.name) for r in left}


@pytest.mark.long
def test_a_model_that_remembers_the_last_move_by_a_clock_alone_has_rivals() -> None:
    """Poses tried for what tells two causes apart have no clock of their own."""
    fit, poses, arm = measured_arm(0.2)
    minutes = np.arange(len(poses), dtype=float)
    timed = replace(poses.dataset, extras={"time": minutes}, extra_units={"time": "min"})
    poses = prepare(arm, timed)
    play = drive_effect("play", arm.joints[1], Expression("last_move_J2"))
    fit = calibrate(ErrorModel(arm, (*geometric_effects(arm), play)), poses)
    assert 0 < len(closest_alternatives(fit, poses)) <= LISTED


def test_one_projection_a_candidate_gives_what_a_projection_a_constant_does() -> None:
    fit, poses, arm = measured_arm(0.2)
    problem = problem_at(fit, poses)
    for rival in alternatives_of_constants(fit, poses, eccentricities(arm, poses))[:5]:
        k = [e.name for e in fit.model.effects].index(rival.constant)
        held = np.concatenate([np.ones(problem.placement, dtype=bool), fit.free])
        held[problem.placement + k] = False
        columns = effect_columns(rival.candidate.effects, fit.model, problem.poses, problem.observed)
        both = np.column_stack([fit.theta[k] * problem.columns[:, problem.placement + k], problem.weigh(columns)])
        left = both - problem.columns[:, held] @ np.linalg.lstsq(problem.columns[:, held], both, rcond=None)[0]
        sizes = np.linalg.lstsq(left[:, 1:], left[:, 0], rcond=None)[0]
        np.testing.assert_allclose(rival.sizes, sizes, rtol=1e-5, atol=1e-9)
        apart = np.linalg.norm(left[:, 0] - left[:, 1:] @ sizes) / fit.sigma
        assert rival.distance == pytest.approx(apart, rel=1e-4, abs=1e-6)

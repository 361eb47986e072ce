"""Test that an effect of every family is found with its value and a correct standard error."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from effect_cases import MECHANISMS, bare, first_of_each_family, measure, mechanism, sized
from instances import some
from scipy import stats

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.discovery.targets import readable_inputs
from gpmodel.errors import InputError
from gpmodel.families import catalogue
from gpmodel.families.candidate import Candidate
from gpmodel.families.repair_advice import FILE as ADVICE
from gpmodel.families.repair_advice import repair_advice
from gpmodel.mechanism.branches import random_poses
from gpmodel.mechanism.protocol import AXES
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.sites import geometric_effects, sites_of
from gpmodel.planning.simulate import simulate
from gpmodel.table.dataset import unmeasured
from joints import spherical_joint
from joints.hexapod import hexapod
from robots import load_mechanism

REQUIRED = {
    "base_compliance", "joint_bending", "joint_compliance", "eccentricity", "gear_harmonic", "transmission_ripple",
    "backlash_load", "backlash_approach", "gear_ratio", "wrist_coupling", "parallel_bar_closure", "balancing_spring",
    "hardening_stiffness", "thermal_growth", "drift", "set_up_step", "tool_slip",
}  # fmt: skip
LINEAR = ("linear_axis", "cyclic_error")
PLANTED = {(name, f): c for name in ("irb6400r", "ur5") for f, c in first_of_each_family(name, 90, 8).items()}
PLANTED |= {("dh", family): first_of_each_family("dh", 90, 8)[family] for family in LINEAR}
ONCE = {family: (name, family) for name, family in reversed(PLANTED)}.values()
"""The first planted instance of every family."""
ALIASED = 0.03
FEW = 4


def test_every_family_says_sign_check_clause_and_compensation() -> None:
    said = repair_advice()
    assert set(said) == {family.name for family in catalogue.catalogue}
    listed = re.findall(r'"([a-z_]+)"', "".join(re.findall(r"families = .*", ADVICE.read_text(encoding="utf-8"))))
    assert len(listed) == len(set(listed))
    for name, advice in said.items():
        for _, sentence in advice.lines:
            assert sentence[0].isupper(), name
            assert sentence.endswith("."), name
        assert "ISO" in advice.clause, name
        assert len(set(dict(advice.lines).values())) == 4, name


def test_the_required_families_are_there_and_each_says_what_it_is_and_who_says_so() -> None:
    assert set(catalogue.names()) >= REQUIRED
    assert len(catalogue.names()) == len(set(catalogue.names()))
    for family in catalogue.catalogue:
        assert len(family.explanation) > 15
        assert len(family.source) > 5


@pytest.mark.parametrize("name", MECHANISMS)
def test_candidates_are_distinct_finite_and_of_known_families_and_slots(name: str) -> None:
    arm = mechanism(name)
    states = prepare(arm, bare(name, 30, in_order=True)).states
    pool = catalogue.candidates(arm, states)
    assert len(set(pool)) == len({c.name for c in pool}) == len(pool)
    for candidate in pool:
        assert catalogue.family(candidate.family) is not None
        assert candidate.cost > 0
        for effect in candidate.effects:
            assert effect.terms
            assert effect.family == candidate.family
            assert not effect.constant
            assert set(effect.slots) <= set(arm.slots)
            assert all(np.isfinite(t.basis(states)).all() for t in effect.terms)


def test_every_family_has_an_instance_on_some_mechanism() -> None:
    made = {f for name in MECHANISMS for f in first_of_each_family(name, 40)}
    free = spherical_joint()
    made |= {c.family for c in catalogue.candidates(free, prepare(free, bare("spherical-joint", 30)).states)}
    heavy = hexapod()
    q, rng = random_poses(heavy, 30, np.random.default_rng(0)), np.random.default_rng(0)
    loaded = prepare(heavy, simulate(heavy, q, (), rng, payload=np.full(30, 40.0)).dataset)
    made |= {c.family for c in catalogue.candidates(heavy, loaded.states)}
    assert made == set(catalogue.names())


def test_what_the_table_lacks_is_not_offered() -> None:
    data = bare("irb6400r", 30, payload=False)
    without = prepare(mechanism("irb6400r"), type(data)(**{**vars(data), "extras": {}, "extra_units": {}})).states
    families = {c.family for c in catalogue.candidates(mechanism("irb6400r"), without)}
    assert not families & {"thermal_growth", "thermal_zero", "backlash_approach", "payload_deflection", "support_sag"}
    assert "parallel_bar_closure" in families
    on_ur5 = prepare(mechanism("ur5"), bare("ur5", 30)).states
    assert "parallel_bar_closure" not in {c.family for c in catalogue.candidates(mechanism("ur5"), on_ur5)}


def test_a_joint_that_next_to_nothing_pulls_at_has_no_stiffness_to_find() -> None:
    """A wrist that hangs straight down at every pose is an example; elsewhere the load is many times as large."""
    arm = mechanism("ur5")
    states = prepare(arm, bare("ur5", 40)).states
    load, joint = "torque_wrist_1_joint", "wrist_1_joint"

    def yielding(share: float) -> set[str]:
        hanging = replace(states, columns={**states.columns, load: share * states[load]})
        found = [c for c in catalogue.candidates(arm, hanging) if load in c.inputs]
        return {c.family for c in found if c.name.endswith(joint)}

    assert {"joint_compliance", "hardening_stiffness", "backlash_load"} <= yielding(1.0)
    assert not {"joint_compliance", "hardening_stiffness", "backlash_load"} & yielding(1e-4)


def without_priors(candidate: Candidate) -> tuple[Effect, ...]:
    """Its effects as large as one likes; a curve of many keeps the priors that make it smooth."""
    if len(candidate.effects) > FEW:
        return candidate.effects
    return tuple(replace(e, prior=np.inf) for e in candidate.effects)


@pytest.mark.parametrize(("name", "family"), some(PLANTED, *ONCE), ids=str)
def test_a_planted_instance_is_recovered_within_its_deviation(name: str, family: str) -> None:
    effects = without_priors(PLANTED[name, family])
    data = bare(name, 90, 8, in_order=True)
    theta = sized(name, effects, data, 0.4)
    truth = measure(name, effects, theta, 8, dataset=data)
    arm = truth.model.mechanism
    fit = calibrate(ErrorModel(arm, (*geometric_effects(arm), *effects)), truth.poses)
    k = len(theta)
    found = np.arange(len(fit.theta) - k, len(fit.theta))
    seen = found[fit.free[found] & (fit.unique_share[found] > ALIASED)]
    if len(seen) < k:
        assert np.sqrt(np.mean(fit.error**2)) < 1.6 * np.sqrt(3) * 3e-5
        return
    covariance = fit.correlation[np.ix_(seen, seen)] * np.outer(fit.stderr[seen], fit.stderr[seen])
    miss = fit.theta[seen] - theta
    distance = float(miss @ np.linalg.solve(covariance, miss))
    assert distance < stats.chi2(k).ppf(0.9973)
    assert float(theta @ np.linalg.solve(covariance, theta)) > stats.chi2(k).ppf(0.9973)


@pytest.mark.long
def test_most_families_are_told_apart_from_geometry_by_ninety_poses() -> None:
    """So that the recovery test above does not pass by calling everything an alias."""
    alias = 0
    arm = mechanism("irb6400r")
    for (name, _), candidate in PLANTED.items():
        if name == "irb6400r":
            truth = measure(name, (), (), 7, dataset=bare(name, 90, 8, in_order=True))
            fit = calibrate(ErrorModel(arm, (*geometric_effects(arm), *candidate.effects)), truth.poses)
            alias += float(fit.unique_share[-len(candidate.effects) :].min()) < ALIASED
    assert alias <= 2


@pytest.mark.parametrize(
    ("asked", "got"),
    [
        ("gear_harmonic J4", "gear error, 2 per turn, J4"),
        ("eccentricity J1", "eccentricity, 1 per turn, J1"),
        ("base_compliance", "base compliance"),
        ("wrist_coupling J4 J5", "coupling, J4 to J5"),
        ("coupling, J4 to J5", "coupling, J4 to J5"),
        ("transmission_ripple 7 J2", "transmission ripple, 7 per turn, J2"),
    ],
)
def test_an_effect_is_built_by_the_name_written(asked: str, got: str) -> None:
    arm = mechanism("irb6400r")
    effects = catalogue.build(asked, arm, prepare(arm, bare("irb6400r", 30)).states)
    assert all(e.name.split(",")[0] == got.split(",")[0] and e.name.startswith(got) for e in effects)


@pytest.mark.parametrize(
    ("asked", "offered"),
    [
        ("colour", r"\w+, \w+, \w+ and \d+ others"),
        ("", r"\w+, \w+, \w+ and \d+ others"),
        ("gear_harmonics J4", "gear_harmonic, "),
        ("J4", "joint_curve, "),
    ],
)
def test_an_unknown_name_lists_the_nearest_families(asked: str, offered: str) -> None:
    arm = mechanism("irb6400r")
    with pytest.raises((InputError), match=f"is unknown; available: {offered}"):
        catalogue.build(asked, arm, prepare(arm, bare("irb6400r", 30)).states)


def test_a_family_without_that_instance_lists_its_instances() -> None:
    arm = mechanism("irb6400r")
    with pytest.raises(InputError, match=r"does not exist for irb6400r .*; effects of gear_harmonic: gear error.*J1"):
        catalogue.build("gear_harmonic J9", arm, prepare(arm, bare("irb6400r", 30)).states)


def test_j1_is_never_matched_inside_j10(tmp_path: Path) -> None:
    row = "[[joint]]\na_mm = 100\nalpha_deg = 40\nmass_kg = 1\n"
    (tmp_path / "long.toml").write_text('convention = "standard"\n' + 11 * row)
    arm = load_mechanism(str(tmp_path / "long.toml"))
    assert arm is not None
    q = np.random.default_rng(0).uniform(-1, 1, (20, 11))
    names = tuple(j.name for j in arm.joints)
    states = prepare(arm, unmeasured(names, q)).states
    for joint in ("J1", "J10", "J11"):
        effects = catalogue.build(f"gear_ratio {joint}", arm, states)
        assert {e.inputs for e in effects} == {(joint,)}
        assert {s for e in effects for s in e.slots} == {f"{joint}.moving"}


def test_an_alias_counts_joints_in_chain_order() -> None:
    arm = load_mechanism("panda")
    assert arm is not None
    data = bare("irb6400r", 30)
    q = np.random.default_rng(0).uniform(-1, 1, (30, len(arm.joints)))
    states = prepare(arm, type(data)(**{**vars(data), "q": q, "joints": tuple(j.name for j in arm.joints)})).states
    (effect,) = catalogue.build("gear_ratio J2", arm, states)
    assert effect.inputs == (arm.joints[1].name,)


def test_a_load_that_is_zero_but_for_rounding_is_no_input() -> None:
    """The last axis of a palletiser is vertical: gravity has no torque about it, whatever the payload."""
    arm = mechanism("palletiser")
    states = prepare(arm, bare("palletiser", 30)).states
    assert 0.0 < np.ptp(states["payload_torque_J4"]) < 0.1
    read = {name for c in catalogue.candidates(arm, states) for name in c.inputs}
    read |= set(readable_inputs(states, np.arange(30))[0].names)
    assert {"torque_J4", "payload_torque_J4"}.isdisjoint(read)
    assert {"torque_J2", "payload_torque_J2"} <= read


def test_a_link_that_follows_other_joints_has_a_geometry_and_sites() -> None:
    arm = mechanism("palletiser")
    for follower in ("J3_with", "JW"):
        assert {f"{follower} {axis}" for axis in AXES} <= {effect.name for effect in geometric_effects(arm)}
        assert {f"{follower}.moving {axis}" for axis in AXES} <= {site.name for site in sites_of(arm)}


def test_the_amplitude_of_a_curve_has_the_unit_of_its_motion() -> None:
    """Moments of mass, in kg m, have a compliance each in rad/Nm per kg m; together they turn the joint, in rad."""
    arm = mechanism("irb6400r")
    pool = catalogue.candidates(arm, prepare(arm, bare("irb6400r", 30)).states)
    (unknown,) = (c for c in pool if c.name == "compliance with unknown masses, J2")
    assert (unknown.kind, unknown.unit) == ("curve", "rad")
    assert {e.unit for e in unknown.effects} != {"rad"}


@pytest.mark.parametrize("name", ["irb6400r", "ur5", "dh", "palletiser"])
@pytest.mark.parametrize(("column", "unit"), [("temperature", "degC"), ("speed", "mm/s"), ("approach_J2", "1")])
def test_a_coefficient_is_a_motion_per_unit_of_its_column(name: str, column: str, unit: str) -> None:
    """A growth is a motion relative to a length."""
    data = replace(bare(name, 30), extras={column: np.linspace(18.0, 25.0, 30)}, extra_units={column: unit})
    arm, states = mechanism(name), prepare(mechanism(name), data).states
    pool = [c for family in catalogue.catalogue for c in catalogue.instances(family, arm, states)]
    linear = [
        e for c in pool for e in c.effects if all(re.match(rf"{column}( [-+] [\d.]+)?$", str(t.basis)) for t in e.terms)
    ]
    assert linear
    for effect in linear:
        motion = "1" if "growth" in effect.family else "m" if effect.terms[0].axis[0] == "T" else "rad"
        assert effect.unit == motion + ("" if unit == "1" else f"/{unit}")

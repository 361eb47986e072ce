"""Test that an undeclared payload and an undeclared direction of gravity are found from deflections."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import gpmodel as gp
from gpmodel.api.calibrate import checked_poses
from gpmodel.application.exports.make import Place, exports_of
from gpmodel.application.other_loads import OtherLoads, other_loads
from gpmodel.application.true_loads import under_true_loads
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.discovery.loop import discover
from gpmodel.discovery.state import Discovery
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import residual_of
from gpmodel.mechanism.source import LoadedMechanism
from gpmodel.model.error_model import ErrorModel, Poses, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.table.blocks import FOLD_SEED
from gpmodel.table.dataset import Dataset

WEAK = {
    "irb6400r": ("joint_compliance J2=1e-6", "joint_compliance J3=2e-6", "joint_compliance J5=3e-6"),
    "panda": ("joint_compliance panda_joint2=3e-5", "joint_compliance panda_joint4=6e-5"),
    "ur10": ("joint_compliance shoulder_lift_joint=8e-6", "joint_compliance elbow_joint=1.5e-5"),
}
OTHER = {"irb6400r": ("gear_harmonic J1=100 urad",), "panda": ("gear_harmonic panda_joint1=100 urad",)}
PAYLOAD = {"irb6400r": (80.0, (0.1, 0.0, 0.2)), "panda": (2.0, (0.05, -0.03, 0.1)), "ur10": (6.0, (0.0, 0.05, 0.15))}


def measured(
    name: str, seed: int, gravity: tuple[float, ...] | None, loaded: bool, weak: bool = True, declared: str = ""
) -> Dataset:
    """Positions of a weak arm under its true loads, which the returned table does not declare.

    declared: payload column of the table, which the arm carries in addition.
    """
    arm = gp.load_mechanism(name)
    if gravity is not None:
        arm = arm.with_gravity(gravity)
    if loaded:
        mass, point = PAYLOAD[name]
        arm = arm.with_mass(mass, mass * np.array(point))
    effects = (*(WEAK[name] if weak else ()), *OTHER.get(name, ()))
    inputs = {"payload [kg]": declared} if declared else {}
    return gp.simulate(arm, effects, poses=120, seed=seed, noise="0.02 mm", inputs=inputs).table


def judged(name: str, table: Dataset) -> tuple[OtherLoads | None, Poses]:
    arm, poses = checked_poses(gp.load_mechanism(name), table)
    assert isinstance(arm, LoadedMechanism)
    fit = calibrate(ErrorModel(arm, geometric_effects(arm)), poses)
    return other_loads(residual_of(fit, poses, Criteria(), FOLD_SEED), arm), poses


@pytest.mark.first(2)
@pytest.mark.parametrize("declared", ["", pytest.param("1|1", marks=pytest.mark.long), "0|1|2"])
@pytest.mark.parametrize("name", sorted(WEAK))
def test_a_mass_that_is_not_declared_is_found_with_its_centre(name: str, declared: str) -> None:
    found, _ = judged(name, measured(name, 3, None, loaded=True, declared=declared))
    assert found is not None
    assert set(found.said) == {"payload"}
    mass, point = PAYLOAD[name]
    choice, sigma = found.mechanism.choice, found.stderr["payload"]
    off = np.array([choice.added_mass, *choice.added_moment]) - [mass, *(mass * np.array(point))]
    assert np.all(np.abs(off) < 3.5 * sigma)
    assert sigma[0] < 0.4 * mass


@pytest.mark.first(2)
@pytest.mark.parametrize("name", sorted(WEAK))
@pytest.mark.parametrize(("gravity", "loaded"), [((9.81, 0.0, 0.0), False), ((0.0, 5.0, -8.44), True)])
def test_gravity_in_another_direction_is_found(name: str, gravity: tuple[float, ...], loaded: bool) -> None:
    found, _ = judged(name, measured(name, 4, gravity, loaded))
    assert found is not None
    assert "gravity" in found.said
    way = np.array(found.mechanism.choice.gravity) / np.linalg.norm(found.mechanism.choice.gravity)
    assert np.degrees(np.arccos(np.clip(way @ gravity / np.linalg.norm(gravity), -1.0, 1.0))) < 3.0


@pytest.mark.first(2)
@pytest.mark.parametrize("name", sorted(WEAK))
@pytest.mark.parametrize("declared", ["", pytest.param("2|2", marks=pytest.mark.long), "0|1|2"])
@pytest.mark.parametrize("weak", [True, pytest.param(False, marks=pytest.mark.long)])
def test_declared_loads_are_left_alone(name: str, weak: bool, declared: str) -> None:
    assert judged(name, measured(name, 5, None, loaded=False, weak=weak, declared=declared))[0] is None


def test_loads_that_cannot_gain_enough_are_not_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gpmodel.application.other_loads.least_squares", lambda *_, **__: pytest.fail("fitted"))
    assert judged("irb6400r", measured("irb6400r", 5, None, loaded=False))[0] is None


def test_measured_torques_and_machines_without_masses_have_no_other_loads() -> None:
    table = measured("irb6400r", 3, None, loaded=True)
    torque = prepare(gp.load_mechanism("irb6400r"), table).states["torque_J3"]
    assert judged("irb6400r", replace(table, extras={"torque_J3": torque}, extra_units={"torque_J3": "N*m"}))[0] is None


@pytest.mark.long
def test_loads_that_predict_worse_than_the_findings_start_no_second_search() -> None:
    """A wrong payload explains the standard model's residual by 74 nats, and three eccentricities explain it wholly."""
    arm = gp.load_mechanism("irb6400r")
    waves = ("eccentricity J2=800 urad", "eccentricity J3=-900 urad", "eccentricity J5=700 urad")
    table = gp.simulate(arm, (*WEAK["irb6400r"], *waves), poses=120, seed=2, noise="0.02 mm").table
    suggested, _ = judged("irb6400r", table)
    assert suggested is not None
    checked, poses = checked_poses(arm, table)
    searches = list[object]()

    def loop(*args: object, **options: object) -> Discovery:
        searches.append(args[0])
        return discover(*args, **options, search=gp.Search(runs=0, workers=1), errors_alone=True)

    every = np.arange(len(poses))
    found = under_true_loads(partial(loop), Criteria(), checked, poses, every, every[:0])
    assert searches == [checked]
    assert found.loads == ""
    assert sum("eccentricity" in f.candidate.name for f in found.findings) == 3


@pytest.mark.long
@pytest.mark.parametrize(("gravity", "loaded"), [((9.81, 0.0, 0.0), False), (None, True)])
def test_a_saved_model_keeps_the_fitted_loads(tmp_path: Path, gravity: tuple[float, ...] | None, loaded: bool) -> None:
    table = measured("ur10", 3, gravity, loaded)
    found, _ = judged("ur10", table)
    assert found is not None
    model = gp.calibrate(found.mechanism, table, effects=["joint_compliance"]).model
    model.save(tmp_path / "model.json")
    again = gp.load_model(tmp_path / "model.json")
    known, fitted = again.saved.mechanism.choice, found.mechanism.choice
    assert (known.gravity, known.added_mass, known.added_moment) == (
        fitted.gravity,
        fitted.added_mass,
        fitted.added_moment,
    )
    for load, values in found.mechanism.loads(table.q, table.payload).items():
        np.testing.assert_allclose(
            again.saved.mechanism.loads(table.q, table.payload)[load], values, rtol=1e-12, atol=1e-9
        )
    (source,) = (e for e in exports_of(again.saved, Place.of(again.saved)).files if e.file == "exports/model.py")
    assert source.largest < 1e-9


@pytest.mark.long
@pytest.mark.parametrize(("gravity", "loaded"), [((9.81, 0.0, 0.0), False), (None, True)])
def test_discover_names_the_compliances_under_the_true_loads(gravity: tuple[float, ...] | None, loaded: bool) -> None:
    """Under the declared loads the compliance of J5 is 20 times too large, and formulas without a name are found."""
    name = "irb6400r"
    found = gp.discover(name, measured(name, 6, gravity, loaded), search=gp.Search(runs=0, workers=1))
    true = dict(text.split("=") for text in (*WEAK[name], *OTHER[name]))
    assert len(found.findings) == len(true)
    assert "The declared loads do not explain the residual" in found.record.verdict
    for text, value in true.items():
        joint = text.split()[1]
        (finding,) = (f for f in found.findings if joint in f.name)
        if "compliance" in text:
            assert finding.value == pytest.approx(float(value), abs=3 * finding.stderr)


@pytest.mark.long
def test_a_fleet_says_which_machine_carried_an_undeclared_payload() -> None:
    tables = {f"M{k}": measured("irb6400r", 20 + k, None, loaded=k == 2) for k in range(4)}
    found = gp.fleet("irb6400r", tables, ["joint_compliance J2", "joint_compliance J3"], workers=1)
    assert [machine.serial for machine in found.record.machines if machine.loads] == ["M2"]
    assert "M2: The declared loads do not explain the residual" in found.verdict
    true = {"joint compliance, J2": 1e-6, "joint compliance, J3": 2e-6}
    means = {part.name: part for part in found.record.effects if part.name in true}
    assert set(means) == set(true)
    for name, part in means.items():
        assert part.mean == pytest.approx(true[name], abs=3 * part.stderr)

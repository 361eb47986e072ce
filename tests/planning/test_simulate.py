"""Test that simulated tables and their truth files contain the true effects."""

from pathlib import Path

import numpy as np
import pytest
from cli_cases import one_line, robot, run

import gpmodel as gp
from gpmodel.api.table import read_table
from gpmodel.application.model_file import load_model
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.errors import InputError
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.sites import geometric_effects

PLANTED = {
    "catalogue": "base_compliance=3e-7 rad/Nm",
    "joint": "joint_compliance J2=2e-7",
    "pair": "gear_harmonic J4=100 arcsec",
    "written out": "J3.moving:Ry:sin(3*J3)=0.2 mrad",
    "translation": "J2.moving:Tx:cos(J1)=0.3 mm",
}


@pytest.mark.long
@pytest.mark.parametrize("case", PLANTED)
def test_calibration_finds_what_was_planted(case: str) -> None:
    mechanism, made = robot(120, effects=(PLANTED[case],))
    extra = tuple(e for e in made.model.effects if not e.constant)
    truth = made.theta[-len(extra) :]
    assert np.abs(truth).max() > 0
    fit = calibrate(ErrorModel(mechanism, geometric_effects(mechanism) + extra), prepare(mechanism, made.dataset))
    found, sigma = fit.theta[-len(extra) :], fit.stderr[-len(extra) :]
    assert (np.abs(found - truth) < 4 * sigma).all()
    assert (np.abs(truth) > 3 * sigma).any()
    assert fit.sigma == pytest.approx(3e-5, rel=0.2)


def test_a_pair_has_the_amplitude_asked_for() -> None:
    _, made = robot(10, effects=("gear_harmonic J4=100 arcsec",))
    assert np.linalg.norm(made.theta[-2:]) == pytest.approx(100 * np.pi / 648000)


def test_names_that_the_truth_prints_are_taken_again() -> None:
    """A pair is printed as its sine and cosine, each with a value of its own."""
    _, made = robot(10, effects=("gear_harmonic J4=100 arcsec",))
    names = [e.name for e in made.model.effects[-2:]]
    _, again = robot(10, effects=tuple(f"{n}={v!r} rad" for n, v in zip(names, made.theta[-2:].tolist(), strict=True)))
    assert [e.name for e in again.model.effects[-2:]] == names
    assert again.theta[-2:] == pytest.approx(made.theta[-2:])


def test_noise_is_what_was_asked_for() -> None:
    quiet, noisy = (robot(4000, noise=s)[1].dataset.position for s in (0.0, 5e-5))
    assert np.std(noisy - quiet) == pytest.approx(5e-5, rel=0.03)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("base_compliance", "expected NAME=VALUE"),
        ("=3", "expected NAME=VALUE"),
        ("base_compliance=x", "is no value"),
        ("base_compliance=3 kg", "is no value"),
        ("joint_compliance=1e-7", "expected one of joint compliance, J2"),
        ("gremlins=3", "'gremlins' is unknown"),
    ],
)
def test_effects_that_cannot_be_planted(text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        robot(5, effects=(text,))


def test_command_writes_table_and_truth(tmp_path: Path) -> None:
    path = tmp_path / "made.csv"
    arguments = (
        *("simulate", "--mechanism", "irb6400r", "--poses", 25, "--noise", "0mm", "--geometry-sigma", "0.2mm"),
        *("--effect", "thermal_zero J2=10 urad", "--input", "temperature [degC]=20:30", "--input", "payload [kg]=0|50"),
    )
    assert run(*arguments, "--out", path).exit_code == 0
    truth = load_model(tmp_path / "made.truth.json")
    data = read_table(path, truth.mechanism)
    assert len(data) == 25
    assert 20 <= data.extras["temperature"].min() < data.extras["temperature"].max() <= 30
    assert set(data.payload) == {0.0, 50.0}
    said = run("predict", tmp_path / "made.truth.json", path, "--out", tmp_path / "predicted.csv").stdout
    assert float(said.split("max ")[1].split()[0]) < 1e-4


def test_same_seed_same_table_other_seed_another(tmp_path: Path) -> None:
    texts = [run("simulate", "--mechanism", "ur5", "--poses", 5, "--seed", s).stdout for s in (1, 1, 2)]
    assert texts[0] == texts[1] != texts[2]
    assert texts[0].startswith("shoulder_pan_joint [deg],")


@pytest.mark.parametrize(
    "text",
    ["temperature", "temperature [degC]", "t [blorp]=1:2", "t [s]=a:b", "t [s]=1|x", "t [s]=5:1", " [s]=1:2",
     "temperature [degC]=-400:20", "load [N]=1e300", "payload [kg]=-5:5", "x [mm]=1:2", "J1 [deg]=1:2",
     "distance_A [mm]=1:2"],
)  # fmt: skip
def test_inputs_that_cannot_be_read(text: str) -> None:
    line = one_line(run("simulate", "--mechanism", "irb6400r", "--input", text), 2)
    assert "--input" in line


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"effects": ["base_compliance=1e300 rad/Nm"]}, "effects: errors that move a frame by"),
        ({"effects": ["gear_harmonic J4=360 deg"]}, "effects: errors that move a frame by"),
        ({"poses": 10**12}, "poses: 1000000000000, expected a whole number from 1 to 1000000"),
        ({"noise": "1e300 mm"}, r"noise: 1e300 mm, expected at most 1 m, the unit may be wrong"),
        ({"noise": "1e5 px", "instrument": "camera"}, r"noise: 1e5 px, expected at most 1000 px"),
        ({"noise": "0.1 px"}, r"noise: '\[px\]' is no unit of length"),
        ({"noise": "0.03 mm", "instrument": "camera"}, r"noise: '\[mm\]' is no unit of pixels; write \[px\]"),
        ({"geometry_sigma": "2 m"}, r"geometry_sigma: 2 m, expected at most 1 m"),
        ({"noise": "1 km"}, r"noise: 1 km, expected at most 1 m, the unit may be wrong"),
    ],
)
def test_what_no_machine_does_is_refused(asked: dict[str, object], said: str) -> None:
    with pytest.raises(InputError, match=said):
        gp.simulate("irb6400r", **{"poses": 12, **asked})  # type: ignore[arg-type]

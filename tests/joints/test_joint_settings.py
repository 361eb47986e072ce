"""Test the settings of the joint: TOML in SI units, refused in one line."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_cases import one_line, run, write
from spherical_cases import JOINT, OFFSETS

from experiments.spherical_joint.rig import Rig
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.tool_point import find_lever
from gpmodel.errors import InputError
from gpmodel.families import catalogue
from gpmodel.mechanism.source import MechanismChoice, load_mechanism
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics import se3
from gpmodel.table.cells import frame_of
from joints.passive_joint import read_joint
from joints.settings import DATA, load_settings, quantity, read_curve


def test_a_key_is_replaced_and_the_others_stay(tmp_path: Path) -> None:
    table = tmp_path / "mine.toml"
    table.write_text('clearance = "0.5 thou"\n[orifice]\nlaw = "nozzle"\n')
    mine, default = load_settings("film", table), load_settings("film")
    assert mine["clearance"] == pytest.approx(12.7e-6)
    assert mine["orifice"] == default["orifice"] | {"law": "nozzle"}
    assert mine["ball_radius"] == default["ball_radius"]


@pytest.mark.parametrize(
    ("text", "like", "value"),
    [
        ("25.4 mm", "1 m", 25.4e-3),
        ("1in", "25.4 mm", 25.4e-3),
        ("45 deg", "1 rad", np.pi / 4),
        ("0.03445 atm/sccm", "1 Pa s/m^3", 0.03445 * 101325 * 6e7),
        ("23e-6 / K", "1 / K", 23e-6),
        ("23e-6 / delta_degC", "1 / K", 23e-6),
        ("-2 um", "1 m", -2e-6),
    ],
)
def test_quantities_become_si(text: str, like: str, value: float) -> None:
    assert quantity(text, like, "here") == pytest.approx(value)


@pytest.mark.parametrize("text", ["45", 45, True, "mm", "4 kg", "3 mmm", "nan mm", "1 2 mm", "", "20 degC"])
def test_no_unit_no_guess(text: object) -> None:
    with pytest.raises(InputError, match=r"here: .*expected a quantity with a unit, such as '25\.4 mm'"):
        quantity(text, "25.4 mm", "here")


def test_a_temperature_scale_is_no_temperature_unit() -> None:
    with pytest.raises(InputError, match=r"293\.15 K"):
        quantity("20 degC", "293.15 K", "here")


@pytest.mark.parametrize(
    ("study", "text", "words"),
    [
        ("film", "clearence = 1", "bad.toml: unknown key 'clearence', expected one of clearance, "),
        ("film", '[orifice]\nwidth = "1 mm"', "bad.toml: unknown key 'orifice.width', expected one of diameter, "),
        ("film", "orifice = 3", r"bad.toml: orifice = 3, expected a table"),
        ("film", "orifices = 2.5", "bad.toml: orifices = 2.5, expected a whole number"),
        ("film", "orifices = true", "bad.toml: orifices = True, expected a whole number"),
        ("film", "displacements = []", "displacements = .*expected at least one entry"),
        ("film", 'displacements = ["30 um", 3]', r"displacements\[1\]: 3, expected a quantity"),
        ("film", "a = [", "bad.toml: is no TOML"),
        ("preload", "paired = 1", "paired = 1, expected true or false"),
        ("preload", "ring = [{count = 8}]", r"ring\[0\] has no 'force', expected count, force, angle, diameter"),
        ("contact", "[ball]\npoisson = inf", "ball.poisson = inf, expected a finite number"),
        ("stiffness", "[measured]\nfile = 3", "measured.file = 3, expected text"),
    ],
)
def test_bad_tables_are_refused_in_one_line(tmp_path: Path, study: str, text: str, words: str) -> None:
    table = tmp_path / "bad.toml"
    table.write_text(text)
    with pytest.raises(InputError, match=words) as refusal:
        load_settings(study, table)
    assert "\n" not in str(refusal.value)


def test_a_missing_file_is_named() -> None:
    with pytest.raises(InputError, match=r"nowhere\.toml: cannot be read .*; expected a TOML file"):
        load_settings("film", Path("nowhere.toml"))


def test_curves_are_read_in_si_whatever_the_order_of_columns(tmp_path: Path) -> None:
    table = tmp_path / "curve.csv"
    table.write_text("force [kN],note,displacement [mm]\n0.001,a,1\n\n0.002,b,2\n")
    curve = read_curve(table, {"displacement": "um", "force": "N"})
    assert curve["displacement"] == pytest.approx([1e-3, 2e-3])
    assert curve["force"] == pytest.approx([1.0, 2.0])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "the file is empty; expected a header line"),
        ("displacement [um],force\n1,2\n", r"expected a column 'force \[N\]'"),
        ("displacement [um]\n1\n", r"columns displacement \[um\], expected a column 'force \[N\]'"),
        ("displacement [um],force [mm]\n1,2\n", r"\[um\], force \[mm\], expected a column 'force \[N\]'"),
        ("displacement [um],force [N]\n1,2\n1,x\n", "column 'force', row 2: 'x' is no number; expected a number"),
        ("displacement [um],force [N]\n1,\n2,3\n", "column 'force', row 1: empty, expected a number"),
    ],
)
def test_bad_curves_are_refused(tmp_path: Path, text: str, words: str) -> None:
    table = tmp_path / "curve.csv"
    table.write_text(text)
    with pytest.raises(InputError, match=words):
        read_curve(table, {"displacement": "um", "force": "N"})


SPHERICAL, UNIVERSAL = 'kind = "spherical"\n', 'kind = "universal"\n'
LEVER = f'{SPHERICAL}[tooling_ball]\ncentre = ["0 mm", "3 mm", "60 mm"]\n'
ENCODERS = "".join(
    f'[[rotation]]\nname = "{name}"\naxis = "{axis}"\nlower = "-60 deg"\nupper = "60 deg"\nmeasured = true\n'
    for name, axis in (("tilt", "y"), ("swing", "x"))
)
ENCODED = UNIVERSAL + ENCODERS


def joint_file(folder: Path, text: str) -> Path:
    file = folder / "mine.toml"
    file.write_text(text)
    return file


def test_the_printed_defaults_are_the_built_in_joint() -> None:
    assert read_joint(DATA / "spherical_joint.toml") == JOINT == load_mechanism("spherical-joint")


def test_the_tooling_ball_alone_can_be_set(tmp_path: Path) -> None:
    joint = load_mechanism(str(joint_file(tmp_path, LEVER)))
    assert joint == replace(JOINT, name="mine", tooling_ball=(0.0, 0.003, 0.06))


def test_a_universal_joint_with_encoders(tmp_path: Path) -> None:
    joint = load_mechanism(str(joint_file(tmp_path, ENCODED)))
    assert [(j.name, j.measured, j.drive) for j in joint.joints] == [
        ("tilt", True, (("tilt.moving", "Ry", 1.0),)),
        ("swing", True, (("swing.moving", "Rx", 1.0),)),
    ]
    tip = se3.chain(joint.transforms(np.array([[0.3, -0.2]])))[-1, 0, :3, 3]
    lever = 0.1 * np.array([np.sin(0.3) * np.cos(-0.2), -np.sin(-0.2), np.cos(0.3) * np.cos(-0.2)])
    np.testing.assert_allclose(tip, lever, atol=1e-15)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('kind = "ball"', "kind = 'ball', expected 'spherical', 'universal', 'hexapod' or 'tau'"),
        (f'{UNIVERSAL}[socket]\nopening = "3 mm"', "unknown key 'socket'"),
        (f'{SPHERICAL}[tooling_ball]\ncentre = ["0 mm", "0 mm", "0 mm"]', "expected a larger distance"),
        (f'{SPHERICAL}[tooling_ball]\ncentre = ["0 mm", "0 mm"]', "expected three lengths"),
        (f'{SPHERICAL}[tooling_ball]\ncentre = ["0", "0", "60"]', "expected a quantity with a unit"),
        (f'{SPHERICAL}[ball]\ndiameter = "40 mm"', "ball.diameter = 40 mm falls through socket.opening = 49.07"),
        (f'{SPHERICAL}[ball]\ndiameter = "-1 in"', "ball.diameter = -0.0254, expected above 0 m"),
        (f'{SPHERICAL}[tooling_ball]\ncentre = ["0 mm", "0 mm", "20 mm"]', "inside the ball; expected at least"),
        (ENCODED.replace('axis = "x"', 'axis = "y"'), "expected different axes for"),
        (ENCODED.replace("swing", "tilt"), "rotations tilt, tilt, expected different names"),
        (ENCODED.replace('"x"', '"w"'), "axis = 'w', expected x, y or z"),
        (ENCODED.replace("-60", "70"), "lower = 70 deg, expected below upper = 60 deg"),
        (f"{ENCODED}{ENCODERS}", "4 rotations, expected 2 (universal) or 3 (spherical)"),
    ],
)
def test_what_is_no_joint_is_refused_in_one_line(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError) as refusal:
        load_mechanism(str(joint_file(tmp_path, text)))
    assert said in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_angles_said_to_be_measured_need_their_columns(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    rig = Rig(JOINT)
    frame = frame_of(rig.measure(rig.poses(20, rng), rng), JOINT).drop(columns="J2 [deg]")
    frame = frame.drop(columns="J3 [deg]")
    file = joint_file(tmp_path, ENCODED)
    result = run("calibrate", write(frame, tmp_path / "cmm.csv"), "--mechanism", file)
    assert "joint column 'J2' is missing; expected J1, J2 or tilt, swing" in one_line(result, 2)


def test_growth_acts_along_the_lever_that_is_there_not_the_nominal_one() -> None:
    """A lever 12.8 % longer than the built-in one; the share of it that a kelvin adds is the steel's, 12 ppm."""
    share, rng = 12e-6, np.random.default_rng(3)
    lever = 1.128 * np.array(JOINT.tooling_ball)
    rig = Rig(replace(JOINT, tooling_ball=tuple(lever)), parameters=OFFSETS, noise=1e-7, reach=(1.5, 1.2, 1.5))
    warm = rng.uniform(18.0, 26.0, 60)
    growth = {25 + k: share * length * (warm - 20.0) for k, length in enumerate(lever)}
    table = rig.measure(rig.poses(60, rng), rng, {"temperature": ("degC", warm)}, lambda q, extras: growth)
    nominal = MechanismChoice("spherical-joint").load()
    poses = prepare(nominal, table)
    joint = find_lever(nominal, poses)
    (effect,) = catalogue.build("thermal_growth", joint, poses.states)
    fit = calibrate(ErrorModel(joint, (*geometric_effects(joint), effect)), poses)
    assert fit.theta[-1] == pytest.approx(share, rel=0.02)

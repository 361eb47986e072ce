"""Settings: TOML over the thesis' joint, in SI, refused in one line."""

from pathlib import Path

import numpy as np
import pytest

from gpmodel.errors import InputError
from joints.measured import read_curve
from joints.settings import load_settings, quantity

TABLES = ["preload", "contact", "thermal", "film", "stiffness", "dynamics"]


@pytest.mark.parametrize("name", TABLES)
def test_defaults_load_and_laid_over_themselves_change_nothing(name: str) -> None:
    from joints.settings import DATA

    assert load_settings(name) == load_settings(name, DATA / f"{name}.toml")


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
    with pytest.raises(InputError, match=r"here: .*expected a quantity with its unit, such as '25\.4 mm'"):
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
        ("film", "displacements = []", "displacements = .*expected a list that is not empty"),
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

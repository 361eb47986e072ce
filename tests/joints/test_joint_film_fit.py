"""A film calibrated by a measured table of inlet pressure, lift and load."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from gpmodel.errors import InputError
from joints.cli import joint
from joints.film import FilmGeometry
from joints.film_design import design_film
from joints.film_fit import fit_film
from joints.orifice import ATMOSPHERE, SCCM, LinearOrifice, NozzleOrifice
from joints.reynolds import spherical_film

GEOMETRY = FilmGeometry(25.4e-3, np.radians(75.95), np.radians(20), 10.01e-6)
ORIFICES = (LinearOrifice(0.03445 * ATMOSPHERE / SCCM, 0.638 * ATMOSPHERE), NozzleOrifice(100e-6))
LIFT, LOAD = np.tile(np.linspace(10e-6, 40e-6, 8), 2), np.repeat([60.0, 100.0], 8)


def inlets(film, orifice, lift=LIFT, clearance=13e-6, passed=1.6) -> np.ndarray:
    """Return the inlets of a joint with another clearance, whose orifices pass another flow than predicted."""
    made = film(replace(GEOMETRY, clearance=clearance), LOAD, orifice, lift)
    return orifice.inlet_pressure(made.flow / passed, made.socket_pressure)


@pytest.mark.long
@pytest.mark.parametrize("film", [design_film, spherical_film])
@pytest.mark.parametrize("orifice", ORIFICES, ids=lambda o: type(o).__name__)
def test_clearance_and_flow_come_out_within_what_is_stated(film, orifice) -> None:
    exact = fit_film(film, GEOMETRY, orifice, inlets(film, orifice), LIFT, LOAD)
    assert (exact.clearance, exact.passed) == (pytest.approx(13e-6, rel=1e-5), pytest.approx(1.6, rel=1e-5))
    off = []
    for seed in range(40):
        noisy = inlets(film, orifice) * (1 + 0.01 * np.random.default_rng(seed).normal(size=LIFT.size))
        fit = fit_film(film, GEOMETRY, orifice, noisy, LIFT, LOAD)
        off.append([(fit.clearance - 13e-6) / fit.stderr["clearance"], (fit.passed - 1.6) / fit.stderr["passed"]])
        assert fit.rms == pytest.approx(0.01, rel=0.7)
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(off), axis=0)), 1.0, atol=0.35)


def test_one_lift_under_one_load_does_not_tell_clearance_from_flow() -> None:
    fit = fit_film(design_film, GEOMETRY, ORIFICES[0], np.full(5, 3e5), np.full(5, 3e-5), 100.0)
    assert fit.status == "clearance and flow cannot be told apart at these lifts"
    assert np.isnan(fit.stderr["clearance"])


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ("3,20,100\n4,30,100", "2 rows of inlet pressure, lift and load, expected 3 or more"),
        ("3,20,100\n4,30,100\n5,-40,100", "lift = -4e-05, expected above 0 m"),
        ("3,20,100\n4,30,\n5,40,100", "column 'load', row 2: empty, expected a number"),
    ],
)
def test_a_bad_table_is_one_line(rows: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "lift.csv").write_text(f"inlet [atm],lift [um],load [N]\n{rows}\n")
    (tmp_path / "mine.toml").write_text('[measured]\nfile = "lift.csv"\n')
    with pytest.raises(InputError, match=words):
        CliRunner().invoke(joint, ["film", str(tmp_path / "mine.toml")], catch_exceptions=False)


def test_the_command_calibrates_both_films_by_a_table_beside_it(tmp_path: Path) -> None:
    rows = zip(inlets(spherical_film, ORIFICES[0]) / ATMOSPHERE, LIFT * 1e6, LOAD, strict=True)
    text = "\n".join(",".join(map(str, row)) for row in rows)
    (tmp_path / "lift.csv").write_text(f"inlet [atm],lift [um],load [N]\n{text}\n")
    (tmp_path / "mine.toml").write_text('[measured]\nfile = "lift.csv"\n')
    done = CliRunner().invoke(joint, ["film", str(tmp_path / "mine.toml"), "--json", str(tmp_path / "film.json")])
    assert done.exit_code == 0
    assert "Calibrated by lift.csv" in done.output
    flat, sphere = json.loads((tmp_path / "film.json").read_text())["calibrated"].values()
    assert sphere["clearance"] == pytest.approx(13e-6, rel=1e-4)
    assert sphere["rms"] < 1e-6 < flat["rms"]

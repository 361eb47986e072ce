"""Test the flat-plate air film: Table 4.2 by cells, misprints, a measured film, squeezed air."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from gpmodel.errors import InputError
from joints.cli import joint
from joints.film import (
    FilmGeometry,
    design_film,
    displacement_at_inlet,
    edge_gap,
    film_pressure,
    film_resistance,
    pad_load,
    stiffness_constant_flow,
    supporting_pressure,
)
from joints.orifice import ATMOSPHERE, SCCM, LinearOrifice, NozzleOrifice, Orifice
from joints.reynolds import spherical_film, squeeze_impedance
from joints.studies.film import fit_film

DEG = np.pi / 180
JOINT = FilmGeometry(25.4e-3, 75.95 * DEG, 20 * DEG, 10.01e-6)
PRELOAD = 100.69
ORIFICES: list[Orifice] = [LinearOrifice(), NozzleOrifice(50.8e-6, 1.0)]


def test_pad_load_integrates_the_pressure_profile() -> None:
    l = np.linspace(0, JOINT.outer_length, 200001)
    integral = np.trapezoid(film_pressure(JOINT, 5e4, l) * 2 * np.pi * l, l)
    assert float(pad_load(JOINT, 5e4)) == pytest.approx(integral, rel=1e-7)


def test_film_resistance_obeys_the_flow_equation() -> None:
    """Q = -pi l h^3 / (6 mu) dP/dl at every radius (Fig 4.8)."""
    h, socket = 15e-6, 5e4
    l = np.linspace(JOINT.orifice_length * 1.01, JOINT.outer_length * 0.99, 2001)
    slope = np.gradient(film_pressure(JOINT, socket, l), l, edge_order=2)
    flow = -np.pi * l * h**3 / (6 * JOINT.viscosity) * slope
    assert flow == pytest.approx(np.full(2001, socket / float(film_resistance(JOINT, h))), rel=1e-4)


@pytest.mark.parametrize("orifice", ORIFICES, ids=["linear", "nozzle"])
@pytest.mark.parametrize("lift", [32e-6, 50e-6])
def test_stiffnesses_are_slopes_of_the_load(orifice: Orifice, lift: float) -> None:
    at = design_film(JOINT, PRELOAD, orifice, lift)
    step = 1e-9

    def load_at_inlet(d: float) -> float:
        low, high = 0.0, float(at.inlet_pressure)
        resistance = float(film_resistance(JOINT, edge_gap(JOINT, d)))
        for _ in range(200):
            socket = (low + high) / 2
            feed = 3 * resistance * float(orifice.flow(at.inlet_pressure, socket))
            low, high = (socket, high) if socket < feed else (low, socket)
        return socket * JOINT.area

    inlet = -(load_at_inlet(lift + step) - load_at_inlet(lift - step)) / (2 * step)
    assert float(at.stiffness_constant_inlet) == pytest.approx(inlet, rel=1e-5)
    flow = 3 * float(at.flow)
    loads = [flow * float(film_resistance(JOINT, edge_gap(JOINT, lift + d))) * JOINT.area for d in (-step, step)]
    assert float(at.stiffness_constant_flow) == pytest.approx((loads[0] - loads[1]) / (2 * step), rel=1e-6)


def test_choked_orifices_keep_the_constant_flow_stiffness() -> None:
    row = design_film(JOINT, PRELOAD, NozzleOrifice(50.8e-6, 1.0), 40e-6)
    assert float(row.stiffness_constant_inlet) == float(row.stiffness_constant_flow)


@pytest.mark.parametrize("orifice", ORIFICES, ids=["linear", "nozzle"])
def test_displacement_at_inlet_inverts_the_design(orifice: Orifice) -> None:
    lift = np.linspace(25e-6, 60e-6, 8)
    design = design_film(JOINT, PRELOAD, orifice, lift)
    assert displacement_at_inlet(JOINT, PRELOAD, orifice, design.inlet_pressure) == pytest.approx(lift, rel=1e-9)
    assert float(displacement_at_inlet(JOINT, PRELOAD, orifice, 0.4 * ATMOSPHERE)) == 0.0


def test_unloaded_film_has_no_resistance_ratio() -> None:
    row = design_film(JOINT, 0.0, LinearOrifice(), 30e-6)
    assert np.isnan(row.resistance_ratio)
    assert float(row.flow) == 0.0


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (
            lambda: FilmGeometry(25.4e-3, 91 * DEG, 0.3, 1e-5),
            "socket angle [deg] = 91, expected above 0 and at most 90 deg",
        ),
        (
            lambda: FilmGeometry(25.4e-3, 0.3, 0.35, 1e-5),
            "orifice angle [deg] = 20.0535, expected above 0 and at most 17.1887",
        ),
        (lambda: FilmGeometry(25.4e-3, 1.3, 0.3, -1e-5), "radial clearance = -1e-05, expected above 0 m"),
        (lambda: FilmGeometry(25.4e-3, 1.3, 0.3, 1e-5, 0), "number of orifices = 0, expected at least 1"),
        (lambda: film_resistance(JOINT, [1e-5, -2e-6]), "film gap = -2e-06, expected above 0 m"),
        (lambda: edge_gap(JOINT, -1e-6), "displacement = -1e-06, expected at least 0 m"),
        (lambda: pad_load(JOINT, -1.0), "socket pressure = -1, expected at least 0 Pa"),
        (lambda: supporting_pressure(JOINT, -3.0), "preload = -3, expected at least 0 N"),
        (lambda: stiffness_constant_flow(JOINT, 1.0, 0.0), "film gap = 0"),
        (
            lambda: displacement_at_inlet(JOINT, 100, LinearOrifice(), -1.0),
            "inlet pressure = -1, expected at least 0 Pa",
        ),
    ],
)
def test_impossible_films_are_refused(call: object, words: str) -> None:
    with pytest.raises(InputError) as refusal:
        call()  # type: ignore[operator]
    assert words in str(refusal.value)
    assert "\n" not in str(refusal.value)


ORIFICES_FIT = (LinearOrifice(0.03445 * ATMOSPHERE / SCCM, 0.638 * ATMOSPHERE), NozzleOrifice(100e-6))
LIFT, LOAD = np.tile(np.linspace(10e-6, 40e-6, 8), 2), np.repeat([60.0, 100.0], 8)


def inlets(film, orifice, lift=LIFT, clearance=13e-6, passed=1.6) -> np.ndarray:
    """Return the inlets of a joint with another clearance, whose orifices pass another flow than predicted."""
    made = film(replace(JOINT, clearance=clearance), LOAD, orifice, lift)
    return orifice.inlet_pressure(made.flow / passed, made.socket_pressure)


@pytest.mark.long
@pytest.mark.parametrize("film", [design_film, spherical_film])
@pytest.mark.parametrize("orifice", ORIFICES_FIT, ids=lambda o: type(o).__name__)
def test_clearance_and_flow_come_out_within_what_is_stated(film, orifice) -> None:
    exact = fit_film(film, JOINT, orifice, inlets(film, orifice), LIFT, LOAD)
    assert (exact.clearance, exact.passed) == (pytest.approx(13e-6, rel=1e-5), pytest.approx(1.6, rel=1e-5))
    off = []
    for seed in range(40):
        noisy = inlets(film, orifice) * (1 + 0.01 * np.random.default_rng(seed).normal(size=LIFT.size))
        fit = fit_film(film, JOINT, orifice, noisy, LIFT, LOAD)
        off.append([(fit.clearance - 13e-6) / fit.stderr["clearance"], (fit.passed - 1.6) / fit.stderr["passed"]])
        assert fit.rms == pytest.approx(0.01, rel=0.7)
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(off), axis=0)), 1.0, atol=0.35)


def test_one_lift_under_one_load_does_not_tell_clearance_from_flow() -> None:
    fit = fit_film(design_film, JOINT, ORIFICES_FIT[0], np.full(5, 3e5), np.full(5, 3e-5), 100.0)
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
    rows = zip(inlets(spherical_film, ORIFICES_FIT[0]) / ATMOSPHERE, LIFT * 1e6, LOAD, strict=True)
    text = "\n".join(",".join(map(str, row)) for row in rows)
    (tmp_path / "lift.csv").write_text(f"inlet [atm],lift [um],load [N]\n{text}\n")
    (tmp_path / "mine.toml").write_text('[measured]\nfile = "lift.csv"\n')
    done = CliRunner().invoke(joint, ["film", str(tmp_path / "mine.toml"), "--json", str(tmp_path / "film.json")])
    assert done.exit_code == 0
    assert "Calibrated by lift.csv" in done.output
    flat, sphere = json.loads((tmp_path / "film.json").read_text())["calibrated"].values()
    assert sphere["clearance"] == pytest.approx(13e-6, rel=1e-4)
    assert sphere["rms"] < 1e-6 < flat["rms"]


def damping(geometry: FilmGeometry, displacement: float) -> float:
    """c = 6 pi mu r^4 integral from 0 to alpha of sin^3 t / h^3 dt [N s/m]: dp/dt = 6 mu v r^2 sin t / h^3."""
    t = np.linspace(0.0, geometry.socket_angle, 20001)
    gap = geometry.clearance + (displacement - geometry.clearance) * np.cos(t)
    return float(6 * np.pi * geometry.viscosity * geometry.ball_radius**4 * np.trapezoid(np.sin(t) ** 3 / gap**3, t))


SHALLOW = FilmGeometry(1.0, 0.01, 0.003, 10e-6)
HEMISPHERE = FilmGeometry(0.02, np.pi / 2, 0.3, 15e-6)


@pytest.mark.parametrize(
    ("geometry", "lift", "expected"),
    [
        pytest.param(SHALLOW, 20e-6, 3 * np.pi * SHALLOW.viscosity * 0.01**4 / (2 * (20e-6) ** 3), id="a disc"),
        pytest.param(HEMISPHERE, 15e-6, 4 * np.pi * HEMISPHERE.viscosity * 0.02**4 / (15e-6) ** 3, id="concentric"),
        pytest.param(JOINT, 50e-6, damping(JOINT, 50e-6), id="the thesis' joint"),
    ],
)
def test_slow_motion_is_damped_as_if_incompressible(geometry: FilmGeometry, lift: float, expected: float) -> None:
    slow = squeeze_impedance(geometry, lift, 0.1)
    assert float(slow.imag) / (2 * np.pi * 0.1) == pytest.approx(expected, rel=1e-3)
    assert abs(float(slow.real)) < 0.1 * abs(float(slow.imag))


def test_fast_motion_traps_the_air() -> None:
    """The spring p_a times the integral of cos^2 / h over the cap; the edge leaks, less and less."""
    alpha = JOINT.socket_angle
    t = np.linspace(0, alpha, 20001)
    h = JOINT.clearance + (50e-6 - JOINT.clearance) * np.cos(t)
    trapped = np.trapezoid(ATMOSPHERE * np.cos(t) ** 2 / h * 2 * np.pi * JOINT.ball_radius**2 * np.sin(t), t)
    fast = squeeze_impedance(JOINT, 50e-6, np.array([1e4, 1e6]), cells=2000).real
    assert trapped > fast[1] > fast[0]
    assert fast[1] == pytest.approx(trapped, rel=0.01)


def test_finer_grids_change_nothing() -> None:
    f = np.array([1.0, 50.0, 500.0])
    assert squeeze_impedance(JOINT, 40e-6, f, 400) == pytest.approx(squeeze_impedance(JOINT, 40e-6, f, 1600), rel=2e-3)

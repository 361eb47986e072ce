"""Test stiffness of the joint, regimes of a measured curve, orifices, thermal growth."""

from dataclasses import asdict

import numpy as np
import pytest
from instances import some

from gpmodel.errors import InputError
from joints.contact import LoopPart, allowed_temperature_change, gap_growth, loop_growth
from joints.film import FilmGeometry, design_film
from joints.orifice import ATMOSPHERE, SCCM, LinearOrifice, NozzleOrifice, Orifice
from joints.stiffness import (
    RegimeCurve,
    contact_tension,
    film_force,
    fit_regimes,
    layer_stiffness,
    lifted_tension,
    magnet_force,
    rest_displacement,
)

JOINT = FilmGeometry(25.4e-3, np.radians(75.95), np.radians(20), 10.01e-6)
LOAD, STAND_OFF = 100.69, 0.794e-3
CURVE = RegimeCurve(26e6, 1.2e6, 4.5e6, 90.0, -50e-6, 0.0, 15e-6, STAND_OFF)


def test_film_carries_the_preload_at_the_inlet_pressure_of_the_design() -> None:
    lift = np.array([30e-6, 40e-6, 50e-6])
    design = design_film(JOINT, LOAD, LinearOrifice(), lift)
    carried = [
        float(film_force(JOINT, LinearOrifice(), float(p), d)) for p, d in zip(design.inlet_pressure, lift, strict=True)
    ]
    assert carried == pytest.approx([LOAD] * 3, rel=1e-9)


def test_film_without_supply_carries_nothing() -> None:
    assert float(film_force(JOINT, LinearOrifice(), 0.0, 20e-6)) == 0.0


def test_magnets_pull_with_the_inverse_square_of_the_distance() -> None:
    pull = magnet_force([0.0, STAND_OFF], LOAD, STAND_OFF)
    assert pull == pytest.approx([LOAD, LOAD / 4])


def test_rest_is_where_film_and_magnets_balance() -> None:
    rest = rest_displacement(JOINT, LinearOrifice(), 595e3, LOAD, STAND_OFF)
    assert float(lifted_tension(JOINT, LinearOrifice(), 595e3, LOAD, STAND_OFF, rest)) == pytest.approx(0, abs=1e-4)
    assert 50e-6 < rest < 60e-6


def test_too_little_air_leaves_the_ball_on_its_seat() -> None:
    assert rest_displacement(JOINT, LinearOrifice(), 1e4, LOAD, STAND_OFF) == 0.0


def test_without_air_the_curve_is_magnet_and_contact() -> None:
    x = np.array([-2e-6, 0.0, 100e-6])
    force = lifted_tension(JOINT, LinearOrifice(), 0.0, LOAD, STAND_OFF, np.maximum(x, 0.0)) + contact_tension(138e6, x)
    assert force == pytest.approx([LOAD - 276.0, LOAD, LOAD * (0.794 / 0.894) ** 2])


@pytest.mark.parametrize("limit", ["contact_end", "transition_end", "film_end"])
def test_regimes_join_without_a_step(limit: str) -> None:
    at = getattr(CURVE, limit)
    below, above = CURVE.force([at - 1e-12, at + 1e-12])
    assert below == pytest.approx(above, abs=1e-4)


@pytest.mark.parametrize(
    ("position", "slope"),
    [(-60e-6, 26e6), (-20e-6, 1.2e6), (7e-6, 4.5e6), (15e-6 + STAND_OFF, -2 * 90.0 / 8 / STAND_OFF)],
    ids=["contact", "transition", "film", "magnet"],
)
def test_each_regime_has_its_slope(position: float, slope: float) -> None:
    step = 1e-9
    low, high = CURVE.force([position - step, position + step])
    assert (high - low) / (2 * step) == pytest.approx(slope, rel=1e-4)


def test_the_peak_tension_is_the_preload_and_gives_k_m() -> None:
    x = np.linspace(-80e-6, 400e-6, 100001)
    assert CURVE.force(x).max() == pytest.approx(90.0, abs=0.01)
    assert CURVE.magnet_coefficient / (STAND_OFF + 100e-6) ** 2 == pytest.approx(float(CURVE.force(115e-6)))


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: layer_stiffness(2e9, 0.02, 0.0), "thickness = 0, expected above 0 m"),
        (lambda: magnet_force(-1e-6, 100, 1e-3), "separation = -1e-06"),
        (lambda: film_force(JOINT, LinearOrifice(), -1.0, 1e-5), "inlet pressure = -1"),
        (lambda: RegimeCurve(1, 1, 1, 1, 0.0, -1e-6, 1e-6, 1e-3), "between the ends of contact and film"),
        (lambda: RegimeCurve(1, 1, 1, 1, 0.0, 0.0, 0.0, 0.0), "stand-off = 0"),
        (
            lambda: rest_displacement(JOINT, LinearOrifice(), 1e9, LOAD, STAND_OFF),
            "expected one that holds the ball below 1000 um",
        ),
    ],
)
def test_impossible_input_is_refused(call: object, words: str) -> None:
    with pytest.raises(InputError) as refusal:
        call()  # type: ignore[operator]
    assert words in str(refusal.value)


# Table 4.3: contact 26, transition 1.2, fluid 4.5 N/um
CURVES = [
    RegimeCurve(26e6, 1.2e6, 4.5e6, 90.0, -50e-6, 0.0, 15e-6, 0.794e-3),
    RegimeCurve(40e6, 2e6, 8e6, 60.0, -10e-6, 20e-6, 26e-6, 0.3e-3),
    RegimeCurve(15e6, 0.5e6, 3e6, 120.0, 0.0, 60e-6, 110e-6, 1.5e-3),
]


def span(curve: RegimeCurve, rows: int = 400) -> np.ndarray:
    reach = curve.film_end - curve.contact_end
    return np.linspace(curve.contact_end - 0.2 * reach, curve.film_end + 3 * reach, rows)


one_curve = pytest.mark.parametrize("curve", some(CURVES, CURVES[0]), ids=["Table 4.3", "stiff", "soft"])


@one_curve
def test_noiseless_curves_are_recovered(curve: RegimeCurve) -> None:
    x = span(curve)
    fit = fit_regimes(x, curve.force(x))
    assert fit.status == "ok"
    assert fit.rms < 1e-3
    for name, value in asdict(curve).items():
        assert getattr(fit.curve, name) == pytest.approx(value, rel=1e-3, abs=1e-8)


@pytest.mark.parametrize("seed", some(range(3), 0))
@one_curve
def test_planted_stiffnesses_come_back_within_their_errors(curve: RegimeCurve, seed: int) -> None:
    x = span(curve)
    fit = fit_regimes(x, curve.force(x) + np.random.default_rng(seed).normal(0, 1.0, x.size))
    assert fit.status == "ok"
    assert fit.rms == pytest.approx(1.0, abs=0.15)
    for name in ("contact_stiffness", "transition_stiffness", "film_stiffness", "peak_force"):
        assert abs(getattr(fit.curve, name) - getattr(curve, name)) < 4 * fit.stderr[name]


def test_order_of_rows_does_not_matter() -> None:
    x = span(CURVES[0])
    force = CURVES[0].force(x) + np.random.default_rng(1).normal(0, 1.0, x.size)
    shuffle = np.random.default_rng(2).permutation(x.size)
    assert fit_regimes(x[shuffle], force[shuffle]).curve == fit_regimes(x, force).curve


def test_a_straight_line_is_not_taken_for_four_regimes() -> None:
    x = np.linspace(0, 1e-4, 100)
    fit = fit_regimes(x, 1e6 * x + np.random.default_rng(0).normal(0, 0.1, 100))
    assert fit.status != "ok"


def test_a_compressed_magnet_is_not_a_joint() -> None:
    x = span(CURVES[0])
    fit = fit_regimes(x, -CURVES[0].force(x))
    assert fit.status.startswith("not a preloaded joint's curve: ")


@pytest.mark.parametrize(
    ("x", "f", "words"),
    [
        (np.arange(5.0), np.arange(5.0), "5 displacements and 5 forces, expected at least 12 pairs"),
        (np.arange(20.0), np.arange(19.0), "20 displacements and 19 forces"),
        (np.arange(20.0), np.r_[np.nan, np.arange(19.0)], "force = nan, expected finite numbers"),
        (np.ones(20), np.arange(20.0), "range of displacement = 0"),
    ],
)
def test_bad_data_is_refused(x: np.ndarray, f: np.ndarray, words: str) -> None:
    with pytest.raises(InputError, match=words):
        fit_regimes(x, f)


def smooth_contact_and_film(x: np.ndarray) -> np.ndarray:
    """Tension of no `RegimeCurve`: Hertz contact on a bed of asperities, an exponential film, magnets of two poles."""
    magnets = 90.0 * (0.794e-3 / (0.794e-3 + np.maximum(x, 0.0))) ** 2
    asperities = 1.2e6 * 3e-6 * np.logaddexp(0.0, -x / 3e-6)
    hertz = 2.4e9 * np.maximum(-50e-6 - x, 0.0) ** 1.5
    film = 70.0 * np.exp(-np.maximum(x, 0.0) / 12e-6)
    return magnets - asperities - hertz - film


def test_data_of_another_formula_is_followed_and_its_slopes_are_named() -> None:
    """Every stiffness is the data's own mean slope over the regime that was found, and the pull beyond is the pull.

    The contact has to be pressed until it leads the misfit: from -58 um on, the film's curve is split in two instead.
    """
    x = np.linspace(-66e-6, 250e-6, 500)
    force = smooth_contact_and_film(x) + np.random.default_rng(0).normal(0, 0.5, x.size)
    fit = fit_regimes(x, force)
    assert fit.status == "ok"
    assert fit.rms < 2.5
    c = fit.curve
    assert -56e-6 < c.contact_end < -45e-6
    ends = {"contact": (x[0], c.contact_end), "transition": (c.contact_end, c.transition_end)}
    for name, (low, high) in {**ends, "film": (c.transition_end, c.film_end)}.items():
        mean_slope = np.diff(smooth_contact_and_film(np.array([low, high])))[0] / (high - low)
        assert getattr(c, f"{name}_stiffness") == pytest.approx(mean_slope, rel=0.15)
    far = np.linspace(100e-6, 250e-6, 20)
    np.testing.assert_allclose(c.force(far), smooth_contact_and_film(far), atol=2.0)


@pytest.mark.long
def test_the_magnets_coefficient_has_an_error_that_its_scatter_confirms() -> None:
    curve, x = CURVES[0], span(CURVES[0], 200)
    fits = [fit_regimes(x, curve.force(x) + np.random.default_rng(seed).normal(0, 1.0, x.size)) for seed in range(12)]
    found = np.array([f.curve.magnet_coefficient for f in fits])
    stated = np.mean([f.stderr["magnet_coefficient"] for f in fits])
    assert 0.5 * stated < found.std(ddof=1) < 2.0 * stated
    assert abs(found.mean() - curve.magnet_coefficient) < 4 * stated / np.sqrt(len(fits))


ORIFICES: list[Orifice] = [LinearOrifice(), NozzleOrifice(50.8e-6, 1.0), NozzleOrifice(2e-4, 0.7)]
IDS = ["linear", "nozzle", "wide nozzle"]
SOCKET = 0.5 * ATMOSPHERE


@pytest.mark.parametrize("orifice", ORIFICES, ids=IDS)
def test_inlet_pressure_inverts_flow(orifice: Orifice) -> None:
    inlet = np.array([0.7, 1.2, 3.0, 6.0]) * ATMOSPHERE
    assert orifice.inlet_pressure(orifice.flow(inlet, SOCKET), SOCKET) == pytest.approx(inlet, rel=1e-9)


@pytest.mark.parametrize("orifice", ORIFICES, ids=IDS)
@pytest.mark.parametrize("inlet", [0.8, 1.3, 4.0])
def test_flow_slope_is_the_derivative(orifice: Orifice, inlet: float) -> None:
    supply, step = inlet * ATMOSPHERE, 1.0
    flows = orifice.flow(supply, np.array([SOCKET - step, SOCKET + step]))
    assert float(orifice.flow_slope(supply, SOCKET)) == pytest.approx((flows[1] - flows[0]) / (2 * step), rel=1e-6)
    assert float(orifice.flow_slope(supply, SOCKET)) <= 0


def test_nozzle_chokes_at_the_critical_ratio() -> None:
    """A sonic orifice of 0.002 in feeds about what Table 4.2 says it does: 173.9 sccm at 5.9 atm."""
    nozzle = NozzleOrifice(50.8e-6, 1.0)
    supply = 5.9 * ATMOSPHERE
    choked = 0.528 * (supply + ATMOSPHERE) - ATMOSPHERE
    assert float(nozzle.flow(supply, 0.0)) == pytest.approx(float(nozzle.flow(supply, choked)), rel=1e-6)
    assert float(nozzle.flow(supply, supply)) == 0.0
    assert float(nozzle.flow(supply, SOCKET)) / SCCM == pytest.approx(173.9, rel=0.06)


def test_choked_flow_is_the_textbook_mass_flow() -> None:
    """m = A p0 sqrt(k/(R T)) (2/(k+1))^((k+1)/(2(k-1)))."""
    supply, temperature = 6 * ATMOSPHERE, 293.15
    mass = np.pi * 50e-6**2 / 4 * (supply + ATMOSPHERE) * np.sqrt(1.4 / (287.05 * temperature)) * (2 / 2.4) ** 3
    density = ATMOSPHERE / (287.05 * temperature)
    assert float(NozzleOrifice(50e-6, 1.0).flow(supply, 0.0)) == pytest.approx(mass / density, rel=1e-9)


@pytest.mark.parametrize("orifice", ORIFICES, ids=IDS)
def test_impossible_pressures_are_refused(orifice: Orifice) -> None:
    with pytest.raises(InputError, match="inlet pressure = -1, expected at least 0 Pa"):
        orifice.flow(-1.0, 0.0)
    with pytest.raises(InputError, match="expected at least the socket pressure"):
        orifice.flow(1e5, 2e5)
    with pytest.raises(InputError, match="flow = -1"):
        orifice.inlet_pressure(-1.0, 0.0)


def test_impossible_orifices_are_refused() -> None:
    with pytest.raises(InputError, match="orifice slope = 0"):
        LinearOrifice(0.0, 0.0)
    with pytest.raises(InputError, match="orifice diameter = -1"):
        NozzleOrifice(-1.0)
    with pytest.raises(InputError, match=r"discharge coefficient = 1.5, expected above 0 and at most 1"):
        NozzleOrifice(1e-4, 1.5)


def test_loop_adds_parts_and_lets_a_returning_part_compensate() -> None:
    out, back = LoopPart("out", 0.1, 23e-6), LoopPart("back", -0.1, 12e-6)
    assert loop_growth([out, back], [0.0, 2.0]) == pytest.approx([0.0, 2 * 0.1 * 11e-6])


def test_one_material_keeps_the_gap_in_proportion() -> None:
    assert float(gap_growth(0.025, 0.0, 12e-6, 50e-6, 12e-6, 10.0)) == pytest.approx(0, abs=1e-15)


def test_gap_of_aluminium_socket_and_steel_ball_opens_when_warm() -> None:
    rate = float(gap_growth(25.4e-3, 1.8e-3, 12e-6, 50e-6, 23e-6, 1.0))
    assert rate == pytest.approx(25.4e-3 * 11e-6 + 1.8e-3 * (23e-6 - 50e-6))
    assert rate > 0


def test_allowed_change_uses_up_the_tolerance() -> None:
    change = allowed_temperature_change(1e-6, [2e-6, -0.5e-6, 0.0])
    assert change == pytest.approx([0.5, 2.0, np.inf])


def test_tolerance_must_be_above_zero() -> None:
    with pytest.raises(InputError, match="tolerance = 0, expected above 0 m"):
        allowed_temperature_change(0.0, 1e-6)

"""Test that constants inside a formula are fitted, and that rows of events get an interval."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from effect_cases import bare, measure, mechanism, sized

from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.discovery.loop import discover
from gpmodel.discovery.refinement import _nats, profile, refined, refined_at_one_site, refined_fit
from gpmodel.discovery.search import Search
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import Residual, residual_of
from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import candidates, catalogue
from gpmodel.families.inner import NonlinearParameters
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.table.blocks import hold_out
from gpmodel.table.dataset import Dataset

ARM = mechanism("irb6400r")
TIME = np.cumsum(np.random.default_rng(4).uniform(1.0, 4.0, 120))


def session() -> Dataset:
    """120 rows of a walk over 5 hours in a room whose temperature swings."""
    data = bare("irb6400r", 120, 3, payload=False)
    steps = 0.08 * np.random.default_rng(5).normal(size=data.q.shape)
    q = np.clip(np.cumsum(steps, axis=0) + data.q[0], data.q.min(0), data.q.max(0))
    room = 21.0 + 3.0 * np.sin(2 * np.pi * TIME / 260.0)
    return replace(
        data, q=q, extras={"time": TIME, "temperature": room}, extra_units={"time": "min", "temperature": "degC"}
    )


def offered(beginning: str) -> list[Candidate]:
    return [c for c in candidates(ARM, prepare(ARM, session()).states) if c.name.startswith(beginning)]


def left_of(inner: NonlinearParameters, millimetres: float) -> Residual:
    """Return the residual of the standard model, for a robot with a formula of these constants; rows kept in order."""
    return left_by((), inner.effects, sized("irb6400r", inner.effects, session(), millimetres))


def left_by(found: Sequence[Candidate], true: Sequence[Effect], theta: Array) -> Residual:
    """Return the residual of the standard model with some candidates, for a robot with true effects."""
    truth = measure("irb6400r", tuple(true), theta, 5, dataset=session(), geometry=0.0)
    effects = (*geometric_effects(ARM), *(e for c in found for e in c.effects))
    fit = calibrate(ErrorModel(ARM, effects), truth.poses, condition_limit=50.0)
    return residual_of(fit, truth.poses, Criteria(), 0)


LAWS = {
    "growth of the arm (temperature": (44.0,),
    "settling of the zero after time 74": (68.0, 31.0),
    "hysteresis over its angle, J1": (0.03, 0.08),
}


@pytest.mark.long
@pytest.mark.parametrize(("beginning", "true"), LAWS.items())
def test_constants_go_from_those_offered_to_the_true_ones(beginning: str, true: tuple[float, ...]) -> None:
    near = min(
        (c for c in offered(beginning) if c.inner and len(c.inner.constants) >= len(true)),
        key=lambda c: abs(np.log(c.inner.values[-1] / true[-1])),
    )
    assert near.inner is not None
    planted = near.inner
    while len(planted.constants) > len(true):
        planted = planted.without(0)
    found = refined(left_of(planted.at(true), 1.0), near)
    assert found.inner is not None
    np.testing.assert_allclose(sorted(found.inner.values), sorted(true), rtol=0.1)
    assert not found.has_priors
    assert found.name == found.inner.full_name
    assert [e.name for e in found.effects] == [e.name for e in found.inner.effects]


@pytest.mark.long
@pytest.mark.parametrize("beginning", ["warm-up of the zero within", "settling of the zero after time"])
def test_a_clock_that_began_long_before_the_session_changes_no_basis(beginning: str) -> None:
    """Seconds since 1970, where the session's last digits are the ninth."""
    data = session()
    late = replace(data, extras={**data.extras, "time": TIME - TIME[0] + 1732103456.25})
    early = replace(data, extras={**data.extras, "time": TIME - TIME[0]})
    pools = [
        {tuple(c.inner.values): c for c in candidates(ARM, states) if c.inner and c.name.startswith(beginning)}
        for states in (prepare(ARM, late).states, prepare(ARM, early).states)
    ]
    assert pools[0].keys() == pools[1].keys()
    assert len(pools[0]) >= 4
    for values, candidate in pools[0].items():
        there, here = (p[values].bases[0](prepare(ARM, d).states) for p, d in zip(pools, (late, early), strict=True))
        np.testing.assert_allclose(there, here, atol=1e-6)
        assert candidate.name != pools[1][values].name or "warm-up" in beginning


def test_what_has_no_constant_to_move_is_not_fitted_again() -> None:
    plain = offered("gear ratio, J1")[0]
    fits: list[int] = []
    left = left_of(offered("growth of the arm (temperature")[0].inner, 0.1)  # type: ignore[arg-type]

    def fit(found: object, start: object) -> object:
        fits.append(1)
        return left.calibration

    found, _ = refined_fit(fit, lambda _: left, {"it": plain}, left.calibration)  # type: ignore[arg-type]
    assert (found, len(fits)) == ({"it": plain}, 0)


def at_lag(minutes: float) -> Candidate:
    lag = next(c for c in offered("growth of the arm (temperature") if c.inner)
    assert lag.inner is not None
    return lag.at(lag.inner.at([minutes]))


@pytest.mark.long
def test_constants_of_two_offered_values_at_one_site_move_to_the_one_between() -> None:
    true, tilt = at_lag(44.0), offered("tilt of J1 (temperature")[0]
    assert true.inner is not None
    asked = {"a": at_lag(25.0), "b": tilt, "c": at_lag(80.0)}
    theta = sized("irb6400r", true.effects, session(), 2.0)
    moved = list(refined_at_one_site(left_by(tuple(asked.values()), true.effects, theta), asked))
    values = [c.inner.values[0] for c in moved if c.inner is not None and c.name.startswith("growth")]
    assert len(values) == 2
    assert np.allclose(values, 44.0, rtol=0.1)


@pytest.mark.long
@pytest.mark.parametrize(("millimetres", "widest"), [(1.0, 0), (0.05, 20)])
def test_the_row_of_an_event_is_known_as_well_as_its_step_is_large(millimetres: float, widest: int) -> None:
    step = next(c.inner for c in offered("set-up moved after row 40, Tx") if c.inner)
    left = left_of(step.at([57.0]), millimetres)
    rows = profile(left, step)
    assert rows is not None
    low, high = rows.interval
    assert low <= 57 <= high
    assert high - low <= widest
    if widest:
        assert high > low


@pytest.mark.long
def test_the_interval_of_an_events_row_holds_it_as_often_as_it_says() -> None:
    step = next(c.inner for c in offered("set-up moved after row 40, Tx") if c.inner).at([57.0])
    left = left_of(step, 0.0)
    shape = left.projected(step.effects)[0][:, 0]
    hit = []
    for seed in range(150):
        noise = left.span.remove(np.random.default_rng(seed).normal(size=len(left.values)))
        here = replace(left, values=noise + 4.0 * shape / np.linalg.norm(shape) * np.sqrt(len(shape)) / 10)
        rows = profile(here, step)
        assert rows is not None
        hit.append(rows.interval[0] <= 57 <= rows.interval[1])
    assert np.mean(hit) > 0.9


@pytest.mark.long
def test_a_finding_says_after_which_rows_its_event_may_be() -> None:
    step = next(c.inner for c in offered("set-up moved after row 40, Tx") if c.inner).at([57.0])
    theta = sized("irb6400r", step.effects, session(), 0.08)
    truth = measure("irb6400r", step.effects, theta, 5, dataset=session())
    train, heldout = hold_out(truth.poses.dataset, 0.3, np.random.default_rng(1))
    families = [f for f in catalogue if f.name == "set_up_step"]
    found = discover(ARM, truth.poses, train, heldout, search=Search(runs=0), candidates=families)
    (event,) = found.fitted.constants[0]
    assert (event.low, event.high) == (57, 58)
    assert f"after row {event.value} ({event.low} to {event.high})" in found.fitted.candidates[0].name
    assert {e.name for e in found.fitted.candidates[0].effects} <= {e.name for e in found.found.model.effects}


@pytest.mark.long
def test_a_step_whose_row_was_held_out_is_put_right_by_the_final_fit() -> None:
    step = next(c.inner for c in offered("set-up moved after row 40, Tx") if c.inner).at([57.0])
    truth = measure("irb6400r", step.effects, sized("irb6400r", step.effects, session(), 1.0), 5, dataset=session())
    heldout = np.sort(np.concatenate([[56, 57], np.arange(2, 120, 5)]))
    train = np.setdiff1d(np.arange(120), heldout)
    families = [f for f in catalogue if f.name == "set_up_step"]
    found = discover(ARM, truth.poses, train, heldout, search=Search(runs=0), candidates=families)
    (event,) = found.fitted.constants[0]
    assert (event.value, event.low, event.high) == (57, 57, 57)
    assert not len(found.found.outliers)


@pytest.mark.first(1)
@pytest.mark.parametrize(
    ("joint", "row", "millimetres"), [("J1", 90, 0.3), ("J2", 60, 0.2), ("J3", 60, 1.0), ("J4", 35, 0.2)]
)
def test_a_slip_of_a_zero_is_no_fast_settling(joint: str, row: int, millimetres: float) -> None:
    """A settling takes two rows or more (here to two digits), and explains a slip less than the slip does."""
    (slip,) = offered(f"zero slipped after row {row}, {joint}")
    assert slip.inner is not None
    left = left_of(slip.inner, millimetres)
    slow = [c for c in offered("settling of the zero") if c.inner and c.name.endswith(f", {joint}")]
    near = sorted(slow, key=lambda c: abs(c.inner.values[0] - TIME[row]) if c.inner else 0.0)[:3]
    for settled in (refined(left, c) for c in near):
        assert settled.inner is not None
        assert settled.inner.values[1] > 1.9 * np.ptp(TIME) / (len(TIME) - 1)
        assert _nats(left, slip.effects) > _nats(left, settled.effects) + 1.0

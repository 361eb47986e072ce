"""Test sites and probabilities in words."""

from dataclasses import replace

import pytest

from gpmodel import wording
from gpmodel.application.named_changes import NamedChange
from gpmodel.evolution.input_histogram import Histogram
from gpmodel.families.candidate import BRED, CATALOGUE, FORMULA, NAMED, SEQUENCE, SMOOTH_TERM, TREE
from gpmodel.report import verification_words
from gpmodel.report.schema import Report
from gpmodel.report.schema_search import EffectRecord, InstrumentRecord, TermRecord
from gpmodel.report.words import (
    beside_specification,
    found,
    input_tests,
    instrument,
    place,
    places,
    rms_removed,
    significant_inputs,
    written,
)


@pytest.mark.parametrize(
    ("slot", "axis", "said"),
    [
        ("J5.moving", "Ry", "rotation about y of the frame just after the motion of J5"),
        ("J2.fixed", "Tx", "translation along x of the frame just before the motion of J2"),
        ("base", "Rz", "rotation about z of the frame at the base, before the first joint"),
        ("tool", "Tz", "translation along z of the frame at the flange, after the last joint"),
        (
            "instrument",
            "Tx",
            "translation along x of the frame of the instrument, applied to its measurements before registration",
        ),
        ("J2.moving, J3.moving", "Rz", ""),
    ],
)
def test_places_are_said_in_words(slot: str, axis: str, said: str) -> None:
    assert place(slot, axis) == said


@pytest.mark.parametrize(
    ("probability", "shuffles", "said"),
    [
        (1e-88, 8, "< 0.000001 extrapolated from 8 permutations"),
        (0.02, 199, "0.02 from 199 permutations"),
        (0.02, None, "0.02"),
        (None, 8, "–"),
    ],
)
def test_a_chance_says_what_it_rests_on(probability: float | None, shuffles: int | None, said: str) -> None:
    assert wording.chance(probability, shuffles) == said


BASE = (TermRecord("base", "Rx", "moment_base_x"), TermRecord("base", "Ry", "moment_base_y", -1.0))
SEVERAL = {
    "one place": (EffectRecord("a", "J2.moving", "Rz", "torque_J2"), (("× torque_J2", "J2.moving Rz"),)),
    "one number at two places": (
        EffectRecord("a", "base", "Rx", "moment_base_x", terms=BASE),
        (("× moment_base_x", "base Rx"), ("× −moment_base_y", "base Ry")),
    ),
    "one basis along two axes": (
        EffectRecord("a", "base", "Rx", "sin(J1)", kind="vector", terms=BASE),
        (("× sin(J1)", "base Rx, base Ry"),),
    ),
    "a curve": (
        EffectRecord("a", "J1.moving", "Rz", "curve of J1, 10 harmonics", kind="curve"),
        (("RMS of curve of J1, 10 harmonics", "J1.moving Rz"),),
    ),
}


@pytest.mark.parametrize("case", SEVERAL)
def test_what_a_number_multiplies_is_said_place_by_place(case: str) -> None:
    effect, said = SEVERAL[case]
    assert written(effect) == said


def test_effects_chosen_in_one_round_say_so() -> None:
    first, second, later = (EffectRecord(n, found_by="catalogue", round=r) for n, r in (("a", 1), ("b", 1), ("c", 2)))
    report = Report(effects=(first, second, later))
    assert found(report, first) == "the catalogue of effects, in round 1, selected jointly with 1 other effect"
    assert found(report, later) == "the catalogue of effects, in round 2"
    assert places(EffectRecord("a", "base", "Rx", terms=BASE))[1].startswith(
        "rotation about y of the frame at the base"
    )


def test_an_input_is_judged_by_the_limit_of_its_own_run() -> None:
    counts = {"linear": (4,)}, {"linear": (1,)}, {}, {"linear": 8}, {"linear": 8}
    counted = Histogram(("J1",), *counts, (0.08,), (0.06,), 0.1)
    assert next(input_tests(counted)).startswith("J1 is significant")
    assert next(input_tests(replace(counted, significance=0.05))).startswith(
        "J1 is not significant (fails the test of count and of strength)"
    )


def test_an_error_of_the_instrument_is_said_beside_its_specification() -> None:
    offset = EffectRecord("range offset of the instrument", "instrument", "Tx", unit="m", of_specification=193.0)
    assert beside_specification(offset) == "193 times the instrument's specification: check the reflector constant"
    assert "admissible" in beside_specification(replace(offset, of_specification=0.8))
    assert beside_specification(replace(offset, of_specification=None)) == ""


def test_the_noise_found_is_said_beside_the_noise_expected() -> None:
    stated = InstrumentRecord("15 µm + 6 µm/m", 0.033, 0.0165)
    said = instrument(Report(instrument=stated, sigma_mm=0.031))
    assert "16.50 µm expected, 31 µm estimated" in said.replace("0.031 mm", "31 µm"), said
    assert instrument(Report(sigma_mm=0.031)) == ""


@pytest.mark.parametrize(("runs", "shuffled", "said"), [(2, 2, "too few runs to tell"), (8, 8, "none"), (0, 0, "none")])
def test_no_significant_input_says_whether_so_few_runs_could_show_one(runs: int, shuffled: int, said: str) -> None:
    names, runs_of, none = ("J1", "J2", "J3"), ({"linear": runs}, {"linear": shuffled}), (1.0, 1.0, 1.0)
    found = Histogram(names, {}, {}, {}, *runs_of, none, none, 0.05)
    assert significant_inputs(found) == said


def test_a_share_of_squares_is_stated_as_a_share_of_the_rms() -> None:
    """0.128 mm RMS that falls to 0.032 mm is 94 % of the squares and 75 % of the error."""
    assert rms_removed(1.0 - (0.032 / 0.128) ** 2) == pytest.approx(0.75)
    assert rms_removed(1.1) == 1.0


@pytest.mark.parametrize("maker", [CATALOGUE, NAMED, SMOOTH_TERM, FORMULA, *BRED[:2], SEQUENCE, TREE])
def test_genetic_programming_is_named_only_where_a_program_was_evolved(maker: str) -> None:
    said = found(Report(), EffectRecord("a", found_by=maker, round=1))
    assert ("genetic programming" in said) == (maker in {SEQUENCE, TREE, *BRED})


@pytest.mark.parametrize(
    ("weight", "basis", "said"),
    [(0.45, "temperature - 20", "0.450·(temperature \N{MINUS SIGN} 20)"), (-1.0, "J1 + J2", "\N{MINUS SIGN}(J1 + J2)"),
     (1.0, "temperature - 20", "(temperature \N{MINUS SIGN} 20)"), (-1.0, "J2", "\N{MINUS SIGN}J2"),
     (1.0, "sin(J1 + (2))", "sin(J1 + (2))")],
)  # fmt: skip
def test_a_weight_multiplies_the_whole_basis_function(weight: float, basis: str, said: str) -> None:
    terms = (TermRecord("J1.moving", "Tx", basis, weight), TermRecord("J2.moving", "Tx", basis, 0.3))
    assert written(EffectRecord("growth", "J1.moving", "Tx", basis, terms=terms))[0][0] == f"× {said}"
    if weight == 1.0:
        assert written(EffectRecord("drift", "J1.moving", "Tx", basis, terms=terms[:1]))[0][0] == f"× {said}"


@pytest.mark.parametrize(("value", "stderr", "stated"), [
    (3e-4, 9e-6, "0.0300 % ± 0.0009 % more"),
    (-0.004, 0.002, "0.4 % ± 0.2 % less"),
    (0.47, 0.021, "47 % ± 2 % more"),
    (0.5, 0.12, "50 % ± 12 % more"),
])  # fmt: skip
def test_a_relative_change_is_stated_to_the_first_digit_of_its_error(value: float, stderr: float, stated: str) -> None:
    found = NamedChange("scale of the machine", "size", value, stderr, "1", 0.0, ())
    assert verification_words.change(found) == f"scale of the machine: {stated} than before"

"""Test that a wrong type of any argument of a public function gives one line with the name of the argument."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import table, write

import gpmodel as gp
from gpmodel.api.calibrate import CalibrationResult

TABLE = table(60, effects=("base_compliance=3e-7",))
ARM = gp.load_mechanism("irb6400r")
RESULTS = {
    "calibrate": lambda: gp.calibrate(ARM, TABLE),
    "check": lambda: gp.check(ARM, TABLE),
    "simulate": lambda: gp.simulate(ARM),
    "choose_poses": lambda: gp.choose_poses(ARM, 3),
}
NOTHING, TEXT, NUMBER, LIST, FRAME, OBJECT = None, "nonsense", 7.5, [7], pd.DataFrame(), object()
ANY = (NOTHING, TEXT, NUMBER, LIST, FRAME, OBJECT)
NO_NUMBER = (TEXT, LIST, FRAME, OBJECT, float("nan"), True)
NO_TEXTS = (NOTHING, TEXT, NUMBER, LIST, OBJECT, np.array(7.5))
NO_FILE = (NOTHING, NUMBER, LIST, FRAME, "")

CALLS: dict[str, tuple[Callable[..., object], dict[str, tuple[object, ...]]]] = {
    "load_mechanism": (
        lambda **a: gp.load_mechanism(**({"source": "irb6400r"} | a)),
        {"source": NO_FILE[:-1], "payload": (*NO_NUMBER, "60"), "frame": (NUMBER, LIST, FRAME),
         "payload_com": (*NO_NUMBER, (0.0, 1.0))},
    ),
    "read_table": (
        lambda **a: gp.read_table(**({"table": TABLE, "mechanism": ARM} | a)),
        {"table": NO_FILE, "mechanism": ANY},
    ),
    "check": (
        lambda **a: gp.check(**({"mechanism": ARM, "table": TABLE} | a)),
        {"mechanism": ANY, "table": NO_FILE, "standard": NO_TEXTS},
    ),
    "calibrate": (
        lambda **a: gp.calibrate(**({"mechanism": ARM, "table": TABLE} | a)),
        {
            "mechanism": ANY, "table": NO_FILE, "effects": NO_TEXTS, "standard": (*NO_TEXTS, ("J9 *",)),
            "holdout": (*ANY, 1.5), "seed": (*ANY, -1), "condition_limit": NO_NUMBER, "instrument": NO_NUMBER,
        },
    ),
    "discover": (
        lambda **a: gp.discover(**({"mechanism": ARM, "table": TABLE} | a)),
        {
            "mechanism": ANY, "table": NO_FILE, "standard": (*NO_TEXTS, ("none",)), "holdout": (*ANY[1:], 0),
            "folds": (*ANY[1:], 1), "seed": (*ANY, 0.5),
            "condition_limit": (*NO_NUMBER, 0), "search": ANY[1:], "criteria": ANY[1:],
            "candidates": (*NO_TEXTS, ("gear",)),
            "noise": (*NO_NUMBER, 0.0), "instrument": NO_NUMBER, "progress": ANY,
        },
    ),
    "Search": (
        lambda **a: gp.discover(ARM, TABLE, search=gp.Search(**a)),
        {"strategies": (*NO_TEXTS, FRAME, (gp.Linear,), ()), "runs": ANY, "stop_after": NO_NUMBER,
         "max_effects": (*ANY, -1), "workers": (*ANY, 0), "population": ANY, "nats_per_node": (NOTHING, *NO_NUMBER)},
    ),
    "Criteria": (
        lambda **a: gp.discover(ARM, TABLE, criteria=gp.Criteria(**a)),
        {"significance": (*ANY[:2], *ANY[3:]), "folds": ANY},
    ),
    "evolve": (
        lambda **a: gp.evolve(**({"mechanism": ARM, "table": TABLE} | a)),
        {
            "mechanism": ANY, "table": NO_FILE, "standard": NO_TEXTS, "holdout": ANY, "seed": ANY, "space": ANY,
            "norm": ANY, "strategies": (*NO_TEXTS[1:], FRAME, (gp.Linear(), gp.Linear())), "runs": (*ANY, 0),
            "population": (*ANY[1:], 20), "generations": ANY[1:], "seconds": NO_NUMBER, "workers": ANY,
            "selection": ANY[1:],
            "progress": ANY,
        },
    ),
    "simulate": (
        lambda **a: gp.simulate(**({"mechanism": ARM} | a)),
        {
            "mechanism": ANY, "effects": (*NO_TEXTS, ["gear_harmonic J4"]), "poses": (*NO_FILE, 0),
            "noise": (*NO_NUMBER, "-1 mm"),
            "geometry_sigma": (NOTHING, *NO_NUMBER), "seed": ANY,
            "inputs": (TEXT, NUMBER, LIST, OBJECT, {"t [s]": None}, {"t [s]": "a:b"}, {7: "1:2"}, {"t [s]": "9:1:2"},
                       {"t": "20:30"}),
        },
    ),
    "choose_poses": (
        lambda **a: gp.choose_poses(**({"mechanism": ARM, "count": 3} | a)),
        {"mechanism": ANY, "count": ANY[1:], "criterion": (*ANY[1:], "beauty"), "above": (*NO_NUMBER, "200"),
         "seed": ANY, "after": ANY[2:], "box": ANY[1:], "instrument": NO_NUMBER, "normal": ANY, "cone": (TEXT, 400.0),
         "tool_point": NO_NUMBER, "noise": NO_NUMBER},
    ),
    "load_model": (lambda **a: gp.load_model(**({"file": "nothing.json"} | a)), {"file": NO_FILE}),
}  # fmt: skip
WRONG = [
    pytest.param(name, argument, value, marks=[pytest.mark.long] * (value is not values[-1]))
    for name, (_, arguments) in CALLS.items()
    for argument, values in arguments.items()
    for value in values
]
"""Every value, and in the default suite the last one of each argument."""


def refused(call: Callable[[], object], argument: str) -> None:
    with pytest.raises(gp.InputError) as caught:
        call()
    assert str(caught.value).startswith(f"{argument}: "), str(caught.value)
    assert caught.value.argument == argument
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("name", "argument", "value"), WRONG)
def test_a_wrong_argument_of_a_function_is_one_line_that_names_it(name: str, argument: str, value: object) -> None:
    refused(lambda: CALLS[name][0](**{argument: value}), argument)


@pytest.fixture(scope="module")
def fit() -> CalibrationResult:
    return gp.calibrate(ARM, TABLE, holdout=0)


METHODS = {
    "predict": ("poses", NO_FILE),
    "misses": ("poses", NO_FILE),
    "compensate": ("targets", NO_FILE),
    "save": ("file", NO_FILE),
}


@pytest.mark.parametrize("method", METHODS)
def test_a_wrong_argument_of_a_model_is_one_line_that_names_it(method: str, fit: CalibrationResult) -> None:
    argument, values = METHODS[method]
    for value in values:
        refused(lambda value=value: getattr(fit.model, method)(value), argument)
    refused(lambda: fit.model.export(nodes=10**6), "nodes")
    for more in ({"max_move": "far"}, {"max_move": 1e300}, {"seed": 0.5}) if method == "compensate" else ():
        refused(lambda more=more: fit.model.compensate(TABLE, **more), next(iter(more)))


SWITCHED = (np.zeros((2, 3)), FRAME, "no", 1)
LONG = "9" * 5000


@pytest.mark.parametrize("value", SWITCHED)
def test_a_switch_is_on_or_off(value: object, fit: CalibrationResult) -> None:
    for argument in ("in_order", "session", "as_measured"):
        refused(lambda argument=argument: fit.model.predict(TABLE, **{argument: value}), argument)
    for call in (fit.model.verify, fit.model.compensate, lambda table, **a: gp.read_table(table, ARM, **a)):
        refused(lambda call=call: call(TABLE, in_order=value), "in_order")
    refused(lambda: gp.choose_poses(ARM, 3, collisions=value), "collisions")


def test_what_a_program_and_an_export_are_of(fit: CalibrationResult) -> None:
    for value in (NOTHING, TEXT, NUMBER, LIST, OBJECT):
        refused(lambda value=value: fit.model.program(value, "RAPID"), "corrected")
    for value in (NOTHING, NUMBER, LIST, FRAME):
        refused(lambda value=value: fit.model.program(TABLE, "RAPID", value), "name")
    for argument in ("setup", "tool"):
        refused(lambda argument=argument: fit.model.export(**{argument: LIST}), argument)


def test_a_number_beyond_all_floats_is_out_of_range(fit: CalibrationResult) -> None:
    refused(lambda: fit.model.compensate(TABLE, max_move=10**400), "max_move")
    refused(lambda: gp.simulate(ARM, noise=10**400), "noise")
    refused(lambda: gp.regress(np.zeros(9), [10**400] * 9), "y")


@pytest.mark.parametrize("read", [gp.load_mechanism, gp.load_model, gp.load_result, lambda name: gp.check(ARM, name)])
def test_a_name_longer_than_any_file_has_is_one_line(read: Callable[[str], object]) -> None:
    with pytest.raises(gp.InputError) as caught:
        read(LONG)
    assert "\n" not in str(caught.value)


@pytest.mark.long
@pytest.mark.parametrize("result", RESULTS)
def test_a_result_goes_to_a_path_and_nowhere_else(result: str) -> None:
    made = RESULTS[result]()
    for value in NO_FILE:
        refused(lambda value=value: made.save(value), "file")
        if hasattr(made, "report"):
            refused(lambda value=value: made.report(value), "folder")


@pytest.mark.long
@pytest.mark.parametrize("result", RESULTS)
def test_a_result_shows_itself(result: str) -> None:
    made = RESULTS[result]()
    assert len(repr(made).splitlines()) == 1
    assert len(repr(made)) < 300
    assert any(tag in made._repr_html_() for tag in ("<pre>", "<table"))
    assert made.summary().strip()
    assert len(made.to_dataframe().columns) > 0


@pytest.mark.long
def test_a_mechanism_is_a_value_a_name_or_a_file_everywhere(tmp_path: Path) -> None:
    path = write(TABLE, tmp_path / "table.csv")
    by_name = gp.calibrate("irb6400r", path)
    assert by_name.record.verdict == gp.calibrate(ARM, TABLE).record.verdict.replace("data frame", "table.csv")
    assert gp.check("irb6400r", path).valid
    assert len(gp.read_table(path, "irb6400r")) == len(TABLE)
    np.testing.assert_array_equal(gp.choose_poses("irb6400r", 4).q, gp.choose_poses(ARM, 4).q)
    np.testing.assert_array_equal(gp.simulate("ur5").table.q, gp.simulate(gp.load_mechanism("ur5")).table.q)
    by_name.model.save(tmp_path / "model.json")
    assert gp.load_model(tmp_path / "model.json", "irb6400r").summary() == by_name.model.summary()


@pytest.mark.parametrize("value", [NOTHING, NUMBER, LIST, OBJECT, b"sin(J4)", {}])
def test_an_expression_is_a_text(value: object) -> None:
    with pytest.raises(gp.InputError, match=r"is not an expression; expected a text, for example 'sin\(2\*J4\)'"):
        gp.Expression(value)  # type: ignore[arg-type]


@pytest.mark.parametrize("value", [NOTHING, NUMBER, "sin(J4)", LIST])
def test_a_basis_is_an_expression(value: object) -> None:
    with pytest.raises(gp.InputError, match=r"is no basis; expected an Expression, as in Expression\('sin\(2\*J4\)'\)"):
        gp.effect_at("mine", "J4.moving", "Rz", value)  # type: ignore[arg-type]


@pytest.mark.parametrize("read", [gp.load_mechanism, gp.load_model, lambda name: gp.read_table(name, ARM)])
def test_a_name_that_no_file_has_is_one_line(read: Callable[[str], object]) -> None:
    with pytest.raises(gp.InputError):
        read("a\0b")


@pytest.mark.long
def test_an_effect_that_cannot_be_here_is_refused_before_the_search() -> None:
    for wrong in (
        gp.effect_at("mine", "J9.moving", "Rz", gp.Expression("sin(J4)")),
        gp.effect_at("mine", "J4.moving", "Rz", gp.Expression("humidity")),
        gp.effect_at("mine", "J4.moving", "Rz", gp.Expression("1/(row-3)")),
    ):
        refused(lambda wrong=wrong: gp.discover(ARM, TABLE, candidates=(*gp.catalogue, wrong)), "candidates")
        refused(lambda wrong=wrong: gp.calibrate(ARM, TABLE, [wrong]), "effects")


@pytest.mark.parametrize(
    "make",
    [
        lambda: gp.calibrate(ARM, TABLE, [gp.Effect("a", (), "rad")]),
        lambda: gp.discover(ARM, TABLE, candidates=(gp.Effect("a", (), "rad"),)),
        lambda: gp.Effect("a", 5, "rad"),
        lambda: gp.Effect("a", ("J1",), "rad"),
        lambda: gp.Candidate("a", (), "f", 4.0),
        lambda: gp.Candidate("a", (5,), "f", 4.0),
        lambda: gp.Candidate("a", (gp.effect_at("a", "base", "Rx"),), "f", float("nan")),
        lambda: gp.Family("a", "b", "c", 5),
    ],
)
def test_what_effects_and_candidates_cannot_be_made_of_is_refused(make: Callable[[], object]) -> None:
    with pytest.raises(gp.InputError, match=r"'a'.*[Ee]xpected"):
        make()


def test_particulars_that_are_none_are_refused() -> None:
    with pytest.raises(gp.InputError, match="5, expected a TOML file or Particulars"):
        gp.certificate(RESULTS["calibrate"](), 5)

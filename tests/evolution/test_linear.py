"""The linear sequence of the thesis: decoding, its open choices, breeding."""

import numpy as np
import pytest

from gpmodel.errors import InputError
from gpmodel.evolution.kernels.machine import split_instructions
from gpmodel.evolution.linear import Linear, Sequences
from gpmodel.evolution.machine import Layout
from gpmodel.evolution.representation import program_of
from gpmodel.formula.operators import TABLE_CONSTANTS, operator_set

ELEMENTS = ("x", "y", "z", "J1", "J2", "J3", "J4", "J5", "J6")
THESIS = Layout(ELEMENTS, operator_set("thesis"), TABLE_CONSTANTS, ("x", "y", "z", *[None] * 5), 3)


def text(genes: list[int], layout: Layout = THESIS, constants: tuple[float, ...] = ()) -> str:
    programs = Sequences(np.array([genes], dtype=np.uint8), np.array([constants]).reshape(1, -1))
    return str(program_of(programs, 0, layout))


def test_fig_5_4_decodes_as_printed() -> None:
    genes = np.array([0, 0, 2, 6, 16, 15, 4, 6], dtype=np.uint8)
    pairs = np.empty(9, np.uint16)
    count = split_instructions(genes, THESIS.tables.op_codes, pairs)
    assert [divmod(pair, 256) for pair in pairs[:count].tolist()] == [(0, 0), (2, 6), (16, 0), (15, 0), (4, 6)]
    assert text([*genes, 2, 0]) == "cos(tan(x)) - x, y, z"


@pytest.mark.parametrize(
    ("genes", "expected"),
    [
        ([14], "x, y, z"),
        ([14, 2, 0], "sin(x), y, z"),
        ([0, 3, 2, 1], "x, J1, z"),
        ([1, 2, 2, 0], "z, y, z"),
        ([0, 14, 2, 0], "0.1, y, z"),
        ([0, 9, 3, 5, 2, 2], "x, y, 1e-06 + 0"),
        ([0, 4, 2, 7, 1, 0, 5, 7, 2, 0], "x*J2, y, z"),
        ([0, 3, 2, 0, 2], "J1, y, z"),
        ([0, 3, 2, 0, 3], "J1, y, z"),
    ],
    ids=["no store", "accumulator starts as r0", "input and store", "load", "constants follow the inputs",
         "registers start at 0", "through a register", "store without its operand", "add without its operand"],
)  # fmt: skip
def test_open_choices(genes: list[int], expected: str) -> None:
    assert text(genes) == expected


def test_codes_on_offer_are_themselves_and_others_stand_for_one() -> None:
    smooth = Layout(ELEMENTS, operator_set("smooth"), (), ("x", "y", "z"), 3)
    offered = {0, 1, 2, *(operator.code for operator in operator_set("smooth"))}
    assert set(smooth.opcode_table.tolist()) == offered
    assert all(smooth.opcode_table[code] == code for code in offered)


def test_every_element_register_and_operand_can_be_named() -> None:
    layout = Layout(("a", "b"), operator_set("add"), (1.0,), ("a", "b", None), 3, 2, direct=True)
    rows = {layout.operand(0, gene) for gene in range(256)}
    assert rows == {("row", k) for k in (0, 1, 2, 4, 5)}
    operands = {layout.operand(3, gene) for gene in range(256)}
    assert operands == rows | {("register", k) for k in range(3)}


def test_own_constants_are_elements_after_the_fixed_ones() -> None:
    layout = Layout(("a",), operator_set("add"), (1.0,), ("a",), 1, 2)
    assert text([0, 3, 2, 0], layout, (0.25, 0.75)) == "0.75"


def test_children_have_random_streams_of_their_own() -> None:
    layout, linear = Layout(("a", "b"), operator_set("slot"), (1.0,), ("a", "b"), 2, 3), Linear(50, own_constants=3)
    rng = np.random.default_rng(4)
    parents = linear.initial(layout, 700, rng)
    mothers, fathers = rng.integers(0, 700, (2, 3000))
    children = linear.offspring(layout, parents, mothers, fathers, rng)
    assert len(np.unique(children.genes, axis=0)) > 2900


def test_a_child_is_made_of_its_parents() -> None:
    layout, linear = Layout(("a",), operator_set("add"), (), ("a",), 1), Linear(200, crossover=0.05, mutation=0.0)
    rng = np.random.default_rng(5)
    parents = linear.initial(layout, 2, rng)
    child = linear.offspring(layout, parents, np.zeros(100, np.int64), np.ones(100, np.int64), rng)
    assert np.all((child.genes == parents.genes[0]) | (child.genes == parents.genes[1]))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"inputs": ("a", "a")}, "twice"),
        ({"outputs": 3}, "outputs"),
        ({"start": ("q",)}, "no input 'q'"),
        ({"inputs": tuple(map(str, range(300)))}, "at most 256"),
    ],
)
def test_a_layout_that_cannot_be_addressed_is_refused(changes: dict, message: str) -> None:
    given = {"inputs": ("a",), "operators": operator_set("add"), "constants": (), "start": (None,), "outputs": 1}
    with pytest.raises(InputError, match=message):
        Layout(**{**given, **changes})

"""Names of joints and of what is named after them: the mechanism's, the table's, and J1 to Jn in chain order."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect, Term
from gpmodel.model.memory import read_by
from gpmodel.model.states import States
from gpmodel.table.dataset import Dataset

_WORD = re.compile(r"[A-Za-z_][A-Za-z_0-9]*")


def names_of(data: Dataset) -> Mapping[str, str]:
    """Names of joints, loads and extra columns in the table, by the mechanism's."""
    return {**table_names(data.joints, data.columns or data.joints), **data.extra_names}


def table_names(joints: Sequence[str], columns: Sequence[str]) -> Mapping[str, str]:
    """Translation of joint names, and of the loads named after them, into the names of the table's columns."""
    out = {}
    for joint, column in zip(joints, columns, strict=True):
        out[joint] = column
        for prefix in ("torque", "payload_torque", "approach", "last_move"):
            out[f"{prefix}_{joint}"] = f"{prefix}_{column}"
        for axis in "xyz":
            for prefix in ("force", "moment"):
                out[f"{prefix}_{joint}_{axis}"] = f"{prefix}_{column}_{axis}"
    return {**out, **_unit_loads(dict(zip(joints, columns, strict=True)))}


def _unit_loads(columns: Mapping[str, str]) -> dict[str, str]:
    """The loads of one link each: `torque_J2_of_J4`, of its first moment of mass `torque_J2_of_J4_x`."""
    at = {f"torque_{j}": f"torque_{c}" for j, c in columns.items()}
    at |= {f"moment_base_{a}": f"moment_base_{a}" for a in "xy"}
    return {
        f"{here}_of_{link}{axis}": f"{shown}_of_{column}{axis}"
        for here, shown in at.items()
        for link, column in columns.items()
        for axis in ("", "_x", "_y", "_z")
    }


def translate(text: str, names: Mapping[str, str]) -> str:
    """`text` with whole words replaced, those inside remembered columns too: `J1` is never matched inside `J10`."""

    def said(match: re.Match[str]) -> str:
        word = match[0]
        for source in () if word in names else read_by(word):
            word = word.replace(f"_{source}", f"_{names.get(source, source)}", 1)
        return names.get(word, word)

    return _WORD.sub(said, text)


def mechanism_names(mechanism: Mechanism, states: States) -> Mapping[str, str]:
    """The mechanism's names of joints and loads by those with J1 to Jn, where these poses know nothing of that name."""
    own = [joint.name for joint in mechanism.joints]
    numbered = [f"J{i}" for i in range(1, len(own) + 1)]
    known = {*own, *states.columns}
    return {said: name for said, name in table_names(numbered, own).items() if said not in known}


def in_mechanism_names(effect: Effect, mechanism: Mechanism, states: States) -> Effect:
    """An effect with the mechanism's names in its slots and expressions; other bases stay as they are."""
    names = mechanism_names(mechanism, states)
    return replace(effect, terms=tuple(_renamed(term, names) for term in effect.terms))


def _renamed(term: Term, names: Mapping[str, str]) -> Term:
    basis = term.basis
    if isinstance(basis, Expression):
        basis = Expression(translate(str(basis), names))
    return replace(term, slot=translate(term.slot, names), basis=basis)

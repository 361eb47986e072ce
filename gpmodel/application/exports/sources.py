"""Write the forward model as NumPy source and as C99 source, and the terms of the model as LaTeX."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from importlib.resources import files
from typing import Literal

import numpy as np

from gpmodel.application.compensate import MAX_MOVE
from gpmodel.application.exports.forward import Body, Forward, Line
from gpmodel.application.usable import Clamped
from gpmodel.arrays import Array
from gpmodel.calibration.unmeasured_joints import ROTATION_WEIGHT
from gpmodel.characters import harmless
from gpmodel.formula.expression import Expression
from gpmodel.formula.printing import as_in_latex, in_latex, inline, latex_lines
from gpmodel.formula.program import Builder, Program
from gpmodel.mechanism.protocol import AXES
from gpmodel.mechanism.source import choice_of
from gpmodel.model.sites import translate

_CLAMP = {"numpy": "np.clip({0}, {1!r}, {2!r})", "c99": "fmin(fmax({0}, {1!r}), {2!r})"}


def numpy_text(forward: Forward, note: str) -> str:
    """Write the source of a Python module with a function predict(q, **inputs)."""
    weighs = [f"{name} = [{', '.join(of)}]" for name, of in _weights(forward, "np.ones(len(q))", "np.zeros(len(q))")]
    lines = [f"s_{n} = q[:, {j}]" for j, n in enumerate(_joints(forward))]
    lines += [f"s_{n} = inputs[{called!r}]" for n, called in zip(forward.inputs, input_names(forward), strict=True)]
    lines += weighs + [f"s_{n} = {text}" for n, text in forward.computed.items()]
    terms = [f"twists[{t.slot}, :, {t.axis}] += {_term(t, 'numpy')}" for t in forward.lines]
    registration, tool = _placed(forward)
    return _filled("model.py.txt", {
        "NOTE": harmless(note), "JOINTS": list(forward.saved.columns), 
        "INPUTS": dict(zip(input_names(forward), forward.inputs.values(), strict=True)), "DEFAULTS": _defaults(forward),
        "FIXED": forward.chain.fixed.tolist(), "MOVES": _moves(forward),
        "BODIES": [(b.slot, b.mass, b.centre.tolist()) for b in _bodies(forward)],
        "GRAVITY": forward.gravity.tolist(), "REGISTRATION": registration, "TOOL": tool,
        "COLUMNS": _indented(lines), "TERMS": _indented(terms),
    })  # fmt: skip


def c_text(forward: Forward, note: str, cases: Array) -> str:
    """Write the source of a C99 file with the functions gpmodel_predict and gpmodel_compensate.

    cases: joint values, inputs and predicted point of each test pose, one row a pose, for the self-test of the file.
    """
    joints, bodies = _joints(forward), _bodies(forward)
    lines = [f"const double s_{n} = q[{j}];" for j, n in enumerate(joints)]
    lines += [f"const double s_{n} = inputs[{k}];" for k, n in enumerate(forward.inputs)]
    lines += [f"const double {name}[BODIES] = {_braces(of)};" for name, of in _weights(forward, "1.0", "0.0")]
    lines += [f"const double s_{n} = {text};" for n, text in forward.computed.items()]
    lines += [f"(void)s_{n};" for n in (*joints, *forward.inputs)] + ["(void)weights;"]
    terms = [f"twists[{t.slot}][{t.axis}] += {_term(t, 'c99')};" for t in forward.lines]
    moves, (registration, tool) = _moves(forward), _placed(forward)
    return _filled("model.c.txt", _said(forward, note) | {
        "N": len(joints), "M": len(forward.inputs), "S": len(moves), "B": len(bodies),
        "ASKED": 6 if np.any(forward.chain.weights, axis=0).sum() >= 6 else 3, "LENGTH": ROTATION_WEIGHT,
        "FIXED": _braces(forward.chain.fixed.tolist()), "AXES": _braces([axis for axis, _ in moves]),
        "MOVES": _braces([weights for _, weights in moves]), "AT": _braces([b.slot for b in bodies]),
        "SLIDES": _braces([int(joint.kind == "prismatic") for joint in forward.saved.mechanism.joints]),
        "MASS": _braces([b.mass for b in bodies]), "CENTRE": _braces([b.centre.tolist() for b in bodies]),
        "GRAVITY": _braces(forward.gravity.tolist()),
        "REGISTRATION": _braces(registration), "TOOL": _braces(tool),
        "CASES": _braces(cases.tolist()), "COLUMNS": _indented(lines), "TERMS": _indented(terms),
    })  # fmt: skip


def header_text(forward: Forward, note: str) -> str:
    """Write the header file of the exported C source, for C and C++."""
    return _filled("model.h.txt", _said(forward, note))


def _said(forward: Forward, note: str) -> dict[str, object]:
    units = zip(input_names(forward), forward.inputs.values(), strict=True)
    inputs = ", ".join(harmless(f"{name} [{unit}]") for name, unit in units)
    joints = ", ".join(map(harmless, forward.saved.columns))
    far = f"{MAX_MOVE * ROTATION_WEIGHT:.4g}"
    return {"NOTE": harmless(note), "JOINTS": joints, "INPUTS": inputs, "MOST": MAX_MOVE, "FAR": far}


def nameless(forward: Forward) -> Forward:
    """Replace the joint names of the table by the names of the mechanism, which are plain words.

    The check of an export runs source with the replaced names and an empty note, so that no text of an untrusted file
    is executed.
    """
    return replace(forward, saved=replace(forward.saved, measured=None))


def latex_text(forward: Forward) -> str:
    """Write LaTeX equations, one per component of an error twist, m or rad, to DIGITS digits; common terms first."""
    places, program = equations(forward)
    names = forward.saved.names
    parts, outputs = latex_lines(program, names)
    rows = [f"{name} &= {text}" for name, text in parts]
    for (slot, axis), text in zip(places, outputs, strict=True):
        name = in_latex(translate(forward.chain.slots[slot], names))
        rows.append(f"\\xi_{{\\mathrm{{{name}}},\\,{AXES[axis]}}} &= {text}")
    return "\\begin{align}\n" + " \\\\\n".join(rows) + "\n\\end{align}\n"


def equations(forward: Forward) -> tuple[list[tuple[int, int]], Program]:
    """Return the frames (slots) and axes with an error twist, and a program with one output for each, m or rad."""
    builder, sums = Builder(), dict[tuple[int, int], int]()
    for line in forward.lines:
        basis = Expression(str(line.basis)).program
        term = builder.copy(basis)[basis.outputs[0]]
        term = builder.apply("multiply", builder.constant(line.coefficient), term)
        place = (line.slot, line.axis)
        sums[place] = builder.apply("add", sums[place], term) if place in sums else term
    places = sorted(sums)
    return places, builder.program([sums[place] for place in places])


def to_the_digits(forward: Forward) -> Forward:
    """Return the model with coefficients rounded to the digits of the LaTeX equations."""
    places, program = equations(forward)
    printed = as_in_latex(program)
    lines = (Line(slot, axis, 1.0, Expression(str(printed.select([k])))) for k, (slot, axis) in enumerate(places))
    return replace(forward, lines=tuple(lines))


def _term(line: Line, language: Literal["numpy", "c99"]) -> str:
    """Write coefficient * basis as source; inputs of a formula outside the catalogue are clipped to their ranges."""
    columns = {name: f"s_{name}" for name in line.basis.inputs}
    if isinstance(line.basis, Clamped):
        for name, (low, high) in line.basis.ranges.items():
            if name in columns:
                columns[name] = _CLAMP[language].format(columns[name], float(low), float(high))
    return f"{line.coefficient!r} * {inline(Expression(str(line.basis)).program, language, columns)}"


def _joints(forward: Forward) -> tuple[str, ...]:
    """Return the mechanism's joint names, as used in basis functions."""
    return tuple(joint.name for joint in forward.saved.mechanism.joints)


def _defaults(forward: Forward) -> dict[str, float]:
    """Return the payload, kg, that predict assumes without one; none if loads follow the payload of the fitted rows."""
    stated, fitted = choice_of(forward.saved.mechanism).payload, forward.saved.measured
    read = forward.computed or any("payload" in line.basis.inputs for line in forward.lines)
    carried = stated is None and fitted is not None and fitted.dataset.payload_given
    return {} if carried and read else {"payload": float(stated or 0.0)}


def input_names(forward: Forward) -> tuple[str, ...]:
    """Return the names of the model's inputs other than joint values, as in the fitted table."""
    return tuple(translate(name, forward.saved.names) for name in forward.inputs)


def _moves(forward: Forward) -> list[tuple[int, list[float]]]:
    chain = forward.chain
    return [
        (AXES.index(axis) if axis else -1, weights)
        for axis, weights in zip(chain.axes, chain.weights.tolist(), strict=True)
    ]


def _bodies(forward: Forward) -> tuple[Body, ...]:
    return forward.bodies or (Body(len(forward.chain.slots) - 1, 0.0, np.zeros(3)),)


def _weights(forward: Forward, one: str, none: str) -> Iterator[tuple[str, list[str]]]:
    """Yield the weights of the bodies in a gravity load, by name: for all bodies, and for each with a separate load.

    The payload is the last of the bodies.
    """
    every = [one] * (len(_bodies(forward)) - 1) + ["s_payload"]
    yield "weights", every
    for k in range(len(forward.bodies)):
        if any(f"weight_of_{k})" in text for text in forward.computed.values()):
            yield f"weight_of_{k}", [of if i == k else none for i, of in enumerate(every)]


def _placed(forward: Forward) -> tuple[list[list[float]], list[list[float]]]:
    """Return the frames of registration and tool as nested lists for a template."""
    placed, at = forward.saved.placement, forward.place
    return placed.registration[at.setup].tolist(), placed.tool[at.tool].tolist()


def _braces(value: object) -> str:
    """Write a number or nested list as an initialiser of C."""
    return repr(value).replace("[", "{").replace("]", "}").replace("(", "{").replace(")", "}").replace("'", "")


def _indented(lines: list[str]) -> str:
    return "\n".join(f"    {line}" for line in lines)


def _filled(template: str, values: Mapping[str, object]) -> str:
    """Replace every @NAME@ of a template in one pass, so that inserted text is not replaced again."""
    text = (files("gpmodel.application.exports") / "templates" / template).read_text(encoding="utf-8")
    return re.sub(r"@([A-Z]+)@", lambda match: str(values[match[1]]), text)

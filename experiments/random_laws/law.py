"""Define a formula of named columns, and the site where it acts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.blind.oracle import sensitivities
from experiments.blind.shapes import Motion
from experiments.blind.simulator import Arm, Array

Shape = Callable[[str, np.random.Generator], str]


def _within(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.round(rng.uniform(low, high), 3))


def _either(rng: np.random.Generator, low: float, high: float) -> float:
    """A number of that size and of either sign."""
    return float(rng.choice([-1, 1])) * _within(rng, low, high)


def _from(x: str, rng: np.random.Generator, most: float = 0.5) -> str:
    """A variable from an origin of its own."""
    return f"({x} - {_within(rng, -most, most)})"


def _beyond(x: str, rng: np.random.Generator, least: float, most: float) -> str:
    """A variable, or its mirror image, that stays above zero."""
    return f"({_within(rng, least, most)} {rng.choice(['+', '-'])} {x})"


SHAPES: dict[str, Shape] = {
    "power": lambda x, g: f"sign({x})*abs({x})**{_within(g, 1.5, 3.5)}",
    "sine": lambda x, g: f"sin({_within(g, 1.7, 7.3)}*{x} + {_within(g, 0, 6.28)})",
    "chirp": lambda x, g: f"sin({_within(g, 1.0, 2.2)}*{_beyond(x, g, 1.2, 1.5)}**2)",
    "algebraic_saturation": lambda x, g: f"{x}/sqrt(1 + ({_within(g, 2, 6)}*{x})**2)",
    "arctangent": lambda x, g: f"arctan({_within(g, 2, 8)}*{_from(x, g)})",
    "soft_hinge": lambda x, g: f"log(1 + exp({_either(g, 8, 30)}*{_from(x, g)}))",
    "dead_zone": lambda x, g: "maximum({0} - {1}, 0) + minimum({0} + {1}, 0)".format(x, _within(g, 0.3, 0.6)),
    "logistic": lambda x, g: f"1/(1 + exp({_within(g, 6, 30)}*{_from(x, g)}))",
    "exponential": lambda x, g: f"exp({_either(g, 1.2, 3.0)}*{x})",
    "quotient": lambda x, g: f"1/{_beyond(x, g, 1.15, 1.6)}",
    "rational": lambda x, g: f"{_from(x, g)}/(1 + ({_within(g, 1.5, 5)}*{_from(x, g)})**2)",
    "bump": lambda x, g: f"exp(-({_from(x, g)}/{_within(g, 0.2, 0.6)})**2)",
    "absolute": lambda x, g: f"abs{_from(x, g)}",
    "root": lambda x, g: f"sqrt{_beyond(x, g, 1.01, 1.2)}",
    "logarithm": lambda x, g: f"log{_beyond(x, g, 1.03, 1.3)}",
    "damped_oscillation": lambda x, g: f"exp({_either(g, 0.7, 2.0)}*{x})*sin({_within(g, 3, 8)}*{x})",
    "cubic": lambda x, g: f"({x}**3 - {_within(g, 0.3, 0.9)}*{x})",
    "cardinal_sine": lambda x, g: f"sinc({_within(g, 1.0, 2.5)}*{_from(x, g)})",
    "rectified_sine": lambda x, g: f"abs(sin({_within(g, 1.5, 4)}*{x} + {_within(g, 0, 3.14)}))",
}


def _shape(x: str, rng: np.random.Generator) -> tuple[str, str]:
    name = str(rng.choice(list(SHAPES)))
    return name, SHAPES[name](x, rng)


def one_variable(rng: np.random.Generator) -> tuple[str, str]:
    """Draw the name of a shape and a formula in u."""
    return _shape("u", rng)


def two_variables(rng: np.random.Generator) -> tuple[str, str]:
    """Draw the components of a formula in u and v, and the formula."""
    form = str(rng.choice(["product", "growing", "of a sum", "of a distance", "sum"], p=[0.4, 0.2, 0.15, 0.1, 0.15]))
    if form == "of a sum":
        name, text = _shape(f"((u + {_either(rng, 0.5, 1.0)}*v)/2)", rng)
        return f"{name} of a sum", text
    if form == "of a distance":
        name, text = _shape(f"(hypot({_from('u', rng)}, {_from('v', rng)}) - 1)", rng)
        return f"{name} of a distance", text
    first, text = _shape("u", rng)
    if form == "growing":
        return f"{first} growing", f"({text})*{_from('v', rng)}"
    second, other = _shape("v", rng)
    return f"{first} {'*' if form == 'product' else '+'} {second}", (
        f"({text})*({other})" if form == "product" else f"({text}) + ({other})"
    )


def three_variables(rng: np.random.Generator) -> tuple[str, str]:
    """Draw the components of a formula in u, v and w, and the formula."""
    form = str(rng.choice(["two growing", "one growing", "sum"], p=[0.5, 0.25, 0.25]))
    first, text = _shape("u", rng)
    if form == "one growing":
        return f"{first} growing twice", f"({text})*{_from('v', rng)}*{_from('w', rng)}"
    if form == "two growing":
        second, other = _shape("v", rng)
        return f"{first} * {second} growing", f"({text})*({other})*{_from('w', rng)}"
    third, other = _shape("w", rng)
    return f"{first} growing + {third}", f"({text})*{_from('v', rng)} + ({other})"


def weighted_sum(rng: np.random.Generator, count: int) -> tuple[str, str]:
    """Draw a shape of a weighted sum of ``count`` variables, and its formula."""
    terms = ["u", *(f"{_either(rng, 0.5, 1.0)}*{x}" for x in "vw"[: count - 1])]
    name, text = _shape(f"(({' + '.join(terms)})/{count})", rng)
    return f"{name} of {count}", text


def product_of_three(rng: np.random.Generator) -> tuple[str, str]:
    """Draw three shapes and the formula of their product."""
    names, texts = zip(*(_shape(x, rng) for x in "uvw"), strict=True)
    return " * ".join(names), "*".join(f"({text})" for text in texts)


def sum_of_formulas(rng: np.random.Generator, count: int) -> tuple[str, str]:
    """Draw two formulas, of three variables the first a product, and the formula of their sum."""
    first, text = _shape("u", rng)
    if count == 3:
        second, other = _shape("v", rng)
        first, text = f"{first} * {second}", f"({text})*({other})"
    last, summand = _shape("uvw"[count - 1], rng)
    return f"{first} + {last}", f"({text}) + ({summand})"


def two_waves(rng: np.random.Generator) -> tuple[str, str]:
    """Draw the product of two sines that both run through a full period or more."""
    waves = (f"sin({_within(rng, 3.2, 7.0)}*{x} + {_within(rng, 0, 6.28)})" for x in "uv")
    return "sine * sine", "*".join(waves)


@dataclass(frozen=True)
class Grammar:
    """title: of the table; inputs: numbers of variables; draw: components and formula; poses: fewest and most."""

    title: str
    inputs: tuple[int, ...]
    draw: Callable[[np.random.Generator, int], tuple[str, str]]
    poses: tuple[int, int] = (100, 200)


GRAMMARS: dict[int | str, Grammar] = {
    0: Grammar("No law", (0,), lambda g, n: ("", ""), (40, 400)),
    1: Grammar("Laws of one input", (1,), lambda g, n: one_variable(g), (40, 400)),
    2: Grammar("Laws of two inputs", (2,), lambda g, n: two_variables(g), (40, 400)),
    3: Grammar("Laws of three inputs", (3,), lambda g, n: three_variables(g), (40, 400)),
    "one": Grammar("One input", (1,), lambda g, n: one_variable(g)),
    "two": Grammar("Two inputs", (2,), lambda g, n: two_variables(g)),
    "weighted": Grammar("A shape of a weighted sum of two or three inputs", (2, 3), weighted_sum),
    "product": Grammar("Products of three", (3,), lambda g, n: product_of_three(g)),
    "sum": Grammar("Sums of two formulas at one site", (2, 3), sum_of_formulas),
    "waves": Grammar("Two oscillating factors", (2,), lambda g, n: two_waves(g)),
}
"""Grammars by name, or by the number of variables at 40 to 400 poses."""


AXES = ("Tx", "Ty", "Tz", "Rx", "Ry", "Rz")
_FUNCTIONS = {
    name: getattr(np, name)
    for name in ("abs", "arctan", "exp", "hypot", "log", "maximum", "minimum", "sign", "sin", "sinc", "sqrt")
}


@dataclass(frozen=True)
class Law:
    """text: in u, with more inputs in v and w; u = (first input - middle) / half, which runs over [-1, 1]."""

    text: str
    inputs: tuple[str, ...]
    middle: tuple[float, ...]
    half: tuple[float, ...]

    def scaled(self, columns: Any) -> list[Array]:
        """u, v and w (N,) from the columns of the inputs; beyond the ranges they were drawn with stay at the edge."""
        scales = zip(self.inputs, self.middle, self.half, strict=True)
        return [np.clip((columns[name] - middle) / half, -1.0, 1.0) for name, middle, half in scales]

    def __call__(self, columns: Any) -> Array:
        """(N,) values from the columns of the inputs."""
        values = dict(zip("uvw", self.scaled(columns), strict=False))
        return np.asarray(eval(self.text, {"__builtins__": {}}, {**_FUNCTIONS, **values}))

    def __str__(self) -> str:
        parts = zip("uvw", self.inputs, self.middle, self.half, strict=False)
        return f"{self.text} with " + ", ".join(f"{x} = ({n} - {m:.6g})/{h:.6g}" for x, n, m, h in parts)


@dataclass(frozen=True)
class Place:
    """An axis of a slot: `base`, `J3.fixed` (before the joint moves), `J3.moving` (after) or `tool`."""

    slot: str
    axis: str

    def motion(self, arm: Arm, phi: Array) -> Motion:
        """Small motions of the simulator's frames, phi (N,) in m or rad along the axis.

        A motion xi before joint i moves is one of the frame i - 1 by (R v + p x R w, R w), with R and p the joint's
        origin in that frame.
        """
        twist = np.zeros((len(phi), 6))
        twist[:, AXES.index(self.axis)] = phi
        if self.slot in ("base", "tool"):
            return {0 if self.slot == "base" else len(arm.rows): twist}
        joint, side = int(self.slot[1:].split(".")[0]), self.slot.split(".")[1]
        if side == "moving":
            return {joint: twist}
        origin = arm.origins()[joint - 1]
        turned = twist.reshape(-1, 2, 3) @ origin[:3, :3].T
        return {joint - 1: np.hstack([turned[:, 0] + np.cross(origin[:3, 3], turned[:, 1]), turned[:, 1]])}

    def column(self, arm: Arm, tool: Array, q: Array) -> Array:
        """(N, 3) how the tool point moves by a unit motion here, in the base's frame."""
        by_twist = sensitivities(arm, np.eye(4), tool, q, {})
        moved = self.motion(arm, np.ones(len(q)))
        return np.asarray(sum(np.einsum("nij,nj->ni", by_twist[slot], twist) for slot, twist in moved.items()))


def places(arm: Arm) -> list[Place]:
    """Both sides of every joint and the base in six axes, the tool in three."""
    slots = ["base", *(f"J{i + 1}.{side}" for i in range(len(arm.rows)) for side in ("fixed", "moving"))]
    return [*(Place(slot, axis) for slot in slots for axis in AXES), *(Place("tool", axis) for axis in AXES[:3])]


def drawn_law(text: str, inputs: tuple[str, ...], ranges: Mapping[str, tuple[float, float]]) -> Law:
    """The law with its inputs scaled by their ranges."""
    bounds = [ranges[name] for name in inputs]
    return Law(text, inputs, tuple((a + b) / 2 for a, b in bounds), tuple((b - a) / 2 for a, b in bounds))

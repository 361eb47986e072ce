"""Twenty-four public laws: Feynman (Udrescu and Tegmark 2020) and Strogatz ODEs (La Cava et al. 2016)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Law:
    """A law, the uniform range of each variable, and its exact form as text for sympy."""

    name: str
    ranges: dict[str, tuple[float, float]]
    text: str

    def sample(self, points: int, rng: np.random.Generator) -> tuple[dict[str, Array], Array]:
        columns = {name: rng.uniform(*limits, points) for name, limits in self.ranges.items()}
        return columns, evaluate(self.text)(columns)


def evaluate(text: str) -> Callable[[dict[str, Array]], Array]:
    names = {name: getattr(np, name) for name in ("sin", "cos", "tan", "tanh", "exp", "log", "sqrt", "pi")}
    names["asin"] = np.arcsin
    return lambda columns: eval(text, {"__builtins__": {}}, {**names, **columns})


def _law(name: str, text: str, **ranges: tuple[float, float]) -> Law:
    return Law(name, ranges, text)


P = (1.0, 5.0)

LAWS = (
    _law("I.6.2a", "exp(-t**2/2)/sqrt(2*pi)", t=(1, 3)),
    _law("I.8.14", "sqrt((x2 - x1)**2 + (y2 - y1)**2)", x1=P, x2=P, y1=P, y2=P),
    _law("I.12.11", "q*(E + B*v*sin(t))", q=P, E=P, B=P, v=P, t=P),
    _law("I.13.12", "G*m1*m2*(1/r2 - 1/r1)", G=P, m1=P, m2=P, r1=P, r2=P),
    _law("I.16.6", "(u + v)/(1 + u*v/c**2)", c=P, u=P, v=P),
    _law("I.18.4", "(m1*r1 + m2*r2)/(m1 + m2)", m1=P, m2=P, r1=P, r2=P),
    _law("I.27.6", "1/(1/d1 + n/d2)", d1=P, d2=P, n=P),
    _law("I.29.16", "sqrt(x1**2 + x2**2 - 2*x1*x2*cos(t1 - t2))", x1=P, x2=P, t1=P, t2=P),
    _law("I.37.4", "i1 + i2 + 2*sqrt(i1*i2)*cos(d)", i1=P, i2=P, d=P),
    _law("I.40.1", "n*exp(-m*g*x/(k*T))", n=P, m=P, g=P, x=P, k=P, T=P),
    _law("I.44.4", "n*k*T*log(V2/V1)", n=P, k=P, T=P, V1=P, V2=P),
    _law("I.50.26", "x1*(cos(w*t) + a*cos(w*t)**2)", x1=(1, 3), w=(1, 3), t=(1, 3), a=(1, 3)),
    _law("bacres1", "20 - x - x*y/(1 + 0.5*x**2)", x=(0, 20), y=(0, 20)),
    _law("bacres2", "10 - x*y/(1 + 0.5*x**2)", x=(0, 20), y=(0, 20)),
    _law("barmag1", "0.5*sin(x - y) - sin(x)", x=(0, 6.283), y=(0, 6.283)),
    _law("barmag2", "0.5*sin(y - x) - sin(y)", x=(0, 6.283), y=(0, 6.283)),
    _law("glider1", "-0.05*x**2 - sin(y)", x=(1, 8), y=(-3, 3)),
    _law("glider2", "x - cos(y)/x", x=(1, 8), y=(-3, 3)),
    _law("lv1", "3*x - 2*x*y - x**2", x=(0, 8), y=(0, 3)),
    _law("predprey1", "x*(4 - x - y/(1 + x))", x=(0, 8), y=(0, 8)),
    _law("predprey2", "y*(x/(1 + x) - 0.075*y)", x=(0, 8), y=(0, 8)),
    _law("shearflow1", "cos(x)/tan(y)", x=(-3.14, 3.14), y=(0.2, 1.5)),
    _law("shearflow2", "(cos(y)**2 + 0.1*sin(y)**2)*sin(x)", x=(-3.14, 3.14), y=(-1.57, 1.57)),
    _law("vdp1", "10*(y - (x**3 - x)/3)", x=(-2, 2), y=(-1, 1)),
)

"""Preloads that the thesis predicted and measured (Figures 3.25, 3.30, 4.31), beside the models' own."""

from dataclasses import dataclass

from joints.magnets import stack_factor
from joints.settings import DATA, quantity, read_toml

THICKNESS = 6e-3
"""m, Table 3.1."""

SPACER = 1.5875e-3
"""m, the 1/16 in between magnet and ball when the pull of one magnet was measured (section 3.6)."""

AGREEMENT = 0.10
"""What the thesis says of predicted and measured preloads: within 10 % (sections 3.6 and 3.7)."""


@dataclass(frozen=True)
class PublishedPreload:
    """predicted, measured: N, None where only a picture shows it. layers: of magnets on top of one another."""

    name: str
    predicted: float
    measured: float | None
    diameter: float
    layers: int
    source: str

    @property
    def stacked(self) -> float:
        """How many times one layer's pull the stack should give, by a cylinder's field at the spacer's distance."""
        return stack_factor(self.diameter, THICKNESS, self.layers, SPACER)


def published_preloads() -> tuple[PublishedPreload, ...]:
    """Every preload that the text states a figure of."""
    file = DATA / "preload_published.toml"
    return tuple(
        PublishedPreload(
            entry["name"],
            quantity(entry["predicted"], "1 N", f"{file.name}: predicted"),
            quantity(entry["measured"], "1 N", f"{file.name}: measured") if entry["measured"] else None,
            quantity(entry["diameter"], "1 mm", f"{file.name}: diameter"),
            entry["layers"],
            entry["source"],
        )
        for entry in read_toml(file)["joint"]
    )

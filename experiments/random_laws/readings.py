"""Columns beside the joint values: what a session of two hours reads."""

from __future__ import annotations

import numpy as np

from experiments.blind.simulator import Array

RANGES = {"temperature": (18.0, 34.0), "time": (0.0, 120.0), "payload": (0.0, 10.0), "pressure": (4.0, 8.0)}
"""degC, min, kg, bar."""


def readings(names: list[str], count: int, rng: np.random.Generator) -> dict[str, Array]:
    """(count,) of each: times that only grow, a temperature in slow waves, a few payloads, a pressure at random."""
    out: dict[str, Array] = {}
    for name in names:
        low, high = RANGES[name]
        if name == "time":
            values = np.sort(rng.uniform(low, high, count))
        elif name == "temperature":
            wave = np.sin(2 * np.pi * (rng.uniform(1.2, 2.5) * np.linspace(0, 1, count) + rng.uniform()))
            values = (low + high) / 2 + 0.35 * (high - low) * wave + rng.normal(0, 0.12 * (high - low), count)
        elif name == "payload":
            values = rng.choice(np.linspace(low, high, 6), count)
        else:
            values = rng.uniform(low, high, count)
        out[name] = np.round(np.clip(values, low, high), 3)
    return out

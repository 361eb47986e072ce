"""Ten effects in slot space: a shape at one of twenty sites, seen through a standard model and 10 % noise."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.projection import Targets

Array = NDArray[np.float64]
KINDS = (*["angle"] * 6, "temperature", "row")
POSES, HELD_OUT, SITES, ENABLED, NOISE, TRUE_SITE = 90, 200, 20, 25, 0.1, 7


@dataclass(frozen=True)
class Effect:
    """A planted effect: its name and its shape over the inputs."""

    name: str
    shape: Callable[[dict[str, Array]], Array]


EFFECTS = (
    Effect("gear harmonic with phase", lambda c: np.sin(2 * c["J4"] + 0.7)),
    Effect("three cycles a turn", lambda c: np.cos(3 * c["J6"] - 1.1)),
    Effect("coupling", lambda c: c["J4"] * np.cos(c["J5"])),
    Effect("local bump", lambda c: np.exp(-(((c["J2"] - 0.6) / 0.4) ** 2))),
    Effect("dead zone", lambda c: np.sign(c["J3"]) * np.maximum(np.abs(c["J3"]) - 0.8, 0)),
    Effect("saturating windup", lambda c: np.tanh(3 * c["J2"])),
    Effect("difference of joints", lambda c: np.sin(c["J3"] - c["J2"])),
    Effect("exponential warm-up", lambda c: np.exp(-5 * c["row"])),
    Effect("hardening spring", lambda c: np.sin(c["J2"]) * np.abs(np.sin(c["J2"]))),
    Effect("warm gravity", lambda c: c["temperature"] * np.sin(c["J2"])),
)


@dataclass(frozen=True)
class Planted:
    """The problem, the true shape on training poses, the truth's gain there and on held-out poses, and these poses."""

    problem: SlotProblem
    shape: Array
    gain: float
    heldout: float
    unseen: tuple[Inputs, Targets]


def planted(effect: Effect, seed: int) -> Planted:
    """Random smooth sensitivities at every site; constants there are the enabled columns."""
    rng = np.random.default_rng(seed)
    poses = POSES + HELD_OUT
    names = (*(f"J{k}" for k in range(1, 7)), "temperature", "row")
    values = np.vstack([rng.uniform(-2.5, 2.5, (6, poses)), rng.uniform(0, 1, (2, poses))])
    columns = dict(zip(names, values, strict=True))
    weights, phases = rng.normal(size=(SITES, 3, 7)), rng.uniform(0, 6, (SITES, 3, 6))
    waves = np.sin(values[None, None, :6] + phases[..., None])
    sensitivity = np.einsum("sck,sckn->snc", weights[..., :6], waves) + weights[:, None, :, 6]
    shape = effect.shape(columns)
    moved = sensitivity[TRUE_SITE] * shape[:, None]
    error = moved / np.sqrt(np.mean(moved**2)) + NOISE * rng.normal(size=moved.shape)
    enabled = sensitivity[rng.permutation(SITES)].transpose(1, 2, 0)
    enabled = np.concatenate([enabled, np.broadcast_to(np.eye(3), (poses, 3, 3))], axis=2)[:, :, :ENABLED]
    train, held = np.arange(POSES), np.arange(POSES, poses)
    parts = [_targets(sensitivity[:, rows], enabled[rows], error[rows]) for rows in (train, held)]
    inputs = [Inputs(names, values[:, rows], KINDS) for rows in (train, held)]
    problem = SlotProblem(inputs[0], parts[0], parsimony=2.0)
    gain, coefficients = parts[0].set_gain(shape[None, train], TRUE_SITE)
    told = parts[1].gain_of(shape[None, held], coefficients, TRUE_SITE)
    return Planted(problem, shape[train], gain, told, (inputs[1], parts[1]))


def _targets(sensitivity: Array, enabled: Array, error: Array) -> Targets:
    columns, _ = np.linalg.qr(enabled.reshape(-1, enabled.shape[2]))
    residual = error.ravel() - columns @ (columns.T @ error.ravel())
    return Targets(
        np.square(sensitivity).sum(axis=2),
        np.einsum("snc,nck->skn", sensitivity, columns.reshape(len(error), 3, -1)),
        np.einsum("snc,nc->sn", sensitivity, residual.reshape(-1, 3)),
        float(residual @ residual),
        tuple(f"site {k}" for k in range(SITES)),
        residual.size,
    )

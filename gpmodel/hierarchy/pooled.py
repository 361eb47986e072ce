"""Select the effects of a type by the evidence of all its machines together.

    gain(a) = Σ_i ½ Σ_k [ a q_ik² / (1 + a s_ik) - ln(1 + a s_ik) ] - cost            i: machines, k: directions

One variance a and one price for all machines. S_i = X_iᵀX_i / σ_i² = V diag(s_i) Vᵀ and q_i = VᵀX_iᵀr_i / σ_i², X_i the
columns of the group with everything that the model of machine i explains projected out, r_i its residual.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.cross_validation import cross_validated, paired_t
from gpmodel.evidence.residual import Residual
from gpmodel.evidence.score import best, fitted, with_own_noise
from gpmodel.evolution.chance import chance
from gpmodel.families.candidate import Candidate
from gpmodel.selection.group import Group, Shapes, group_of

Residuals = Callable[[Sequence[Candidate]], Sequence[Residual]]
"""The residual of every machine, calibrated with some candidates beside the geometry."""


@dataclass(frozen=True)
class Pooled:
    """A group scored on all machines. nats: net gain at the best common variance. typical: more than half of the
    machines gain at that variance, and the others do without the one that gains most."""

    nats: float
    typical: bool


def select_for_type(
    proposals: Mapping[str, Candidate], residuals: Residuals, criteria: Criteria, seed: int
) -> tuple[Candidate, ...]:
    """Forward selection with backward elimination over all machines.

    A candidate comes in where its pooled net gain is the largest, passes the limits of `criteria` (net gain,
    permutation null over all candidates, pooled cross-validation) and it is no effect of a minority.
    After each addition, a selected candidate that fails given the others is deleted for good.
    """
    rng, chosen, left = np.random.default_rng(seed), dict[str, Candidate](), dict(proposals)
    while left:
        machines = residuals(tuple(chosen.values()))
        groups = {name: group for name, c in left.items() if (group := _common(c, machines)) is not None}
        scored = {name: pooled(machines, group) for name, group in groups.items()}
        typical = {name: score.nats for name, score in scored.items() if score.typical}
        name = max(typical, key=typical.__getitem__, default=None)
        if name is None or not _passes(machines, groups[name], typical[name], criteria):
            break
        null = _null(machines, list(groups.values()), rng, criteria.shuffles)
        if chance(typical[name], null).p >= criteria.significance:
            break
        chosen[name] = left.pop(name)
        chosen = _weeded(chosen, residuals, criteria)
    return tuple(chosen.values())


def pooled(machines: Sequence[Residual], group: Group) -> Pooled:
    """Score a group on all machines, the noise of each estimated with it."""
    spectra = [_spectrum(of, group, of.values[:, None]) for of in machines]
    gains = _gains(machines, group, spectra)
    others = [k for k in range(len(machines)) if k != int(np.argmax(gains))]
    rest = _gains([machines[k] for k in others], group, [spectra[k] for k in others])
    typical = float(np.mean(gains > 0.0)) > 0.5 and float(np.sum(rest)) > group.cost
    return Pooled(float(np.sum(gains)) - group.cost, typical)


def _gains(machines: Sequence[Residual], group: Group, spectra: Sequence[tuple[Array, Array]]) -> Array:
    """Gains (m,) at the best common variance, nats."""
    s, q = (np.concatenate(parts, axis=-1) for parts in zip(*spectra, strict=True))
    variance = float(best(s[None], q, np.array([group.cap]))[1][0])
    return np.array([_gain(of, variance, *own) for of, own in zip(machines, spectra, strict=True)])


def _gain(of: Residual, variance: float, s: Array, q: Array) -> float:
    """Gain of a group on one machine at a given variance, nats."""
    ratio = 1.0 + variance * s
    gain = 0.5 * float(np.sum(variance * q[0] ** 2 / ratio - np.log(ratio)))
    fit = fitted(np.array([variance]), s[None], q)
    return float(with_own_noise(np.array([gain]), fit, float(of.freedom))[0])


def _spectrum(of: Residual, group: Group, trials: Array) -> tuple[Array, Array]:
    """s (K,) and q (T, K) of a group on residuals (M + B, T)."""
    left, _ = of.projected(group.effects)
    x = left * np.linalg.norm(of.columns(group.effects), axis=0) * np.array(group.spreads) / of.sigma
    s, turn = np.linalg.eigh(x.T @ x)
    return np.maximum(s, 0.0), (trials.T / of.sigma) @ x @ turn


def _null(machines: Sequence[Residual], groups: Sequence[Group], rng: np.random.Generator, count: int) -> Array:
    """Largest pooled net gain (T,) of any group on residuals permuted within each machine."""
    trials, most = [of.shuffled(rng, count) for of in machines], np.full(count, -np.inf)
    for group in groups:
        spectra = [_spectrum(of, group, t) for of, t in zip(machines, trials, strict=True)]
        s, q = (np.concatenate(parts, axis=-1) for parts in zip(*spectra, strict=True))
        gains, _ = best(np.tile(s, (count, 1)), q, np.full(count, group.cap))
        most = np.maximum(most, gains - group.cost)
    return most


def _weeded(chosen: dict[str, Candidate], residuals: Residuals, criteria: Criteria) -> dict[str, Candidate]:
    """The candidates that pass given all others, the weakest deleted first."""
    while len(chosen) > 1:
        full = residuals(tuple(chosen.values()))
        nats = dict[str, float]()
        for name, candidate in chosen.items():
            without = [of.without(candidate.effects) for of in full]
            group = _common(candidate, without)
            score = pooled(without, group) if group is not None else Pooled(-np.inf, False)
            passes = group is not None and score.typical and _passes(without, group, score.nats, criteria)
            nats[name] = np.inf if passes else score.nats
        weakest = min(nats, key=nats.__getitem__)
        if nats[weakest] == np.inf:
            return chosen
        chosen = {name: c for name, c in chosen.items() if name != weakest}
    return chosen


def _passes(machines: Sequence[Residual], group: Group, nats: float, criteria: Criteria) -> bool:
    """Return whether net gain and cross-validated gain over all machines, each at its own noise, are large enough."""
    if nats <= criteria.minimum_nats:
        return False
    gains = [
        (cross_validated(of, ()).per_unit - cross_validated(of, group.effects).per_unit) / of.sigma**2
        for of in machines
    ]
    return paired_t(np.concatenate(gains)) > criteria.apart_cv_t


def _common(candidate: Candidate, machines: Sequence[Residual]) -> Group | None:
    """The candidate as one group for all machines, spreads averaged; None where one of them cannot have it."""
    try:
        groups = [group_of(candidate, Shapes(of.poses.states)) for of in machines]
    except InputError:
        return None
    if any(group is None or len(group.effects) < len(candidate.effects) for group in groups):
        return None
    known = [group for group in groups if group is not None]
    spreads = np.mean([group.spreads for group in known], axis=0)
    return replace(known[0], spreads=tuple(spreads.tolist()), cap=min(group.cap for group in known))

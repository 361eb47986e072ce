"""Many machines of one type calibrated together: own numbers, what the type has in common, and both together."""

from collections.abc import Sequence, Set
from dataclasses import dataclass
from functools import partial

import msgspec
import numpy as np

from gpmodel.arrays import Array
from gpmodel.calibration.gauge import LARGEST_LIMIT
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration
from gpmodel.hierarchy import block
from gpmodel.hierarchy.between import Deviations, Shared, between, deleted, deviations
from gpmodel.hierarchy.prior import beyond, learned
from gpmodel.hierarchy.record import NOISE, BlockPart, FleetPart, SharedPart, prior_parts
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses
from gpmodel.model.sites import table_names, translate


@dataclass(frozen=True)
class SharedBlock:
    """Effects with priors of their own that are judged together: spread between machines, low to high its interval, as
    a share of what these priors expect."""

    name: str
    effects: tuple[Effect, ...]
    spread: float
    low: float
    high: float


@dataclass(frozen=True)
class Fleet:
    """Machines calibrated together. alone: each calibrated by itself. own: each by its poses alone, all with the same
    effects. shrunken: with the type's `prior` beside its poses, geometry complete.

    values, stderr: (m, K + 1) of the `effects` without priors of their own and, last, the logarithm of the noise.
    shared: of each of these. blocks: of all other effects. deviations: of each machine in each of both. left_out:
    effects that not every machine's poses can tell.
    """

    alone: tuple[Calibration, ...]
    own: tuple[Calibration, ...]
    shrunken: tuple[Calibration, ...]
    prior: tuple[Effect, ...]
    effects: tuple[Effect, ...]
    values: Array
    stderr: Array
    shared: tuple[Shared, ...]
    blocks: tuple[SharedBlock, ...]
    deviations: Deviations
    left_out: tuple[str, ...]


def calibrate_fleet(
    machines: Sequence[tuple[Mechanism, Poses]], alone: Sequence[Calibration], effects: tuple[Effect, ...]
) -> Fleet:
    """Empirical Bayes over machines with the same effects: each estimated by itself, mean and spread of what they
    share learned from that, then each estimated again with it as its prior.

    effects: of the type. alone: each machine calibrated by itself, with these first and after them those that it alone
    has, which stay in every fit of it. An effect's own prior holds for a machine by itself and
    for the mean of the type. A machine that stands out in an effect, or in a block of effects with priors, keeps its
    own numbers there and teaches nothing of the type, unless fewer than two are left. Source: Efron and Morris (1975).
    Raises InputError where the poses of a machine are too few for the effects.
    """
    held = np.all([fit.kept[: len(effects)] for fit in alone], axis=0)
    common = tuple(effect for effect, k in zip(effects, held, strict=True) if k)
    own = tuple(
        calibrate(
            ErrorModel(mechanism, (*common, *beyond(fit, effects)), fit.sigma), poses, condition_limit=LARGEST_LIMIT
        )
        for (mechanism, poses), fit in zip(machines, alone, strict=True)
    )
    bare = np.array([np.isinf(effect.prior) for effect in common], dtype=bool)
    values = np.array([[*fit.theta[: len(bare)][bare], np.log(fit.sigma)] for fit in own])
    stderr = np.array([[*fit.stderr[: len(bare)][bare], 1.0 / np.sqrt(2.0 * fit.freedom)] for fit in own])
    groups = block.blocks(common)
    information = [block.block_information(own, group) for _, group in groups]
    alike = [partial(deleted, v, e**2) for v, e in zip(values.T, stderr.T, strict=True)]
    found = deviations([*alike, *(partial(block.deleted, of) for of in information)], len(machines))
    shared = tuple(between(v[i], e[i] ** 2) for v, e, i in zip(values.T, stderr.T, found.inside.T, strict=False))
    spread = tuple(
        SharedBlock(name, group, *block.shared(of.subset(inside)))
        for (name, group), of, inside in zip(groups, information, found.inside.T[len(shared) :], strict=True)
    )
    plain = tuple(effect for effect, k in zip(common, bare, strict=True) if k)
    names = [*({e.name} for e in plain), set(), *({e.name for e in of.effects} for of in spread)]
    outlying = [set().union(*(n for n, k in zip(names, i, strict=True) if not k)) for i in found.inside]
    typical = [k for k, outside in enumerate(outlying) if not outside]
    taught = typical if len(typical) > 1 else range(len(machines))
    whole = tuple(effect for effect, k in zip(effects, held, strict=True) if k or effect.constant)
    prior = learned([machines[i] for i in taught], [own[i] for i in taught], whole)
    shrunken = tuple(
        with_prior(fit, poses, prior, outside) for fit, (_, poses), outside in zip(own, machines, outlying, strict=True)
    )
    left_out = tuple(effect.name for effect, k in zip(effects, held, strict=True) if not k)
    return Fleet(tuple(alone), own, shrunken, prior, plain, values, stderr, shared, spread, found, left_out)


def with_prior(own: Calibration, poses: Poses, prior: tuple[Effect, ...], outlying: Set[str]) -> Calibration:
    """Refit a machine with the prior of its type, at the machine's noise level.

    Effects in `outlying` and effects of the machine alone keep their priors.
    """
    untaught = {e.name: e for e in own.model.effects if e.name in outlying}
    effects = (*(untaught.get(e.name, e) for e in prior), *beyond(own, prior))
    return calibrate(ErrorModel(own.model.mechanism, effects, own.sigma), poses, condition_limit=LARGEST_LIMIT)


def shared_parts(final: Fleet) -> tuple[SharedPart, ...]:
    """Every effect without a prior of its own that all machines' poses tell and, last, the noise."""
    noise = Effect(NOISE, (), "1")
    out = []
    for k, (effect, of) in enumerate(zip((*final.effects, noise), final.shared, strict=True)):
        z, chances = final.deviations.z[:, k], final.deviations.chance[:, k]
        outside = np.flatnonzero(np.logical_not(final.deviations.inside[:, k]))
        fits = () if effect.constant else final.shrunken
        at = [[e.name for e in fit.model.effects].index(effect.name) for fit in fits]
        both = [(float(fit.theta[j]), float(fit.stderr[j])) for fit, j in zip(fits, at, strict=True)]
        out.append(
            SharedPart(
                name=effect.name, unit=effect.unit, constant=effect.constant and effect != noise,
                mean=of.mean, stderr=of.stderr, spread=of.spread, low=of.low, high=of.high,
                values=tuple(final.values[:, k].tolist()), stderrs=tuple(final.stderr[:, k].tolist()),
                shrunken=tuple(v for v, _ in both), shrunken_stderrs=tuple(e for _, e in both),
                z=tuple(z.tolist()), chances=tuple(chances.tolist()), outliers=tuple(outside.tolist()),
            )
        )  # fmt: skip
    return tuple(out)


def block_parts(final: Fleet) -> tuple[BlockPart, ...]:
    """Every block of effects with priors of their own."""
    out = []
    for k, one in enumerate(final.blocks, len(final.shared)):
        outside = np.flatnonzero(np.logical_not(final.deviations.inside[:, k]))
        of = (tuple(a.tolist()) for a in (final.deviations.z[:, k], final.deviations.chance[:, k], outside))
        out.append(BlockPart(one.name, prior_parts(one.effects), one.spread, one.low, one.high, *of))
    return tuple(out)


def in_table_names(fleet: FleetPart) -> FleetPart:
    """Return the record with the joint names of the tables, for reading; fleet.json has the mechanism's names."""
    names, renamed = table_names(fleet.joints, fleet.columns), msgspec.structs.replace

    def said(of: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(translate(name, names) for name in of)

    return renamed(
        fleet,
        chosen=translate(fleet.chosen, names),
        left_out=said(fleet.left_out),
        machines=tuple(renamed(m, effects=said(m.effects)) for m in fleet.machines),
        parameters=tuple(renamed(p, name=translate(p.name, names)) for p in fleet.parameters),
        blocks=tuple(renamed(b, name=translate(b.name, names)) for b in fleet.blocks),
    )

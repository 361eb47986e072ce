"""What free joints hide: effects whose columns the approximate joint values explain as well."""

from collections.abc import Iterator, Sequence

import numpy as np

from gpmodel.calibration.linearise import effect_columns
from gpmodel.calibration.result import Calibration, problem_at
from gpmodel.calibration.size import shows_size
from gpmodel.calibration.unmeasured_joints import free_joints
from gpmodel.families import catalogue
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import Poses
from gpmodel.model.inclination import Inclination
from gpmodel.model.observation import Observation
from gpmodel.model.pixel import Pixels


def unobservable_effects(calibration: Calibration, poses: Poses, effects: Sequence[Effect]) -> tuple[bool, ...]:
    """Whether free joints leave nothing of each effect's column at these poses; all False without free joints."""
    if not free_joints(calibration.model.mechanism) or not effects:
        return (False,) * len(effects)
    problem = problem_at(calibration, poses)
    columns = effect_columns(tuple(effects), calibration.model, problem.poses, problem.observed)
    return tuple(not np.any(column) for column in problem.weigh(columns).T)


def unobservable_families(calibration: Calibration, poses: Poses) -> tuple[str, ...]:
    """The model's constant effects, and the catalogue's families, of which free joints leave nothing at all."""
    if not free_joints(calibration.model.mechanism):
        return ()
    pool = catalogue.candidates(calibration.model.mechanism, poses.states)
    hidden = iter(unobservable_effects(calibration, poses, [e for c in pool for e in c.effects]))
    families: dict[str, bool] = {}
    for candidate in pool:
        gone = [next(hidden) for _ in candidate.effects]
        families[candidate.family] = families.get(candidate.family, True) and all(gone)
    constant = [e for e in calibration.model.effects if e.constant]
    of_constant = unobservable_effects(calibration, poses, constant)
    names = [e.name for e, gone in zip(constant, of_constant, strict=True) if gone]
    return (*names, *(name.replace("_", " ") for name, gone in families.items() if gone))


def unseen(kinds: tuple[Observation, ...]) -> Iterator[str]:
    """One sentence each, of the kinds that were read; none where points or poses in an instrument's frame were."""
    read = [kind for kind in kinds if kind.readings.any()]
    if not read or any(kind.absolute for kind in read):
        return
    what = f"what was read ({', '.join(kind.name for kind in read)})"
    if not any(map(shows_size, read)):
        yield (
            f"{what} fits a machine that is larger as a whole as well: its lengths stay, on the whole, as described; a "
            "bar, a ball of known diameter, an artefact or a camera with its board would show it"
        )
    if all(isinstance(kind, Pixels | Inclination) for kind in read):
        yield f"{what} does not show the tool point: it stays at the flange; touches of one point would show it"
    yield (
        f"{what} does not show where the base stands: what is predicted is in the frame of the root; points of a "
        "tracker, three at least, would place it in theirs"
    )

"""Many machines of one type: what they share, how they spread, who stands out, and what a prior of them is worth."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from gpmodel._version import __version__
from gpmodel.api.arguments import called, file_path, listed, share, whole
from gpmodel.api.calibrate import checked_poses, named_group, split
from gpmodel.api.display import notebook
from gpmodel.api.mechanism import MechanismLike, mechanism_of
from gpmodel.api.table import TableLike
from gpmodel.calibration.comparison import Models, climb, growing, step_of
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.errors import InputError
from gpmodel.executor import Threads, Workers
from gpmodel.files import finished_folder, write_text
from gpmodel.hierarchy.fleet import Fleet, calibrate_fleet
from gpmodel.hierarchy.folder import folder_of_tables
from gpmodel.hierarchy.found import Rows, Searched, found_on_most
from gpmodel.hierarchy.kept import KeptMachines, NoMachinesKept
from gpmodel.hierarchy.parts import block_parts, shared_parts
from gpmodel.hierarchy.record import (
    KIND,
    NAME,
    SCHEMA,
    BlockPart,
    FleetPart,
    MachinePart,
    Part,
    check_serial,
    fleet_text,
    prior_parts,
)
from gpmodel.mechanism.identity import tip_at_probe
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses
from gpmodel.model.geometric import geometric_effects
from gpmodel.progress import Say, Teller, silent
from gpmodel.report import fleet as pages
from gpmodel.report.fitted import statistics_mm

COMMAND = "gpmodel.fleet"
Machines = Mapping[str, tuple[Mechanism, Poses]]


@dataclass(frozen=True, repr=False)
class FleetResult:
    """Machines of one type calibrated together. record: the same as fleet.json has it."""

    record: FleetPart

    @property
    def verdict(self) -> str:
        """The answer in one sentence."""
        return pages.verdict(self.record)

    def to_dataframe(self) -> pd.DataFrame:
        """One row a machine and parameter or block, SI: serial, parameter, own value and its stderr, of effects that
        vary the shrunken value and its stderr, mean and spread of the type, z, chance, outlier. Of the noise the values
        are logarithms of metres; a block has none, its spread is a share of what its priors expect."""
        return pd.DataFrame(
            [
                {"serial": machine.serial, "parameter": part.name, **_numbers(part, k), "spread": part.spread,
                 "z": part.z[k], "chance": part.chances[k], "outlier": k in part.outliers}
                for k, machine in enumerate(self.record.machines)
                for part in self.record.parts
            ]
        )  # fmt: skip

    def summary(self) -> str:
        """Verdict, the machines with the worst first, effects and geometry of the type, where they are from."""
        return pages.summary(self.record)

    def report(self, folder: str | Path) -> None:
        """Leave fleet.html, fleet.json and figures in `folder`: all or none."""
        with finished_folder(file_path(folder, "folder")) as draft:
            pages.write_pages(self.record, draft)
            self.save(draft / NAME)

    def save(self, file: str | Path) -> None:
        """Write fleet.json, which `calibrate` takes as the prior of a further machine."""
        write_text(file_path(file, "file"), fleet_text(self.record))

    def __repr__(self) -> str:
        return f"<fleet of {len(self.record.machines)} {self.record.mechanism}: {self.verdict}>"

    def _repr_html_(self) -> str:
        return notebook(self.summary(), self.to_dataframe())


def _numbers(part: Part, machine: int) -> dict[str, str | float]:
    """What a parameter is at a machine and of the type; of a block, which is no number, that it is none."""
    if isinstance(part, BlockPart):
        return {"unit": "1"} | dict.fromkeys(("value", "stderr", "shrunken", "shrunken_stderr", "mean"), np.nan)
    both = (part.shrunken[machine], part.shrunken_stderrs[machine]) if part.shrunken else (np.nan, np.nan)
    return {
        "unit": part.unit, "value": part.values[machine], "stderr": part.stderrs[machine],
        "shrunken": both[0], "shrunken_stderr": both[1], "mean": part.mean,
    }  # fmt: skip


def fleet(
    mechanism: MechanismLike | None,
    tables: str | Path | Mapping[str, TableLike],
    effects: Sequence[str | Effect] | None = None,
    *,
    holdout: float = 0.3,
    seed: int = 0,
    workers: int = 0,
    executor: Workers | None = None,
    journal: KeptMachines | None = None,
    progress: Say = silent,
    command: str = COMMAND,
) -> FleetResult:
    """Calibrate machines of one type together: mean of every parameter and its spread between machines, each machine
    by itself and with the type's prior, and which of them stands out in what.

    mechanism: of all of them; None where fleet.toml in the folder says it. tables: a folder with a table for each, or
    tables by serial. effects: as of `calibrate`; () for the geometry alone; None for those that `discover` with the
    catalogue alone finds on more than half of the machines. holdout: share of each machine's poses by which its errors
    are judged, 0 for none; the numbers of the type are of all poses. By itself a machine is what `calibrate` makes of
    its table; effects that come with priors, as a curve's harmonics, are judged between machines as one. workers:
    machines searched side by side, 0 for one a core; executor: searches elsewhere; no number depends on either.
    journal: keeps what was found on each machine, to go on from it to the same numbers.
    Raises InputError: fewer than two machines, two of one serial or table, a table that is not sound, an unknown
    effect, a fit that diverges.
    """
    fraction, seed = share(holdout, "holdout"), whole(seed, "seed")
    given = None if effects is None else listed(effects, "effects", "['base_compliance']")
    called(progress, "progress")
    say = Teller(progress)
    machines = _machines(mechanism, tables)
    arms = list(machines.values())
    rows = [split(poses.dataset, fraction, seed) for _, poses in arms]
    side_by_side, kept = executor or Threads(whole(workers, "workers")), journal or NoMachinesKept()
    tasks = [Searched(arm, poses, of, seed) for (arm, poses), of in zip(arms, rows, strict=True)]
    named, chosen = _effects(given, tasks, side_by_side, kept, say)
    models = growing(geometric_effects(arms[0][0]), named)
    say("every machine by its own poses, then with what it shares with the others")
    final = calibrate_fleet(arms, [calibrate(ErrorModel(arm, models[-1][1]), poses, seed=seed) for arm, poses in arms])
    judged = final if fraction == 0.0 else _judged(arms, rows, models, seed)
    for serial, *fits in zip(machines, final.alone, final.own, final.shrunken, strict=True):
        if diverged := [fit.reason for fit in fits if fit.status == "diverged"]:
            raise InputError(f"{serial}: the fit diverged: {diverged[0]}")
    arm = arms[0][0]
    x, y, z = tip_at_probe(arm).tolist()
    return FleetResult(
        FleetPart(
            KIND, SCHEMA, __version__, command, seed, arm.name, (x, y, z), tuple(j.name for j in arm.joints), chosen,
            final.left_out, _machine_parts(machines, rows, judged, final), shared_parts(final), block_parts(final),
            prior_parts(final.prior),
        )
    )  # fmt: skip


def _judged(machines: Sequence[tuple[Mechanism, Poses]], rows: Sequence[Rows], models: Models, seed: int) -> Fleet:
    """The fleet of the training poses, each machine by itself as `calibrate` climbs to it."""
    seen = [(arm, poses.subset(train)) for (arm, poses), (train, _) in zip(machines, rows, strict=True)]
    alone = [climb(arm, models, poses, poses, seed=seed)[-1].calibration for arm, poses in seen]
    return calibrate_fleet(seen, alone)


def _machines(mechanism: MechanismLike | None, tables: str | Path | Mapping[str, TableLike]) -> Machines:
    """The machines by serial, their tables judged. Raises InputError as `fleet`."""
    if not isinstance(tables, Mapping):
        folder = folder_of_tables(file_path(tables, "tables"))
        tables, mechanism = folder.tables, folder.said_mechanism if mechanism is None else mechanism
    arm = mechanism_of(mechanism)
    out: dict[str, tuple[Mechanism, Poses]] = {}
    seen: dict[tuple[str, bytes], str] = {}
    for serial, table in tables.items():
        check_serial(serial)
        try:
            out[serial] = checked_poses(arm, table)
        except InputError as error:
            known = error.said if Path(str(table)).name in error.said else f"{serial}: {error.said}"
            raise InputError(known, error.argument) from None
        dataset = out[serial][1].dataset
        rows = dataset.sha256, dataset.row.tobytes()
        if dataset.sha256 and rows in seen:
            raise InputError(f"machines '{seen[rows]}' and '{serial}' have the same table; expected one for each")
        seen[rows] = serial
    if len(out) < 2:
        raise InputError(f"{len(out)} machine; expected at least 2 of one type", "tables")
    return out


def _effects(
    given: tuple[object, ...] | None, tasks: Sequence[Searched], workers: Workers, kept: KeptMachines, say: Teller
) -> tuple[Models, str]:
    """Groups of effects beside the geometry, and in words where they are from."""
    if given is None and not all(len(task.rows[1]) for task in tasks):
        raise InputError("0 leaves no poses that confirm what is found; expected more, or effects by name", "holdout")
    if given is not None:
        groups = [named_group(effect, tasks[0].mechanism, tasks[0].poses) for effect in given]
        return groups, f"named: {', '.join(n for n, _ in groups) or 'none'}"
    effects, chosen = found_on_most(tasks, workers, kept, say)
    return [("found", effects)], chosen


def _machine_parts(machines: Machines, rows: Sequence[Rows], judged: Fleet, final: Fleet) -> tuple[MachinePart, ...]:
    """The machines, their noise with all poses and their errors on those held out."""
    out = []
    for k, (serial, (_, poses)) in enumerate(machines.items()):
        train, held = (poses.subset(part) for part in rows[k])
        own, both = (step_of("", fit[k], train, held).heldout_error for fit in (judged.alone, judged.shrunken))
        out.append(
            MachinePart(
                serial=serial, file=poses.dataset.source, sha256=poses.dataset.sha256, poses=len(poses),
                train=len(train), sigma_mm=1e3 * final.own[k].sigma, own_mm=statistics_mm(own).rms_mm,
                fleet_mm=statistics_mm(both).rms_mm,
            )
        )  # fmt: skip
    return tuple(out)

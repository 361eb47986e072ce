"""Calibrate several machines of one type: mean parameters, spread, outlying machines, prior for further machines."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np
import pandas as pd

from gpmodel._version import __version__
from gpmodel.api.arguments import (
    MechanismLike,
    check_function,
    check_integer,
    check_list,
    check_share,
    file_path,
    mechanism_of,
)
from gpmodel.api.calibrate import CalibrationResult, distinct_poses, named_group, split
from gpmodel.api.results import save_model, write_results
from gpmodel.api.table import Shown, TableLike
from gpmodel.application.true_loads import machine_under_true_loads
from gpmodel.calibration.comparison import Models, Step, fit_steps, nested_models, with_fit
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.errors import InputError
from gpmodel.executor import Forks, Workers
from gpmodel.families.candidate import without_phase
from gpmodel.files import finished_folder, write_text
from gpmodel.hierarchy.fleet import Fleet, calibrate_fleet, in_table_names, shared_parts
from gpmodel.hierarchy.found import FindingsFile, FleetSearch, MachineSearch, Rows, found_on_type
from gpmodel.hierarchy.further import PRIOR
from gpmodel.hierarchy.record import (
    KIND,
    MACHINES,
    NAME,
    SCHEMA,
    BlockPart,
    FleetPart,
    MachinePart,
    Part,
    check_serial,
    fleet_text,
    folder_names,
    folder_of_tables,
    prior_parts,
)
from gpmodel.mechanism.branches import tip_at_trial
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses
from gpmodel.model.sites import geometric_effects
from gpmodel.progress import Reporter, Say, silent
from gpmodel.report import fleet as pages
from gpmodel.report.build import Ladder
from gpmodel.report.origin import Origin

Machines = Mapping[str, tuple[Mechanism, Poses]]


def machines_of(mechanism: MechanismLike | None, tables: str | Path | Mapping[str, TableLike]) -> Machines:
    """Return the mechanism and the checked table of each machine, by serial number.

    Raises InputError for fewer than two machines, a repeated serial number or table, or an invalid table.
    """
    if not isinstance(tables, Mapping):
        folder = folder_of_tables(file_path(tables, "tables"))
        tables, mechanism = folder.tables, folder.said_mechanism if mechanism is None else mechanism
    arm = mechanism_of(mechanism)
    out: dict[str, tuple[Mechanism, Poses]] = {}
    seen: dict[tuple[str, bytes], str] = {}
    for serial, table in tables.items():
        check_serial(serial)
        try:
            out[serial] = distinct_poses(arm, table)
        except InputError as error:
            known = error.said if Path(str(table)).name in error.said else f"{serial}: {error.said}"
            raise InputError(known, error.argument) from None
        dataset = out[serial][1].dataset
        rows = dataset.sha256, dataset.row.tobytes()
        if dataset.sha256 and rows in seen:
            raise InputError(
                f"machines '{seen[rows]}' and '{serial}' have the same table; expected a different "
                "table for each machine"
            )
        seen[rows] = serial
    if len(out) < 2:
        raise InputError(f"{len(out)} machine; expected at least 2 of one type", "tables")
    return out


COMMAND = "gpmodel.fleet"
OWN = "its own effects"
"""Name of the model that adds the effects of a single machine."""


@dataclass(frozen=True, repr=False)
class FleetResult(Shown):
    """Joint calibration of machines of one type. record: content of fleet.json.

    machines: calibration of each machine by serial number, with the effects of the machine and the prior of the type.
    """

    record: FleetPart
    machines: Mapping[str, CalibrationResult]

    @cached_property
    def shown(self) -> FleetPart:
        """The content of fleet.json, with the joint names of the machines' tables."""
        return in_table_names(self.record)

    @property
    def verdict(self) -> str:
        """Verdict on several machines of one type in one sentence."""
        return pages.verdict(self.shown)

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row per machine and parameter or block of effects, SI units.

        Columns: serial, parameter, unit, value, stderr, shrunken value and stderr (of effects that vary between
        machines), mean and spread of the type, z (deviation from other machines), chance, outlier. The parameter for
        noise is the logarithm of metres. A block of effects has no values, and a spread relative to that of the prior.
        """
        return pd.DataFrame(
            [
                {"serial": machine.serial, "parameter": part.name, **_numbers(part, k), "spread": part.spread,
                 "z": part.z[k], "chance": part.chances[k], "outlier": k in part.outliers}
                for k, machine in enumerate(self.shown.machines)
                for part in self.shown.parts
            ]
        )  # fmt: skip

    def summary(self) -> str:
        """Return text on all machines: verdict, machines (the most outlying first), effects of the type, geometry."""
        return pages.summary(self.shown)

    def report(self, folder: str | Path) -> None:
        """Write fleet.html, fleet.json, figures, and the page and model.json of each machine into `folder`; all files
        or none."""
        with finished_folder(file_path(folder, "folder")) as draft:
            pages.write_pages(self.shown, draft)
            self.save(draft / NAME)
            for part in self.record.machines:
                found, own = self.machines[part.serial], draft / MACHINES / part.folder
                write_results(found.record, own, partial(save_model, found.model))

    def save(self, file: str | Path) -> None:
        """Write fleet.json, which `calibrate` accepts as the prior of a further machine."""
        write_text(file_path(file, "file"), fleet_text(self.record))

    def __repr__(self) -> str:
        return f"<fleet of {len(self.record.machines)} {self.record.mechanism}: {self.verdict}>"


def _numbers(part: Part, machine: int) -> dict[str, str | float]:
    """Return a parameter of one machine and of the type as cells of a row; NaN for a block of effects."""
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
    journal: FindingsFile | None = None,
    progress: Say = silent,
    command: str = COMMAND,
) -> FleetResult:
    """Calibrate machines of one type together: mean of each parameter, spread between machines, outlying machines.

    Every machine of the fleet is also calibrated alone and with the prior of the type.
    mechanism: mechanism of all machines; None if fleet.toml in the folder names the mechanism.
    tables: a folder with one table per machine, or tables by serial number.
    effects: as in `calibrate`; () for the geometry alone; None to select effects of the type, then of single machines.
    holdout: held-out share of the poses of each machine; 0 for none. seed: random seed of held-out poses.
    workers: number of processes, 0 for one per core. executor: runs the searches. Results do not depend on workers.
    journal: file for the findings of each machine, so that an interrupted call can continue.
    progress: function called with progress messages. command: command line, recorded in fleet.json.
    A single machine is calibrated as by `calibrate`. Effects with priors, such as the harmonics of a smooth term, are
    compared between machines as one block.
    Raises InputError for fewer than two machines, a repeated serial number or table, an invalid table, an unknown
    effect, or a diverging fit.
    """
    fraction, seed = check_share(holdout, "holdout"), check_integer(seed, "seed")
    given = None if effects is None else check_list(effects, "effects", "['base_compliance']")
    check_function(progress, "progress")
    say = Reporter(progress)
    machines = machines_of(mechanism, tables)
    under = [machine_under_true_loads(arm, poses, seed) for arm, poses in machines.values()]
    arms = [(arm, poses) for arm, poses, _ in under]
    rows = [split(poses.dataset, fraction, seed) for _, poses in arms]
    side_by_side = Forks(check_integer(workers, "workers")) if executor is None else executor
    kept = FindingsFile() if journal is None else journal
    tasks = [MachineSearch(arm, poses, of, seed) for (arm, poses), of in zip(arms, rows, strict=True)]
    named, own, chosen = _effects(given, FleetSearch(list(machines), tasks, side_by_side, kept, say))
    geometry = geometric_effects(arms[0][0])
    models = [nested_models(geometry, (*named, *((OWN, extra) for extra in [of] if extra))) for of in own]
    say("every machine by its own poses, then with what it shares with the others")
    alone = [
        calibrate(ErrorModel(arm, of[-1][1]), poses, seed=seed) for (arm, poses), of in zip(arms, models, strict=True)
    ]
    effects = nested_models(geometry, named)[-1][1]
    final = calibrate_fleet(arms, alone, effects)
    steps = _judged(arms, rows, models, effects, seed)
    for serial, *fits in zip(machines, final.individual, final.type_effects, final.shrunk, strict=True):
        if diverged := [fit.reason for fit in fits if fit.status == "diverged"]:
            raise InputError(f"{serial}: the fit diverged: {diverged[0]}")
    found = {
        serial: CalibrationResult(
            Ladder(poses, train, of, fit, tuple(e for e in fit.model.effects if not e.constant)), Origin(command, seed)
        )
        for serial, (_, poses), (train, _), of, fit in zip(machines, arms, rows, steps, final.shrunk, strict=True)
    }
    parts = _machine_parts(found, own, [loads for *_, loads in under])
    return FleetResult(_part(arms, final, parts, Origin(command, seed), chosen), found)


def _part(
    arms: Sequence[tuple[Mechanism, Poses]], final: Fleet, parts: tuple[MachinePart, ...], origin: Origin, chosen: str
) -> FleetPart:
    """Return the record of fleet.json, with the joint names of the tables if all tables use equal names."""
    arm, called_so = arms[0][0], {poses.dataset.columns for _, poses in arms}
    joints = tuple(j.name for j in arm.joints)
    x, y, z = tip_at_trial(arm).tolist()
    columns = called_so.pop() if len(called_so) == 1 else joints
    return FleetPart(
        KIND, SCHEMA, __version__, origin.command, origin.seed, arm.name, (x, y, z), joints, columns or joints, chosen,
        final.undetermined, parts, shared_parts(final), final.blocks, prior_parts(final.prior),
    )  # fmt: skip


def _judged(
    machines: Sequence[tuple[Mechanism, Poses]], rows: Sequence[Rows], models: Sequence[Models],
    effects: tuple[Effect, ...], seed: int,
) -> list[tuple[Step, ...]]:  # fmt: skip
    """Return the fits of every machine to its training poses: alone, then with the prior of the type."""
    seen = [(arm, poses.subset(train)) for (arm, poses), (train, _) in zip(machines, rows, strict=True)]
    held = [poses.subset(out) for (_, poses), (_, out) in zip(machines, rows, strict=True)]
    steps = [
        fit_steps(arm, of, poses, unseen, seed=seed)
        for (arm, poses), unseen, of in zip(seen, held, models, strict=True)
    ]
    together = calibrate_fleet(seen, [of[-1].calibration for of in steps], effects)
    return [
        with_fit(of, PRIOR, fit, poses, unseen)
        for of, fit, (_, poses), unseen in zip(steps, together.shrunk, seen, held, strict=True)
    ]


def _effects(given: tuple[object, ...] | None, search: FleetSearch) -> tuple[Models, Sequence[tuple[Effect, ...]], str]:
    """Return the common groups of effects, further effects of each machine, and a sentence on the effects' origin."""
    tasks = search.tasks
    if given is None and not all(len(task.rows[1]) for task in tasks):
        raise InputError(
            "0 leaves no poses to confirm the findings; expected a share above 0, or effects by name", "holdout"
        )
    if given is not None:
        groups = [named_group(effect, tasks[0].mechanism, tasks[0].poses) for effect in given]
        return groups, [()] * len(tasks), f"named: {', '.join(n for n, _ in groups) or 'none'}"
    effects, own, chosen = found_on_type(search)
    return [("found", effects)], own, chosen


def _machine_parts(
    found: Mapping[str, CalibrationResult], own: Sequence[tuple[Effect, ...]], under: Sequence[str]
) -> tuple[MachinePart, ...]:
    """Return the records of the machines: noise of the fit to all poses, and errors on held-out poses.

    own: further effects of each machine. under: fitted loads of each machine that differ from the declared loads.
    """
    out, folders = [], folder_names(list(found))
    for name, (serial, machine), extra, loads in zip(folders, found.items(), own, under, strict=True):
        ladder, data = machine.calibrated, machine.calibrated.poses.dataset
        errors = {step.step: step.heldout.rms_mm for step in ladder.records()}
        out.append(
            MachinePart(
                serial=serial, folder=name, effects=tuple(dict.fromkeys(without_phase(e.name) for e in extra)),
                file=data.source, sha256=data.sha256, poses=len(data), train=len(ladder.train),
                sigma_mm=1e3 * ladder.final.sigma, standard_mm=errors["standard"],
                own_mm=errors[ladder.steps[-2].name], fleet_mm=errors[PRIOR], loads=loads,
            )
        )  # fmt: skip
    return tuple(out)

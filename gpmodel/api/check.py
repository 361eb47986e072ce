"""Check a measured table before calibration."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from gpmodel.api.arguments import MechanismLike, check_function, check_texts, file_path, mechanism_of
from gpmodel.api.table import Shown, TableLike, announce_reading, read_table, specified
from gpmodel.arrays import Array
from gpmodel.checks.judge import Remark, check_dataset
from gpmodel.errors import InputError
from gpmodel.families.catalogue import catalogue, instances
from gpmodel.files import finished_folder, to_json, write_text
from gpmodel.mechanism.branches import random_poses
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.error_model import prepare
from gpmodel.model.sites import standard_effects
from gpmodel.numerics.se3 import chain
from gpmodel.progress import Reporter, Say, silent
from gpmodel.table.blocks import different_poses
from gpmodel.table.dataset import Dataset, unmeasured
from gpmodel.wording import counted, wrapped

POSES = 40
"""Number of random poses for which catalogue families create candidates; at 40, all candidates of a family appear."""

INSTRUMENT_AT = (1.0, 3.5, -0.5)
"""Assumed position of the robot's root in the instrument's frame, m: a typical set-up of a laser tracker."""


def effects(mechanism: Mechanism) -> pd.DataFrame:
    """List the families of the effect catalogue for a mechanism, one row per family.

    Columns: family, explanation, source, number of candidates, inputs and name of the first candidate, and whether any
    candidate needs a payload. Candidates are created for random poses within the joint limits, with an instrument, a
    varying payload, temperature, time, direction of approach of the first joint, and ordered rows.
    """
    rng = np.random.default_rng(0)
    time: Array = np.arange(0.0, 60.0 * POSES, 60.0)
    warming: Array = 20.0 + time / 600.0
    q = random_poses(mechanism, POSES, rng)
    approach = [f"approach_{joint.name}" for joint in mechanism.joints[:1]]
    dataset = replace(
        unmeasured([joint.name for joint in mechanism.joints], q, rng.uniform(0.0, 10.0, POSES)),
        extras={"temperature": warming, "time": time, **{name: rng.choice([-1.0, 1.0], POSES) for name in approach}},
        extra_units={"temperature": "degC", "time": "s", **dict.fromkeys(approach, "1")},
        in_order=True,
    )
    read = chain(mechanism.transforms(q))[-1][:, :3, 3] + INSTRUMENT_AT
    states = prepare(mechanism, replace(dataset, position=read)).states
    bare = prepare(mechanism, replace(dataset, position=read, payload=np.zeros(POSES))).states
    rows = []
    for family in catalogue:
        found = tuple(instances(family, mechanism, states))
        reads = dict.fromkeys(name for effect in found[0].effects for name in effect.inputs) if found else {}
        rows.append(
            {
                "family": family.name,
                "explanation": family.explanation,
                "source": family.source,
                "instances": len(found),
                "inputs": ", ".join(reads),
                "example": found[0].name if found else "",
                "payload": bool(found) and next(iter(instances(family, mechanism, bare)), None) is None,
            }
        )
    return pd.DataFrame(rows)


@dataclass(frozen=True, repr=False)
class CheckResult(Shown):
    """Errors and warnings about a table. findings: errors, then warnings, each with `severity` and `text`."""

    _with_rows = False
    mechanism: str
    dataset: Dataset
    findings: tuple[Remark, ...]
    command: str

    @property
    def valid(self) -> bool:
        """True if the measured table has no error."""
        return not any(f.severity == "error" for f in self.findings)

    @property
    def unfit(self) -> tuple[str, ...]:
        """Reasons why a calibration with the table would be wrong; empty if the table is fit for calibration."""
        return tuple(dict.fromkeys(f.unfit for f in self.findings if f.unfit))

    def refuse(self) -> None:
        """Raise InputError with the first error of the table; do nothing if the table has no error."""
        errors = [f.text for f in self.findings if f.severity == "error"]
        if errors:
            raise InputError(errors[0] + (f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""))

    def summary(self) -> str:
        """Return one line per error or warning, then the verdict on the table."""
        data = self.dataset
        warned = sum(f.severity == "warning" for f in self.findings)
        verdict = "fit to calibrate with" if self.valid else "no model should be fitted to this table"
        if self.unfit:
            verdict = f"not fit to calibrate with: {'; '.join(self.unfit)}"
        return "\n".join(
            [
                f"{data.source}: {counted(different_poses(data), len(data), self.mechanism)}",
                *(wrapped(f.text, 11, f"  {f.severity:8} ") for f in self.findings),
                f"{verdict}; {warned or 'no'} warning{'' if warned == 1 else 's'}",
            ]
        )

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row per error or warning: severity, text."""
        return pd.DataFrame({"severity": [f.severity for f in self.findings], "text": [f.text for f in self.findings]})

    def to_json(self) -> str:
        """Return the content of check.json, the file with errors and warnings about a table."""
        data = self.dataset
        return to_json(
            {
                "schema": 1,
                "command": self.command,
                "data": {"file": data.source, "sha256": data.sha256, "poses": len(data)},
                "findings": self.to_dataframe().to_dict("records"),
            }
        )

    def save(self, file: str | Path) -> None:
        """Write check.json, the errors and warnings about a table. Raises InputError if writing fails."""
        write_text(file_path(file, "file"), self.to_json())

    def report(self, folder: str | Path) -> None:
        """Write the errors and warnings as check.json into `folder`. Raises InputError if writing fails."""
        with finished_folder(file_path(folder, "folder")) as draft:
            write_text(draft / "check.json", self.to_json())

    def __repr__(self) -> str:
        return f"<check of {self.dataset.source}: {'valid' if self.valid else 'not valid'}, {len(self.findings)} said>"


def check(
    mechanism: MechanismLike,
    table: TableLike,
    *,
    standard: Sequence[str] = ("*",),
    instrument: str | None = None,
    progress: Say = silent,
    command: str = "gpmodel.check",
) -> CheckResult:
    """Check a table: wrong units or columns, unreachable poses, too few or similar poses, jumps, outliers.

    mechanism, table: objects, or names and paths.
    standard: patterns of the geometric constants to be fitted later, such as "J* R?"; ("none",) for none.
    instrument: specification of the instrument, "15um + 6um/m": largest error of a coordinate.
    progress: function called with progress messages.
    command: command line, recorded in check.json.
    Raises InputError if the table cannot be read.
    """
    arm = mechanism_of(mechanism)
    check_function(progress, "progress")
    announce_reading(table, progress)
    dataset = specified(read_table(table, arm), instrument)
    geometry = standard_effects(arm, check_texts(standard, "standard", "('J* R?',)"))
    findings = check_dataset(arm, dataset, geometry, Reporter(progress))
    return CheckResult(arm.name, dataset, tuple(findings), command)

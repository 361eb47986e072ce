"""Measure fleets of twenty and of five machines: further machines, machines of another type, effects of the type.

From the root of the repository: python -m experiments.fleet.twenty --twenties 5 --fives 20 --first 9100 --out FILE
A fleet of twenty is given its effects by name; further machines with 10 poses use its prior. The effects of a fleet of
five are searched. Arms, kinds and sizes of two effects are drawn for every type. A repeated command continues.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

import gpmodel as gp
from experiments.blind.arms import ARMS as NOMINAL
from experiments.blind.case import Case, effect
from experiments.blind.generate import standing
from experiments.blind.machine import stand
from experiments.coverage.causes import ARMS, KINDS
from experiments.coverage.truth import mechanism_of
from experiments.fleet.machines import COMMON, OWN, SPREAD, Built, table
from experiments.fleet.run import wrong
from experiments.options import parsed
from experiments.tables import run_jobs
from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import Mechanism

Row = dict[str, Any]
POSES, FEW, MANY, FURTHER = 45, 10, 400, 4
NOISE_MM = 0.03


def type_of(number: int) -> tuple[Case, list[str]]:
    """A case with two effects of different kinds, and the catalogue's names of the effects."""
    rng = np.random.default_rng([number, 91])
    effects, names = [], []
    for kind in rng.choice(list(KINDS), 2, replace=False).tolist():
        settings, name, joints = KINDS[kind]
        joint = int(rng.choice(joints))
        effects.append(effect(kind, float(rng.uniform(0.08, 0.3)), **settings(joint)))
        names.append(name.format(joint))
    arm = str(rng.choice(ARMS))
    return Case(f"fleet of {arm}: {', '.join(names)}", arm, POSES, NOISE_MM, effects=tuple(effects)), names


def machines_of(case: Case, number: int, stranger: bool = False) -> Iterator[Built]:
    """One machine of the type after the other. stranger: machines of another type of the same arm and effects, whose
    common errors are others."""
    first, amounts, rng = standing(case, number)
    common = COMMON * np.random.default_rng([number, int(stranger)]).normal(size=first.errors.shape)
    rng = np.random.default_rng([number, 2 + int(stranger)])
    while True:
        errors = common + OWN * rng.normal(size=common.shape)
        soft = 1.0 + SPREAD * rng.normal(size=len(amounts))
        machine = replace(stand(case, NOMINAL[case.arm], rng), errors=errors, shapes=first.shapes)
        yield Built(machine, [float(a * f) for a, f in zip(amounts, soft, strict=True)])


def described(case: Case, number: int) -> Mechanism:
    """The description of the type that a user has."""
    with tempfile.TemporaryDirectory() as folder:
        return mechanism_of(standing(case, number)[0], folder)


def five(number: int) -> Row:
    """Search five machines of a type: effects found, and effects announced that are not there."""
    case, names = type_of(number)
    rng = np.random.default_rng([number, 4])
    sheets = [machine.sheet(POSES, rng) for machine, _ in zip(machines_of(case, number), range(5), strict=False)]
    tables = {f"m{k}": table(sheet, sheet.measured) for k, sheet in enumerate(sheets)}
    record = gp.fleet(described(case, number), tables, workers=1).record
    said = record.chosen
    missed = [name for name in names if name not in said]
    own = [[machine.serial, *machine.effects] for machine in record.machines if machine.effects]
    return {
        "five": number, "case": case.name, "sizes": [round(size, 3) for *_, size in case.effects], "chosen": said,
        "missed": missed, "own": own,
        "outliers": [[record.machines[k].serial, part.name] for k, part in record.outliers()],
    }  # fmt: skip


def twenty(number: int) -> Row:
    """Calibrate twenty machines; then further machines of the type and of another type with few poses."""
    case, names = type_of(number)
    arm, rng = described(case, number), np.random.default_rng([number, 5])
    every = machines_of(case, number)
    sheets = [next(every).sheet(POSES, rng) for _ in range(20)]
    tables = {f"m{k}": table(sheet, sheet.measured) for k, sheet in enumerate(sheets)}
    like = gp.fleet(arm, tables, names, holdout=0.0).record
    chosen = gp.choose_poses(arm, FEW, like=like, collisions=False).q
    brothers = [_further(arm, next(every), names, like, chosen, rng) for _ in range(FURTHER)]
    others = machines_of(case, number, stranger=True)
    strangers = [_noticed(arm, next(others), like, rng) for _ in range(FURTHER)]
    return {
        "twenty": number, "case": case.name, "brothers": brothers, "strangers": strangers,
        "outliers": [[like.machines[k].serial, part.name] for k, part in like.outliers()],
    }  # fmt: skip


def _further(arm: Mechanism, machine: Built, names: list[str], like: Any, chosen: Array, rng: Generator) -> Row:
    """Return errors of a further machine with few poses (random, or proposed for the type) and the prior, and with many
    poses alone, mm. chosen: joint values of the proposed poses, rad."""
    sheet, proposed = machine.sheet(MANY, rng), machine.sheet_at(chosen, rng)
    measured = table(sheet, sheet.measured)
    few = gp.calibrate(arm, measured[:FEW], holdout=0.0, fleet=like)
    best = gp.calibrate(arm, table(proposed, proposed.measured), holdout=0.0, fleet=like)
    alone = gp.calibrate(arm, measured, names, holdout=0.0)
    errors = [round(wrong(fit.model, machine, np.random.default_rng(0)), 4) for fit in (few, best, alone)]
    unlike = any("unlike the machines" in fit.verdict for fit in (few, best))
    return {"few": errors[0], "proposed": errors[1], "many": errors[2], "unlike": unlike}


def _noticed(arm: Mechanism, machine: Built, like: Any, rng: np.random.Generator) -> dict[str, bool]:
    """Return whether a machine of another type is noticed, by the number of poses."""
    sheet = machine.sheet(POSES, rng)
    measured, out = table(sheet, sheet.measured), {}
    for count in (FEW, 20, POSES):
        try:
            said = gp.calibrate(arm, measured[:count], holdout=0.0, fleet=like).verdict
        except InputError as error:
            said = str(error)
        out[str(count)] = "unlike" in said
    return out


def summarised(rows: list[Row]) -> Row:
    """Shares and counts over all fleets."""
    out: Row = {}
    if fives := [row for row in rows if "five" in row]:
        missed = sum(len(row["missed"]) for row in fives)
        out["fives"] = {"fleets": len(fives), "effects found": 2 * len(fives) - missed, "of": 2 * len(fives),
                        "machines with own effects": sum(len(row["own"]) for row in fives)}  # fmt: skip
    if twenties := [row for row in rows if "twenty" in row]:
        brothers = [one for row in twenties for one in row["brothers"]]
        noise = np.sqrt(3.0) * NOISE_MM
        few, best, many = (np.array([one[key] for one in brothers]) for key in ("few", "proposed", "many"))
        strangers = [one for row in twenties for one in row["strangers"]]
        out["twenties"] = {
            "fleets": len(twenties), "brothers": len(brothers), "few mm": float(np.mean(few)),
            "proposed mm": float(np.mean(best)),
            "many mm": float(np.mean(many)), "ratio against exact": float(np.median(few / many)),
            "ratio against measured": float(np.median(np.hypot(few, noise) / np.hypot(many, noise))),
            "ratio of proposed poses": float(np.median(np.hypot(best, noise) / np.hypot(many, noise))),
            "brothers called unlike": sum(one["unlike"] for one in brothers), "strangers": len(strangers),
            "noticed": {n: sum(one[n] for one in strangers) for n in strangers[0]},
        }  # fmt: skip
    return out


def main() -> None:
    chosen = parsed(__doc__, twenties=5, fives=20, first=9100, seconds=np.inf, out=Path)
    jobs = [("twenty", chosen.first + k, twenty) for k in range(chosen.twenties)]
    jobs += [("five", chosen.first + k, five) for k in range(chosen.fives)]
    run_jobs(chosen.out, "fleets", jobs, chosen.seconds, summarised)


if __name__ == "__main__":
    main()

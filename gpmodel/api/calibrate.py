"""Registration, the standard model and the effects named, before and after."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from gpmodel._version import __version__
from gpmodel.api.arguments import limit, share, whole
from gpmodel.api.display import aligned, notebook
from gpmodel.api.model import Model
from gpmodel.api.table import TableLike, read_table
from gpmodel.application.model_file import model_text, saved_model
from gpmodel.arrays import IntArray
from gpmodel.calibration.comparison import Rung, climb
from gpmodel.calibration.gauss_newton import Calibration as Fit
from gpmodel.calibration.gauss_newton import calibrate as fit_model
from gpmodel.calibration.payload import hang_payload
from gpmodel.checks.judge import refuse
from gpmodel.errors import InputError
from gpmodel.families.by_name import effects_named
from gpmodel.files import finished_folder, to_json, write_text
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import Poses, prepare
from gpmodel.model.geometric import standard_effects
from gpmodel.table.bundles import noise_floor
from gpmodel.table.dataset import Dataset
from gpmodel.table.split import hold_out
from gpmodel.wording import measured

Groups = list[tuple[str, tuple[Effect, ...]]]


@dataclass(frozen=True, repr=False)
class Calibration:
    """Fitted models side by side, and the last of them on all poses.

    rungs: registration, the standard model, then one effect after the other, fitted to the training poses alone.
    fit: the last, on all poses. named: names of the effects that were asked for.
    """

    dataset: Dataset
    rungs: tuple[Rung, ...]
    fit: Fit
    named: frozenset[str]
    seed: int
    seconds: float

    @property
    def model(self) -> Model:
        """What predicts, compensates and is saved."""
        return Model(saved_model(self.fit, self.dataset))

    @property
    def verdict(self) -> str:
        """One sentence: from registration to the last step."""
        held = np.isfinite(self.rungs[0].heldout.rms)
        first, last = ((r.heldout if held else r.train).rms * 1e3 for r in (self.rungs[0], self.rungs[-1]))
        where = "poses held out" if held else "the poses fitted to"
        return f"error on {where}: {first:.4f} mm RMS with registration alone, {last:.4f} mm with {self.rungs[-1].step}"

    def ladder(self) -> pd.DataFrame:
        """One row a step: 3-D errors [mm] on held-out and training poses, and the unknowns solved."""
        rows = [
            {"step": r.step}
            | {f"{side} {k} [mm]": 1e3 * getattr(e, k) for side, e in (("held-out", r.heldout), ("training", r.train))
               for k in ("mean", "rms", "max")}
            | {"unknowns": r.fit.rank}
            for r in self.rungs
        ]  # fmt: skip
        return pd.DataFrame(rows)

    def to_dataframe(self) -> pd.DataFrame:
        """One row a parameter or effect: value, stderr, unit, kept, unique_share, slot, axis, basis, family."""
        return pd.DataFrame([{k: v for k, v in p.items() if k not in ("inputs", "partners")} for p in self._effects()])

    def summary(self) -> str:
        """The ladder, held-out errors first; the parameters with their deviations; what to distrust; the verdict."""
        fit, dataset = self.fit, self.dataset
        head = ["3-D error, mm", "held out: mean", "rms", "max", "training: mean", "rms", "max", "unknowns"]
        steps = [
            [r.step, *("-" if np.isnan(v) else f"{1e3 * v:.4f}" for e in (r.heldout, r.train)
                       for v in (e.mean, e.rms, e.max)), str(r.fit.rank)]
            for r in self.rungs
        ]  # fmt: skip
        lines = [aligned([head, *steps])]
        kept = [p for p in self._effects() if p["kept"]]
        if kept:
            table = [
                [p["name"], str(measured(p["value"], p["stderr"], p["unit"])), f"{p['unique_share']:.2f}",
                 ", ".join(f"{x['name']} {x['correlation']:+.2f}" for x in p["partners"])]
                for p in kept
            ]  # fmt: skip
            lines += ["", aligned([["fitted to all poses", "value", "unique share", "correlated with"], *table])]
        if fit.dropped:
            lines.append(f"not identifiable with these poses, held at zero: {', '.join(fit.dropped)}")
        if len(fit.outliers):
            lines.append(f"outliers, not fitted: rows {', '.join(map(str, dataset.row[fit.outliers]))}")
        if len(self.rungs[0].fit.error) < len(dataset) and np.isnan(self.rungs[-1].heldout.rms):
            lines.append("held out are only poses of set-ups or tools not trained on: no error can be given for them")
        lines.append(f"{fit.status}: {fit.reason}; condition limit {fit.condition_limit:g}")
        return "\n".join([*lines, self.verdict])

    def to_json(self, command: str = "gpmodel.calibrate") -> str:
        """The content of report.json."""
        return to_json(_content(self, command))

    def save(self, file: str | Path) -> None:
        """Write the numbers as .json. Raises InputError when it cannot be written."""
        write_text(Path(file), self.to_json())

    def report(self, folder: str | Path, *, command: str = "gpmodel.calibrate") -> None:
        """Leave model.json and report.json in `folder`: both of them or none."""
        with finished_folder(Path(folder)) as draft:
            write_text(draft / "model.json", model_text(self.model.saved))
            write_text(draft / "report.json", self.to_json(command))

    def _effects(self) -> list[dict[str, Any]]:
        return _parameters(self.fit)

    def __repr__(self) -> str:
        return f"<calibration of {self.fit.model.mechanism.name} on {self.dataset.source}: {self.verdict}>"

    def _repr_html_(self) -> str:
        return notebook(self.summary())


def calibrate(
    mechanism: Mechanism,
    table: TableLike,
    effects: Sequence[str | Effect] = (),
    *,
    standard: Sequence[str] = ("*",),
    condition_limit: float | None = None,
    holdout: float = 0.3,
    seed: int = 0,
) -> Calibration:
    """Fit registration, tool point, the standard model and the named effects together; say what each gained.

    effects: of the catalogue by name ("base_compliance", "gear_harmonic J4"), written out ("slot:axis:expression"),
    or Effect objects. standard: patterns of the geometric parameters, as "J* R?"; ("none",) for none.
    condition_limit: of the standard model, None for cross-validated. holdout: share of the poses that no step but the
    final fit sees, 0 for none. Raises InputError: a table that is not sound, an unknown effect, a fit that diverges.
    """
    started = time.perf_counter()
    fraction, seed = share(holdout, "holdout"), whole(seed, "seed")
    condition_limit = limit(condition_limit, "condition_limit", 1.0)
    geometry = standard_effects(mechanism, tuple(standard))
    mechanism, poses = sound_poses(mechanism, table, geometry)
    groups: Groups = [named_group(effect, mechanism, poses) for effect in effects]
    dataset = poses.dataset
    train, held = split(dataset, fraction, seed)
    rungs = climb(mechanism, poses, train, held, geometry, groups, condition_limit=condition_limit, seed=seed)
    fit = fit_model(rungs[-1].fit.model, poses, condition_limit=condition_limit, seed=seed)
    for step, tried in [*((r.step, r.fit) for r in rungs), ("all poses", fit)]:
        if tried.status == "diverged":
            raise InputError(f"{dataset.source}: the fit of {step} diverged: {tried.reason}")
    named = frozenset(e.name for _, group in groups for e in group)
    return Calibration(dataset, rungs, fit, named, seed, time.perf_counter() - started)


def sound_poses(
    mechanism: Mechanism, table: TableLike, standard: tuple[Effect, ...] | None = None
) -> tuple[Mechanism, Poses]:
    """The mechanism and the table's poses, judged; a payload hangs at the tool point, which a first fit finds.

    standard: the geometric effects that will be fitted (default: all). Raises InputError for the first thing that makes
    the table useless.
    """
    poses = prepare(mechanism, read_table(table, mechanism))
    refuse(mechanism, poses, standard)
    return hang_payload(mechanism, poses)


def named_group(effect: str | Effect, mechanism: Mechanism, poses: Poses) -> tuple[str, tuple[Effect, ...]]:
    """A step of the ladder: what it is called, and its effects."""
    if isinstance(effect, Effect):
        return effect.name, (effect,)
    return effect, effects_named(effect, mechanism, poses.states)


def split(dataset: Dataset, holdout: float, seed: int) -> tuple[IntArray, IntArray]:
    """Training rows and held-out rows; none are held out with a share of 0."""
    if holdout == 0.0:
        return np.arange(len(dataset)), np.zeros(0, dtype=np.int64)
    return hold_out(dataset, holdout, np.random.default_rng(seed))


def _parameters(fit: Fit) -> list[dict[str, Any]]:
    partners = fit.partners()
    return [
        {
            "name": effect.name,
            "slot": ", ".join(effect.slots),
            "axis": ", ".join(dict.fromkeys(t.axis for t in effect.terms)),
            "basis": "; ".join(dict.fromkeys(str(t.basis) for t in effect.terms)),
            "inputs": list(effect.inputs),
            "value": value,
            "stderr": stderr,
            "unit": effect.unit,
            "kept": bool(kept),
            "unique_share": unique,
            "found_by": "named",
            "catalogue": effect.family,
            "partners": [{"name": n, "correlation": c} for n, c in partners.get(effect.name, ())],
        }
        for effect, value, stderr, kept, unique in zip(
            fit.model.effects, fit.theta, fit.stderr, fit.kept, fit.unique_share, strict=True
        )
    ]


def _content(result: Calibration, command: str) -> dict[str, Any]:
    dataset, fit, last = result.dataset, result.fit, result.rungs[-1]
    mechanism, floor = fit.model.mechanism, noise_floor(dataset)
    parameters = _parameters(fit)
    return {
        "schema": 1,
        "command": command,
        "versions": {"gpmodel": __version__, "numpy": np.__version__},
        "seed": result.seed,
        "data": {
            "file": dataset.source,
            "sha256": dataset.sha256,
            "poses": len(dataset),
            "train": len(last.fit.error),
            "heldout": len(dataset) - len(last.fit.error),
            "outliers": dataset.row[fit.outliers],
        },
        "mechanism": {"name": mechanism.name, "joints": [j.name for j in mechanism.joints]},
        "ladder": [
            {"step": r.step, "train": r.train.as_mm(), "heldout": r.heldout.as_mm(), "rank": r.fit.rank,
             "dropped": list(r.fit.dropped)}
            for r in result.rungs
        ],
        "parameters": [p for p in parameters if p["name"] not in result.named],
        "effects": [p for p in parameters if p["name"] in result.named],
        "condition_limit": fit.condition_limit,
        "rank_curve": [
            {"condition_limit": c.condition_limit, "rank": c.rank, "cv_rms_mm": 1e3 * c.cv_rms} for c in fit.rank_curve
        ],
        "status": fit.status,
        "reason": fit.reason,
        "sigma_mm": 1e3 * fit.sigma,
        "noise_floor_mm": None if floor is None else 1e3 * floor,
        "verdict": result.verdict,
        "seconds": result.seconds,
    }  # fmt: skip

"""Import, sample, search and test a measured robot."""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.options import parsed
from gpmodel.api.discover import DiscoveryResult
from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration, errors_on
from gpmodel.cli.discover import strategies_named
from gpmodel.discovery.loop import discover
from gpmodel.discovery.search import Search
from gpmodel.discovery.state import Discovery
from gpmodel.families import catalogue
from gpmodel.families.candidate import Candidate
from gpmodel.files import to_json, write_text
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses, prepare
from gpmodel.report.origin import Origin, versions
from gpmodel.table.foreign import import_file, read_map
from gpmodel.table.layout import read_sheets
from gpmodel.table.read import dataset_from

CONDITION_LIMIT = 50.0


def settings(description: str | None) -> argparse.Namespace:
    """The options of an experiment: --data has the original files, --out gets the report; --look: poses to search."""
    return parsed(
        description, data=Path, out=Path, results=None, seed=0, runs=1, representations="linear,tree", max_effects=12,
        look=400, minutes=20.0, workers=2,
    )  # fmt: skip


def load(file: Path, columns: Path, robot: str) -> Poses:
    """The poses of one original file, through the importer."""
    mechanism = MechanismChoice(robot).load()
    return prepare(mechanism, dataset_from(import_file(read_sheets(file)[0], read_map(columns)), file, mechanism))


def look(robot: str, poses: Poses, train: IntArray, heldout: IntArray, given: argparse.Namespace) -> Discovery:
    """The loop as `gpmodel discover` runs it, with its report in `given.out`."""
    search = Search(
        runs=given.runs, max_effects=given.max_effects, stop_after=60 * given.minutes, workers=given.workers,
        strategies=strategies_named(given.representations, "slot", {}), scored_poses=len(train),
    )  # fmt: skip
    found = discover(
        MechanismChoice(robot).load(), poses, train, heldout, search=search, seed=given.seed,
        progress=lambda text: print(text, file=sys.stderr),
    )  # fmt: skip
    DiscoveryResult(found, Origin(" ".join(sys.argv), given.seed, found.seconds)).report(given.out)
    return found


def statistics(errors: Array) -> dict[str, float | int]:
    """3-D errors (N,) in m, said in mm."""
    mm = 1e3 * errors
    return {
        "poses": len(mm), "mean_mm": float(mm.mean()), "rms_mm": float(np.sqrt(np.mean(mm**2))),
        "median_mm": float(np.median(mm)), "p95_mm": float(np.percentile(mm, 95)), "max_mm": float(mm.max()),
    }  # fmt: skip


def ladder(found: Discovery, poses: Poses) -> list[dict[str, Any]]:
    """Errors of every step of the loop on any other poses; every step was fitted to the training sample alone."""
    names = [f.candidate.name for f in found.findings]
    return [
        {"step": s.name if s.finding is None else names[s.finding], **statistics(errors_on(s.calibration, poses))}
        for s in found.steps
    ]


def model_of(found: Discovery, groups: Sequence[tuple[Effect, ...]]) -> ErrorModel:
    """The standard model and some effects beside it."""
    return ErrorModel(found.mechanism, (*found.standard_model, *(e for group in groups for e in group)))


def found_effects(found: Discovery, poses: Poses) -> list[tuple[Effect, ...]]:
    """The effects of every finding, as the catalogue writes them for these poses: more poses carry more harmonics."""
    known = catalogue.candidates(found.mechanism, poses.states)
    out: list[tuple[Effect, ...]] = []
    for finding in found.findings:
        same = [c for c in known if c.name == finding.candidate.name] or [finding.candidate]
        spread = _spread(finding.candidate)
        out.append(min(same, key=lambda c, s=spread: abs(_spread(c) - s)).effects)
    return out


def _spread(candidate: Candidate) -> float:
    """Return the prior standard deviation of a candidate; zero without priors."""
    return float(np.linalg.norm([e.prior for e in candidate.effects if np.isfinite(e.prior)]))


def fitted(model: ErrorModel, poses: Poses) -> Calibration:
    """A fit with the condition limit of these experiments."""
    return calibrate(model, poses, condition_limit=CONDITION_LIMIT)


def frozen(found: Discovery, groups: Sequence[tuple[Effect, ...]], fit: Calibration) -> list[tuple[Effect, ...]]:
    """Each finding as one effect of the shape it has in a fit; the unknown is its amplitude, 1 where it was fitted."""
    value = dict(zip((e.name for e in fit.model.effects), fit.theta, strict=True))
    out = []
    for finding, group in zip(found.findings, groups, strict=True):
        terms = tuple(replace(t, weight=t.weight * value[e.name]) for e in group for t in e.terms if value[e.name])
        if terms:
            out.append((Effect(f"amplitude of {finding.candidate.name}", terms, "1", finding.candidate.family),))
    return out


def save(results: dict[str, Any], path: Path | None) -> None:
    """Write or print the numbers, with the command and the versions that made them."""
    text = to_json({**results, "versions": versions()})
    print(text)
    if path is not None:
        write_text(path, text)

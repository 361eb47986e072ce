"""Refit the geometry without effects that a rigid-body description cannot express, and write it as URDF."""

import re
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gpmodel.application.exports.forward import coupled
from gpmodel.application.exports.sample import measured_table, tips_of
from gpmodel.application.model_file import SavedModel, saved_model
from gpmodel.application.usable import at_end, session_effects, usable
from gpmodel.arrays import Array
from gpmodel.calibration.comparison import known_rows
from gpmodel.calibration.gauss_newton import calibrate, without_outliers
from gpmodel.calibration.result import errors_on
from gpmodel.calibration.undeclared import UNDECLARED
from gpmodel.characters import harmless
from gpmodel.errors import InputError
from gpmodel.mechanism.branches import branched
from gpmodel.mechanism.protocol import INSTRUMENT, ExportsUrdf, Mechanism, unwrapped
from gpmodel.model.error_model import ErrorModel, Placement, Poses, measured_minus, observe, prepare
from gpmodel.model.sites import translate
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.numerics.se3 import roll_pitch_yaw
from gpmodel.table.blocks import FOLD_SEED, FOLDS, folds, repeat_blocks
from gpmodel.table.convention import axes_note
from gpmodel.wording import length


@dataclass(frozen=True)
class Rigid:
    """Refitted geometry of a mechanism.

    placement: registration and tool at the end of the session.
    twists: constant error twist, m and rad, by frame (slot).
    heldout: 3-D errors on held-out rows, without outliers of the model, m.
    missing: omitted effects, with the names of the fitted table.
    tips: with several arms, the measured link of each tool.
    axes: convention of the joint values, as text.
    """

    mechanism: Mechanism
    placement: Placement
    twists: Mapping[str, Array]
    heldout: Array
    missing: tuple[str, ...]
    tips: Mapping[str, str]
    axes: str


def refitted(saved: SavedModel) -> Rigid:
    """Refit the geometric constants of the model to its table, without the other effects of the mechanism.

    Constants are not refitted if the mechanism has no other effects, or if they were fitted separately from undeclared
    effects. Effects of the instrument and of the session stay in the fit, so that the geometry does not absorb them.
    Raises InputError if the model contains no table, or for a fit that fails.
    """
    poses = prepare(saved.mechanism, measured_table(saved))
    aside = {e.name for e in session_effects(saved)}
    kept = tuple(e for e in saved.model.effects if e.constant or e.name in aside or e.of_the_instrument)
    model = ErrorModel(saved.mechanism, kept)
    heldout = _held_out(model, poses, saved)
    fitted_apart = all(e in kept or e.family == UNDECLARED for e in saved.model.effects)
    fitted = saved if fitted_apart else saved_model(calibrate(model, poses), poses)
    values = zip(saved.model.effects, saved.theta, strict=True)
    missing = tuple(translate(e.name, saved.names) for e, value in values if e not in kept and value != 0.0)
    placement, twists = at_end(usable(fitted)).placement, _constant_twists(fitted, poses.subset(np.arange(1)))
    return Rigid(saved.mechanism, placement, twists, heldout, missing, tips_of(saved), axes_note(saved.convention))


def _held_out(model: ErrorModel, poses: Poses, saved: SavedModel) -> Array:
    """Return the 3-D errors on held-out poses, m, or, if none were held out, of each pose by a fit without its fold.

    The outliers of the saved model are excluded, as in all errors of the report.
    """
    if saved.measured is None:
        return np.zeros(0)
    observed = observe(saved.model, poses, saved.theta, saved.placement)
    measured = np.asarray(np.isfinite(measured_minus(observed, poses.dataset)).any(axis=1))
    counts = without_outliers(observed, poses.dataset, measured, saved.weights)
    parts = [saved.measured.heldout]
    if not len(saved.measured.heldout):
        count = min(FOLDS, int(repeat_blocks(poses.dataset).max()) + 1)
        fold = folds(poses.dataset, count, np.random.default_rng(FOLD_SEED)) if count > 1 else np.zeros(0)
        parts = [np.flatnonzero(fold == k) for k in range(count)]
    errors = [np.zeros(0)]
    for rows in parts:
        seen, unseen = (poses.subset(r) for r in (np.setdiff1d(np.arange(len(poses)), rows), rows[counts[rows]]))
        known = unseen.subset(known_rows(seen.dataset, unseen.dataset))
        with suppress(InputError):
            errors.append(errors_on(calibrate(model, seen), known) if len(known) else np.zeros(0))
    return np.concatenate(errors)


def _constant_twists(fitted: SavedModel, one: Poses) -> dict[str, Array]:
    """Return the constant error twists by frame (slot), m and rad. one: any single pose."""
    out: dict[str, Array] = {}
    for effect, value in zip(fitted.model.effects, fitted.theta.tolist(), strict=True):
        if effect.constant and value != 0.0:
            for slot in effect.slots:
                out[slot] = out.get(slot, np.zeros(6)) + value * effect.twist(one.states, slot)[0]
    out.pop(INSTRUMENT, None)
    return out


URDF = "calibrated.urdf"
LINK = "Measured link: "
"""Prefix of the comment in a URDF that names the link of the tool point."""


def urdf_text(rigid: Rigid, note: str) -> str:
    """Return the URDF of the nominal chain with constant error twists, and `note` as a comment.

    Raises InputError if the mechanism cannot be written as URDF.
    """
    text, frame = written(rigid.mechanism, rigid.twists)
    comment = "\n".join([f"{LINK}{frame}", *map(harmless, note.splitlines())]).replace("--", "- -")
    return re.sub(r"(<\?xml[^>]*\?>\n?)?", lambda head: f"{head[0]}<!--\n{comment}\n-->\n", text, count=1)


def written(mechanism: Mechanism, twists: Mapping[str, Array]) -> tuple[str, str]:
    """Return the URDF text of a chain with constant error twists, m and rad, by slot (frame), and its measured link.

    Raises InputError if the mechanism cannot be written as URDF.
    """
    bare = unwrapped(mechanism)
    if not isinstance(bare, ExportsUrdf):
        raise InputError(f"{bare.name} cannot be written as URDF; expected a mechanism that implements write_urdf")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "calibrated.urdf"
        frame = bare.write_urdf(path, twists)
        return path.read_text(encoding="utf-8"), frame


def measured_link(text: str) -> str:
    """Return the name of the measured link from the text of an exported URDF."""
    return text.partition(LINK)[2].partition("\n")[0]


def follows(mechanism: Mechanism, file: str) -> tuple[str, ...]:
    """Describe how an exported file expresses joints that several of the controller's values move."""
    out = []
    for name, factors in coupled(mechanism).items():
        own, *others = factors
        terms = "".join(f" {'-' if factors[n] < 0 else '+'} {_times(abs(factors[n]))}{n}" for n in others)
        if file.endswith(".toml"):
            out.append(
                f"{name} follows {', '.join(others)} by [[coupling]]: it moves by {own}{terms} of the controller"
            )
            continue
        mimics = ", ".join(f"{name}_with_{n}" for n in others)
        here = f"{name} here = {name} of the controller{terms}"
        if file.endswith(".urdf"):
            out.append(f"{name} follows {', '.join(others)} by mimic of {mimics}; where mimic is not read, {here}")
        else:
            out.append(f"{here}, but where the URDF has {mimics} as {URDF} has")
    return tuple(out)


def _times(factor: float) -> str:
    return "" if factor == 1.0 else f"{factor:g} "


def note_of(rigid: Rigid, file: str, link: str = "the measured link", at: Mapping[str, Array] | None = None) -> str:
    """State contents, error and omissions of exported geometry, as comment lines for the head of a file.

    link: link of the tool point; for several arms all links, separated by commas.
    at: pose, m, of the measured link in the frame of `link`, by link name; empty if `link` is the measured link.
    """
    lines = [f"Geometry of {harmless(rigid.mechanism.name)}, fitted without what a rigid description cannot hold."]
    if len(rigid.heldout):
        rms, most = (length(1e3 * v) for v in (root_mean_square(rigid.heldout), float(rigid.heldout.max())))
        lines.append(f"Error on held-out poses: {rms} RMS, {most} at most.")
    else:
        lines.append("No poses were held out: its error on other poses is not known.")
    lines.append(
        f"Missing: {harmless('; '.join(rigid.missing))}." if rigid.missing else "Nothing of the model is missing."
    )
    lines.append(f"Convention: {harmless(rigid.axes)}.")
    lines += [f"{said}." for said in follows(rigid.mechanism, file)]
    tree = branched(rigid.mechanism)
    links = dict(zip(tree.tips, link.split(","), strict=False)) if tree else {}
    for name, frame in rigid.placement.registration.items():
        place = ", ".join(f"{1e3 * v:.6f}" for v in frame[:3, 3])
        turn = ", ".join(f"{v:.9f}" for v in roll_pitch_yaw(frame[:3, :3]))
        setup = f", set-up {harmless(name)}" if name else ""
        lines.append(f"Root in the frame of the instrument{setup}: xyz mm {place}; rpy rad {turn}.")
    for name, tool in rigid.placement.tool.items():
        own = links.get(rigid.tips.get(name, ""), link)
        point = ", ".join(f"{1e3 * v:.6f}" for v in ((at or {}).get(own, np.eye(4)) @ tool)[:3, 3])
        lines.append(f"Tool point{f' {harmless(name)}' if name else ''} in {own}, mm: {point}.")
    return "\n".join(lines)

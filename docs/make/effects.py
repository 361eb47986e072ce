"""Make the pages of the effect catalogue: source, displacement of the tool, and similar effects of each family."""

import io
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from threadpoolctl import threadpool_limits

import gpmodel as gp
from gpmodel.arrays import Array
from gpmodel.calibration.linearise import effect_columns
from gpmodel.families.repair_advice import repair_advice
from gpmodel.mechanism.branches import random_poses
from gpmodel.mechanism.protocol import AXES, Mechanism
from gpmodel.model.error_model import ErrorModel, Placement, Poses, observe, prepare
from gpmodel.model.observed import Observed
from gpmodel.table.dataset import unmeasured

POSES = 120
MECHANISMS = ("irb6400r", str(Path(__file__).with_name("rail.toml")), "spherical-joint", "hexapod")
"""Mechanisms for the page of a family; the first mechanism on which the family has an effect is used."""
ALIKE = 0.7
"""Correlation of displacements, without the part of geometric constants, from which two families are called similar."""
SHOWN = 4
"""Largest number of effects of a candidate, and of similar families of a family."""
MOST = 40
"""Largest number of candidates of a family that are compared."""
INK, MARK = "#8a8f98", "#3b82f6"


@dataclass(frozen=True)
class Scene:
    """Random poses of a mechanism, and an orthonormal basis (3 N, G) of the displacements by all its geometric
    constants."""

    title: str
    mechanism: Mechanism
    poses: Poses
    observed: Observed
    geometry: Array

    def columns(self, effects: Iterable[gp.Effect]) -> Array:
        """Return the displacement of the tool by one unit of each effect, (3 N, E), m."""
        seen = effect_columns(tuple(effects), ErrorModel(self.mechanism, ()), self.poses, self.observed)
        return seen[:, :3].reshape(3 * POSES, -1)

    def left(self, columns: Array) -> Array:
        """Project the displacements by geometric constants out of columns (3 N, E)."""
        return columns - self.geometry @ (self.geometry.T @ columns)


def scene(name: str) -> Scene:
    """Draw random poses with payload, temperature, time and directions of approach, with ordered rows."""
    arm, rng = gp.load_mechanism(name), np.random.default_rng(0)
    q = random_poses(arm, POSES, rng)
    time: Array = np.arange(0.0, 60.0 * POSES, 60.0)
    extras = {"temperature": 20.0 + 4.0 * np.sin(time / 2500.0), "time": time}
    extras |= {f"approach_{joint.name}": rng.choice([-1.0, 1.0], POSES) for joint in arm.joints}
    extras |= {"gravity_x": 0.1 * rng.normal(size=POSES), "gravity_z": np.full(POSES, -0.99)}
    units = {n: {"temperature": "degC", "time": "s"}.get(n, "1") for n in extras}
    joints = [joint.name for joint in arm.joints]
    dataset = replace(
        unmeasured(joints, q, rng.uniform(0.0, 10.0, POSES)), extras=extras, extra_units=units, in_order=True
    )
    tool, register = np.eye(4), np.eye(4)
    tool[:3, 3], register[:3, 3] = (0.1, -0.05, 0.15), (3.0, 1.0, 0.5)
    placement, bare = Placement({"": register}, {"": tool}, {}), ErrorModel(arm, ())
    there = observe(bare, prepare(arm, dataset), np.zeros(0), placement).tip[:, :3, 3]
    poses = prepare(arm, replace(dataset, position=there))
    observed = observe(bare, poses, np.zeros(0), placement)
    made = Scene(arm.name, arm, poses, observed, np.zeros((3 * POSES, 1)))
    one = gp.Expression("1")
    constants = [gp.effect_at("c", slot, axis, one) for slot in arm.slots for axis in AXES]
    basis, sizes, _ = np.linalg.svd(made.columns(constants), full_matrices=False)
    return replace(made, geometry=basis[:, sizes > 1e-9 * sizes[0]])


def pages() -> dict[str, str | bytes]:
    """Return the overview, and a page and a picture for each family, by path."""
    with threadpool_limits(1, user_api="blas"):
        scenes = [scene(name) for name in MECHANISMS]
        found = {f.name: _first(f, scenes) for f in gp.catalogue}
        signatures = _signatures(list(gp.catalogue), scenes[0])
    made: dict[str, str | bytes] = {"effects/index.md": _overview()}
    for family in gp.catalogue:
        shown = found[family.name]
        if shown is not None:
            made[f"effects/pictures/{family.name}.svg"] = _picture(*shown)
        made[f"effects/{family.name}.md"] = _page(family, shown, signatures)
    return made


def _first(family: gp.Family, scenes: list[Scene]) -> tuple[Scene, gp.Candidate] | None:
    """Return the candidate of a family that displaces the tool most, on the first mechanism that has one."""
    for place in scenes:
        instances = [_candidate(c) for c in family.build(place.mechanism, place.poses.states)]
        sizes = [float(np.abs(place.left(place.columns(c.effects[:SHOWN]))).max()) for c in instances[:MOST]]
        if sizes and max(sizes) > 0.0:
            return place, instances[int(np.argmax(sizes))]
    return None


def _candidate(offer: gp.Candidate | gp.Effect) -> gp.Candidate:
    return offer if isinstance(offer, gp.Candidate) else gp.Candidate(offer.name, (offer,), offer.family, 0.0)


def _signatures(families: list[gp.Family], place: Scene) -> dict[str, list[tuple[str, Array]]]:
    """Return {family: (candidate, unit displacements of its effects without the part of geometric constants)}."""
    out: dict[str, list[tuple[str, Array]]] = {}
    for family in families:
        candidates = [_candidate(c) for c in family.build(place.mechanism, place.poses.states)][:MOST]
        effects = [(c.name, effect) for c in candidates for effect in c.effects[:SHOWN]]
        left = place.left(place.columns(effect for _, effect in effects)) if effects else np.zeros((3 * POSES, 0))
        sizes = np.linalg.norm(left, axis=0)
        out[family.name] = [
            (name, column / size) for (name, _), column, size in zip(effects, left.T, sizes, strict=True) if size > 1e-9
        ]
    return out


def _rivals(family: str, signatures: dict[str, list[tuple[str, Array]]]) -> list[tuple[str, str, str, float]]:
    """Return similar families, the most similar first: family, its candidate, the compared candidate, correlation."""
    own = signatures[family]
    found = []
    for other, rows in signatures.items():
        if other == family or not own or not rows:
            continue
        alike = np.abs(np.stack([v for _, v in own]) @ np.stack([v for _, v in rows]).T)
        i, j = np.unravel_index(int(np.argmax(alike)), alike.shape)
        if alike[i, j] >= ALIKE:
            found.append((other, rows[j][0], own[i][0], float(alike[i, j])))
    return sorted(found, key=lambda row: -row[3])[:SHOWN]


def _moves(place: Scene, candidate: gp.Candidate) -> Array:
    """Return the displacement (N, 3), m, of the tool by one unit of each effect of a candidate together."""
    return place.columns(candidate.effects).sum(axis=1).reshape(POSES, 3)


def _picture(place: Scene, candidate: gp.Candidate) -> bytes:
    """Draw the displacements from above and from the side, and their size over the first input of the effect."""
    move, at = _moves(place, candidate), place.observed.tip[:, :3, 3]
    size = np.linalg.norm(move, axis=1)
    share = move / max(float(size.max()), 1e-300)
    figure = Figure(figsize=(9.5, 3.2), layout="constrained")
    axes = figure.subplots(1, 3)
    for axis, (a, b), title in zip(axes[:2], ((0, 1), (0, 2)), ("from above", "from the side"), strict=True):
        axis.quiver(at[:, a], at[:, b], share[:, a], share[:, b], color=MARK, angles="xy", scale=8, width=0.004)
        axis.set_aspect("equal", "datalim")
        axis.set_title(title)
        axis.set_xlabel("m")
    reads = next((n for e in candidate.effects for n in e.inputs), "")
    values = place.poses.states[reads] if reads else np.arange(float(POSES))
    axes[2].scatter(values, size / max(float(size.max()), 1e-300), s=7, color=MARK)
    axes[2].set_title("share of its largest move")
    axes[2].set_xlabel(reads or "row")
    for axis in axes:
        axis.tick_params(colors=INK, labelsize=7)
        axis.title.set_color(INK)
        axis.title.set_fontsize(9)
        axis.xaxis.label.set_color(INK)
        for spine in axis.spines.values():
            spine.set_color(INK)
    file = io.BytesIO()
    figure.savefig(file, format="svg", transparent=True, metadata={"Date": None})
    return file.getvalue()


def _overview() -> str:
    lines = [
        "# Effects",
        "",
        f"{len(gp.catalogue)} families, each a cited mechanism or a recorded discovery. A family is written",
        "`--effect 'NAME'` or `--effect 'NAME JOINT'`; `gpmodel effects --mechanism M` says which have an instance on",
        "a machine of yours. These pages are made of the families themselves when the documentation is built.",
        "",
        "| family | what happens | source |",
        "|---|---|---|",
    ]
    lines += [f"| [{f.name}]({f.name}.md) | {f.explanation} | {f.source} |" for f in gp.catalogue]
    return "\n".join(lines) + "\n"


def _page(
    family: gp.Family,
    shown: tuple[Scene, gp.Candidate] | None,
    signatures: dict[str, list[tuple[str, Array]]],
) -> str:
    lines = [f"# {family.name}", "", f"{family.explanation[0].upper()}{family.explanation[1:]}.", ""]
    lines += [f"*Source:* {family.source}.", ""]
    if advice := repair_advice().get(family.name):
        lines += ["## For maintenance", "", *(f"- {heading}: {said}" for heading, said in advice.lines), ""]
    if shown is None:
        lines += [
            "This family has no instance on the machines of this page: it needs further columns in the table.",
            "",
        ]
    else:
        lines += _instance(family, *shown)
    lines += ["## Similar effects", ""]
    rivals = _rivals(family.name, signatures)
    if not signatures[family.name]:
        lines += ["Not computed: this family has no instance on the IRB 6400R.", ""]
    elif not rivals:
        lines += [f"On {POSES} random poses of the IRB 6400R no other effect of the catalogue is similar.", ""]
    else:
        lines += [
            "Correlation after fitting all geometric constants; effects with correlation 1 cannot be separated.",
            "",
        ]
        lines += ["| rival | as | beside | correlation |", "|---|---|---|---|"]
        lines += [f"| [{o}]({o}.md) | {name} | {own} | {alike:.2f} |" for o, name, own, alike in rivals]
    return "\n".join(lines) + "\n"


def _instance(family: gp.Family, place: Scene, candidate: gp.Candidate) -> list[str]:
    column = _moves(place, candidate).reshape(-1, 1)
    kept = float(np.linalg.norm(place.left(column)) / np.linalg.norm(column))
    reads = dict.fromkeys(n for e in candidate.effects for n in e.inputs)
    first = candidate.effects[0]
    terms = "; ".join(f"{t.basis} at {t.slot} {t.axis}" for t in first.terms[:SHOWN])
    more = f" and {len(candidate.effects) - 1} more" if len(candidate.effects) > 1 else ""
    return [
        f"![Displacement of the tool by {candidate.name}](pictures/{family.name}.svg)",
        "",
        f"*{candidate.name}* on {place.title}: the arrows are displacements of the tool at {POSES} random poses,",
        "scaled so that the longest always has the same length.",
        "",
        "| | |",
        "|---|---|",
        f"| written | `--effect '{candidate.name}'` |",
        f"| unit | {first.unit} |",
        f"| reads | {', '.join(reads) or 'nothing'} |",
        f"| its first term | `{terms}`{more} |",
        f"| part that remains after calibration | {100 * kept:.0f} %; geometric constants absorb the rest |",
        "",
    ]

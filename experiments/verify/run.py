"""Does `gpmodel verify` see what changed, and nothing where nothing did?

Simulated arms (IRB 6400R, every constant off by 0.3 mm or 0.3 mrad, a base that yields, a gear of J4 that is oval) are
measured at 90 random poses, 0.02 mm a coordinate, and calibrated. Later 20 other random poses are measured from another
place of the instrument: by the same arm; with the zero of one joint moved by 30 µrad; with the tool slipped by 0.1 mm;
with one reading in ten off by 0.5 mm; by another arm.
From the root of the repository: python -m experiments.verify.run [--robots 20] [--same 50]
"""

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import gpmodel as gp
from gpmodel.arrays import Array
from gpmodel.files import to_json, write_text
from gpmodel.mechanism.branches import random_poses
from gpmodel.model.effect import drive_effect
from gpmodel.model.error_model import ErrorModel, Placement, observe, prepare
from gpmodel.numerics import se3
from gpmodel.planning.simulate import Simulation, simulate
from gpmodel.table.dataset import Dataset, unmeasured

NOISE, POSES, LATER = 2e-5, 90, 20
ZERO, SLIP, SPIKE = 3e-5, 1e-4, 5e-4
EFFECTS = ("base_compliance=5 nrad/Nm", "gear_harmonic J4=60 urad")
NAMES = ("base_compliance", "gear_harmonic J4")
ARM = gp.load_mechanism("irb6400r")


@dataclass(frozen=True)
class Robot:
    """A robot, its measurement and the model fitted to that."""

    made: Simulation
    model: gp.Model
    rng: np.random.Generator

    def changed(self, joint: int, moved: float) -> tuple[ErrorModel, Array]:
        """The true robot after the zero of a joint moved, rad."""
        zero = drive_effect("moved", ARM.joints[joint], gp.Expression("1"))
        return ErrorModel(ARM, (*self.made.model.effects, zero)), np.append(self.made.theta, moved)

    def later(self, joint: int = 0, moved: float = 0.0, slip: float = 0.0, spikes: int = 0) -> Dataset:
        """Other poses from another place of the instrument, with a zero that moved, rad, and a tool that slipped, m."""
        made, rng = self.made, self.rng
        truth, theta = self.changed(joint, moved)
        registration = se3.exp(np.concatenate([rng.normal(0.0, 3.0, 3), rng.uniform(-1.5, 1.5, 3)]))
        tool = made.placement.tool[""].copy()
        tool[:3, 3] += slip * _direction(rng)
        dataset = unmeasured([j.name for j in ARM.joints], random_poses(ARM, LATER, rng))
        placement = Placement({"": registration}, {"": tool}, {})
        tip = observe(truth, prepare(ARM, dataset), theta, placement).tip[:, :3, 3]
        position = tip + rng.normal(0.0, NOISE, tip.shape)
        for row in rng.choice(LATER, spikes, replace=False):
            position[row] += SPIKE * _direction(rng)
        return replace(dataset, position=position, source="later")


def _direction(rng: np.random.Generator) -> np.ndarray:
    direction = rng.normal(size=3)
    return direction / np.linalg.norm(direction)


def robot(seed: int) -> Robot:
    rng = np.random.default_rng(seed)
    made = simulate(ARM, random_poses(ARM, POSES, rng), EFFECTS, rng, noise=NOISE, geometry_sigma=3e-4)
    return Robot(made, gp.calibrate(ARM, made.dataset, NAMES, holdout=0.0).model, rng)


def trials(robots: list[Robot], case: str) -> Iterator[Mapping[str, object]]:
    """Yield the verdict of `verify` on every robot after one kind of change, and whether it is right."""
    for k, own in enumerate(robots):
        joint = {"zero of J2 or J3": 1 + k % 2, "zero of J4, J5 or J6": 3 + k % 3}.get(case, 0)
        expected = f"zero of J{joint + 1}" if joint else "tool point" if case == "tool slipped" else ""
        asked = {
            "same": {}, "same, two readings wrong": {"spikes": 2}, "tool slipped": {"slip": SLIP},
            "another arm": {},
        }.get(case, {"joint": joint, "moved": ZERO})  # fmt: skip
        measured = robots[k - 1] if case == "another arm" else own
        found = own.model.verify(measured.later(**asked)).record
        first = found.changes[0].name if found.changes else ""
        seen = {v.joint: v.size for v in found.visible}.get(f"J{joint + 1}") if joint else None
        wanted = {"same": "holds", "same, two readings wrong": "holds", "another arm": "another machine"}
        right = found.verdict == wanted.get(case, "drifted") and first == expected
        yield {
            "robot": k, "verdict": found.verdict, "named": first, "expected": expected, "right": right,
            "others": [c.name for c in found.changes[1:]], "chance": found.chance,
            "visible_urad": None if seen is None else round(1e6 * seen, 1),
        }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=20)
    parser.add_argument("--same", type=int, default=50)
    asked = parser.parse_args()
    robots = [robot(seed) for seed in range(max(asked.robots, asked.same))]
    counts = {
        "same": asked.same, "same, two readings wrong": asked.robots, "zero of J2 or J3": asked.robots,
        "zero of J4, J5 or J6": asked.robots, "tool slipped": asked.robots, "another arm": asked.robots,
    }  # fmt: skip
    out = {}
    for case, count in counts.items():
        rows = list(trials(robots[:count], case))
        out[case] = {"right": sum(bool(r["right"]) for r in rows), "of": count, "rows": rows}
        print(f"{case:<26}{out[case]['right']:>3} of {count}")
    path = Path(__file__).with_name("results.json")
    write_text(path, to_json({"command": f"--robots {asked.robots} --same {asked.same}", "cases": out}))


if __name__ == "__main__":
    main()

"""Count the poses that `gpmodel verify --next` takes, and its wrong answers.

The arms of `experiments.verify.run`. Later each is measured from another place of the instrument, pose by pose as
proposed, until it is decided or for 20 poses: by the same arm; with the zero of one joint moved by 0.3 mrad, each
joint in turn; with the tool slipped by 0.2 mm.
From the root of the repository: python -m experiments.verify.pose_by_pose [--robots 12] [--same 40]
"""

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

import gpmodel as gp
from experiments.verify.run import ARM, NOISE, Robot, robot
from gpmodel.api.verify import NextCheck
from gpmodel.arrays import Array
from gpmodel.files import to_json, write_text
from gpmodel.model.error_model import Placement, observe, prepare
from gpmodel.numerics import se3
from gpmodel.table.dataset import Dataset, unmeasured

ZERO, SLIP, MOST = 3e-4, 2e-4, 20


class Later:
    """A later session of a robot. moved: zero of a joint, rad. slip: of the tool along its x axis, m."""

    def __init__(self, own: Robot, seed: int, joint: int = 0, moved: float = 0.0, slip: float = 0.0) -> None:
        self.rng = np.random.default_rng([seed, joint, int(1e6 * (moved + slip))])
        self.truth, self.theta = own.changed(joint, moved)
        tool = own.made.placement.tool[""].copy()
        tool[:3, 3] += slip * tool[:3, 0]
        place = np.concatenate([self.rng.normal(0.0, 3.0, 3), self.rng.uniform(-1.5, 1.5, 3)])
        self.placement = Placement({"": se3.exp(place)}, {"": tool}, {})

    def table(self, q: Array, noise: bool = True) -> Dataset:
        """Poses (N, n), measured."""
        poses = unmeasured([j.name for j in ARM.joints], q)
        tip = observe(self.truth, prepare(ARM, poses), self.theta, self.placement).tip[:, :3, 3]
        return replace(poses, position=tip + noise * self.rng.normal(0.0, NOISE, tip.shape), source="later")

    def measured(self, before: Dataset | None, q: Array) -> Dataset:
        """The table with one more pose (n,)."""
        one = self.table(q[None])
        if before is None:
            return one
        both = unmeasured([j.name for j in ARM.joints], np.vstack([before.q, q]))
        return replace(both, position=np.vstack([before.position, one.position]), source="later")


def checked(own: Robot, later: Later) -> tuple[NextCheck, Dataset]:
    """The check to its end, and its table."""
    found, table = gp.verify_next(own.model), None
    while found.next is not None and (table is None or len(table) < MOST):
        table = later.measured(table, np.radians(found.next.to_numpy()[0]))
        found = gp.verify_next(own.model, table)
    return found, table


def trials(robots: list[Robot], case: str) -> Iterator[Mapping[str, object]]:
    """Yield for each robot the answer, after how many poses, and whether it is right."""
    for k, own in enumerate(robots):
        joint = 1 + k % 5
        changed = {"zero": {"joint": joint, "moved": ZERO}, "tool": {"slip": SLIP}}.get(case, {})
        found, _ = checked(own, Later(own, k, **changed))
        record = found.judged.record if found.judged else None
        named = [change.name for change in record.changes] if record else []
        wanted = {"zero": f"zero of J{joint + 1}", "tool": "tool point"}.get(case)
        right = found.holds is True if wanted is None else found.holds is False and named[:1] == [wanted]
        yield {
            "robot": k, "poses": found.poses, "holds": found.holds, "named": named, "expected": wanted, "right": right
        }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=12)
    parser.add_argument("--same", type=int, default=40)
    asked = parser.parse_args()
    robots = [robot(seed) for seed in range(max(asked.robots, asked.same))]
    out = {}
    for case, count in {"zero": asked.robots, "tool": asked.robots, "same": asked.same}.items():
        rows = list(trials(robots[:count], case))
        said = [r["holds"] for r in rows]
        poses = sorted(int(str(r["poses"])) for r in rows)
        right = sum(bool(r["right"]) for r in rows)
        out[case] = {"right": right, "changed": said.count(False), "open": said.count(None), "of": count, "rows": rows}
        print(
            f"{case:<6} of {count}: right {right}, changed {said.count(False)}, not decided {said.count(None)}; "
            f"poses {poses[0]} to {poses[-1]}, median {poses[len(poses) // 2]}"
        )
    command = f"--robots {asked.robots} --same {asked.same}"
    write_text(Path(__file__).with_name("pose_by_pose.json"), to_json({"command": command, "cases": out}))


if __name__ == "__main__":
    main()

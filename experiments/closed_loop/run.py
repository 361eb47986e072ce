"""Measure the error of `gpmodel compensate` on a robot that shares no code with gpmodel.

Blind robots are calibrated with their effect named. The targets are over the whole range, or have the wrist within two
degrees of a singularity. The independent simulator moves to the corrected joint values and gives the position of the
tool. Errors are in the frame of the calibration's registration.
From the root of the repository: python -m experiments.closed_loop.run [--targets 500]
"""

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import gpmodel as gp
from experiments.blind.files import write
from experiments.blind.generate import make, standing
from experiments.blind.machine import Machine
from experiments.blind.robot import world_of
from experiments.blind.session import Route
from experiments.blind.simulator import Array, draw_poses
from experiments.options import parsed
from gpmodel.files import to_json, write_text
from gpmodel.numerics.se3 import chain

CASES = {
    "base_and_ripple": ("base_compliance", "gear_harmonic J4"),
    "compliance_2": ("joint_compliance J2",),
    "wrist_coupling": ("coupling, J4 to J5",),
    "eccentric_1": ("eccentricity J1",),
}
"""Blind cases, and the effects that the calibration is told."""
SINGULAR = np.radians(2.0)
MAX_MOVE = 2.0
MANY = 10_000


def there(machine: Machine, amounts: list[float], q: Array) -> Array:
    """Where the true tool is (N, 3), m, in the tracker."""
    row = np.zeros(len(q))
    world = world_of(machine.arm, q, {}, row, machine.tool, machine.placement)
    sheet = machine.measured(amounts, Route(q, np.arange(len(q))), world, np.random.default_rng(0))
    return np.asarray(sheet.clean)


def table(q: Array) -> pd.DataFrame:
    return pd.DataFrame({f"J{i}": v for i, v in enumerate(np.degrees(q).T, 1)}).rename(columns="{} [deg]".format)


def statistics(error: Array) -> dict[str, float]:
    """Summarise distances (N,) in m; statistics in mm."""
    mm = 1e3 * error
    numbers = {"rms_mm": np.sqrt(np.mean(mm**2)), "p95_mm": np.percentile(mm, 95), "max_mm": mm.max()}
    return {name: round(float(value), 4) for name, value in numbers.items()}


def loop(machine: Machine, amounts: list[float], model: Any, q: Array) -> dict[str, Any]:
    """Targets at nominal joint values q, before and after compensation."""
    saved = model.saved
    nominal = chain(saved.mechanism.transforms(q))[-1] @ saved.placement.tool[""]
    wanted = (saved.placement.registration[""] @ nominal)[:, :3, 3]
    corrected = model.compensate(table(q), max_move=MAX_MOVE)
    after = np.radians(corrected.filter(regex="^corrected_").to_numpy())
    given = np.isfinite(after).all(axis=1)
    predicted = model.predict(table(q))[["x [mm]", "y [mm]", "z [mm]"]].to_numpy() / 1e3
    truth = there(machine, amounts, q)
    return {
        "targets": len(q),
        "statuses": corrected["status"].value_counts().to_dict(),
        "largest_move_deg": round(float(np.degrees(np.abs(after - q)[given].max())), 4),
        "round_trip_um": float(1e3 * corrected["residual [mm]"][given].max()),
        "before": statistics(np.linalg.norm(truth - wanted, axis=1)),
        "after": statistics(np.linalg.norm(there(machine, amounts, after[given]) - wanted[given], axis=1)),
        "calibrated": statistics(np.linalg.norm(truth - predicted, axis=1)),
    }


def study(case: str, effects: tuple[str, ...], targets: int) -> dict[str, Any]:
    machine, amounts, _ = standing(case, 0)
    with tempfile.TemporaryDirectory() as folder:
        write(make(case, 0), Path(folder))
        arm = gp.load_mechanism(Path(folder) / "robot.urdf")
        model = gp.calibrate(arm, Path(folder) / "table.csv", effects).model
    rng = np.random.default_rng(1)
    q, near = (draw_poses(machine.arm, targets, rng) for _ in range(2))
    near[:, 4] = rng.uniform(-SINGULAR, SINGULAR, targets)
    many = table(draw_poses(machine.arm, MANY, rng))
    started = time.process_time()
    model.compensate(many, max_move=MAX_MOVE)
    seconds = time.process_time() - started
    everywhere, singular = loop(machine, amounts, model, q), loop(machine, amounts, model, near)
    print(case, everywhere["before"], everywhere["after"], singular["after"], f"{seconds:.1f} s", flush=True)
    return {"arm": machine.arm.name, "effects": effects, "everywhere": everywhere, "near singular": singular,
            f"cpu_seconds_for_{MANY}": round(seconds, 1)}  # fmt: skip


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    given = parsed(__doc__, arguments, targets=500, out=Path(__file__).with_name("results.json"))
    cases = {case: study(case, effects, given.targets) for case, effects in CASES.items()}
    results = {"command": f"python -m experiments.closed_loop.run --targets {given.targets}", "cases": cases}
    write_text(given.out, to_json(results))
    return results


if __name__ == "__main__":
    main()

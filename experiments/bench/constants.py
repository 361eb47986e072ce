"""Measure the influence of a constant on a few robots of the bench, at half and double of its value.

From the root: python -m experiments.bench.constants selection/group.py:READABLE evidence/criteria.py:Criteria.tie
Files are below gpmodel/. A value copied into the default of a function's argument, or into a compiled kernel, stays.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from dataclasses import fields
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

import gpmodel
from experiments.bench.judge import judge
from experiments.bench.robots import ROBOTS
from experiments.bench.run import changed, counted
from experiments.methods.rows import Row

FAST = "wrong_masses_ur_61,eccentric_all_kuka_150_31,four_150_30,law_2_1_5,null_columns_30"
"""Robots of 6 to 10 seconds: effects of loads and of many joints, a formula, and nothing."""


def scale(constant: str, factor: float) -> None:
    """Multiply a constant in every module that has imported it. constant: FILE:NAME or FILE:CLASS.FIELD."""
    file, _, name = constant.partition(":")
    module = import_module("gpmodel." + file.removesuffix(".py").replace("/", "."))
    owner, _, field = name.rpartition(".")
    if owner:
        made = getattr(module, owner)
        value = getattr(made, field)
        values = zip(fields(made), made.__init__.__defaults__, strict=True)
        made.__init__.__defaults__ = tuple(type(value)(factor * v) if f.name == field else v for f, v in values)
        return
    value = getattr(module, name)
    for other in [m for n, m in sys.modules.items() if n.startswith("gpmodel.")]:
        if other.__dict__.get(name) is value:
            setattr(other, name, type(value)(factor * value))


def rows_with(constant: str, factor: float, robots: str) -> dict[str, Row]:
    """Rows by robot, from a process of its own."""
    words = [sys.executable, "-m", __spec__.name, constant, "--factor", str(factor), "--only", robots]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    return {row["robot"]: row for row in json.loads(done.stdout.splitlines()[-1])}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("constants", nargs="+")
    parser.add_argument("--only", default=FAST, help="names of robots, with commas")
    parser.add_argument("--factor", type=float, help="print the rows with this factor as JSON")
    asked = parser.parse_args()
    if asked.factor is not None:
        robots = [ROBOTS[name] for name in asked.only.split(",")]
        with tempfile.TemporaryDirectory() as folder:
            for module in walk_packages(gpmodel.__path__, "gpmodel."):
                import_module(module.name)
            scale(asked.constants[0], asked.factor)
            print(json.dumps([judge(robot, Path(folder) / robot.name) for robot in robots]))
        return
    before = rows_with(asked.constants[0], 1.0, asked.only)
    print(f"as it is: {counted(before.values())}", flush=True)
    for constant in asked.constants:
        for factor in (0.5, 2.0):
            now = rows_with(constant, factor, asked.only)
            said = [line for name, row in now.items() if (line := changed(before[name], row))]
            print(f"{constant} x {factor:g}: {counted(now.values())}", *said, sep="\n  ", flush=True)


if __name__ == "__main__":
    main()

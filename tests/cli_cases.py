"""Run the program and make tables for the tests of the commands."""

from pathlib import Path

import numpy as np
import pandas as pd
from click.testing import CliRunner, Result

from gpmodel.cli.main import main
from gpmodel.mechanism.branches import random_poses
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.planning.simulate import Simulation, simulate
from gpmodel.table.cells import frame_of


def run(*arguments: object) -> Result:
    """The program called with these arguments, as from a shell."""
    return CliRunner().invoke(main, [str(a) for a in arguments])


def one_line(result: Result, status: int) -> str:
    """The single line on stderr of a run that ended with `status` and printed nothing else."""
    assert result.exit_code == status, (result.exit_code, result.stderr, result.exception)
    assert result.stdout == ""
    assert "Traceback" not in result.stderr
    lines = result.stderr.splitlines()
    assert len(lines) == 1, lines
    return lines[0]


def robot(poses: int = 40, seed: int = 1, name: str = "irb6400r", **settings: object) -> tuple[Mechanism, Simulation]:
    """A mechanism and poses measured on it, 0.3 mm geometric errors and 0.03 mm noise unless told otherwise."""
    mechanism = MechanismChoice(name).load()
    rng = np.random.default_rng(seed)
    q = random_poses(mechanism, poses, rng)
    options = {"effects": (), "noise": 3e-5, "geometry_sigma": 3e-4} | settings
    return mechanism, simulate(mechanism, q, rng=rng, **options)  # type: ignore[arg-type]


def table(poses: int = 40, seed: int = 1, name: str = "irb6400r", **settings: object) -> pd.DataFrame:
    """Return the table as a frame of text cells."""
    mechanism, made = robot(poses, seed, name, **settings)
    return frame_of(made.dataset, mechanism)


def write(frame: pd.DataFrame, path: Path) -> Path:
    """The frame as a .csv file."""
    frame.to_csv(path, index=False)
    return path


def numbers(frame: pd.DataFrame, column: str) -> np.ndarray:
    return frame[column].astype(float).to_numpy()

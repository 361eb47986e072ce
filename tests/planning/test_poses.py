"""Poses worth measuring."""

from pathlib import Path

import numpy as np
import pytest
from cli_cases import one_line, run

from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.mechanism.registry import load_mechanism
from gpmodel.numerics.se3 import chain
from gpmodel.planning.poses import candidates, geometric_columns, observable_poses, spacing, spread_poses
from gpmodel.table.read import read_table

ARMS = ["irb6400r", "ur5", "panda"]
MAKERS = {"spread": spread_poses, "observability": observable_poses}


def log_determinant(mechanism: Mechanism, q: np.ndarray, reference: np.ndarray) -> float:
    """log det Σ JᵀJ / N per unknown of poses q, with parameters chosen and scaled over poses q and `reference`."""
    columns = geometric_columns(mechanism, np.vstack([q, reference]))[: len(q)]
    information = np.einsum("nij,nik->jk", columns, columns) / len(q)
    return float(np.linalg.slogdet(information)[1] / columns.shape[2])


@pytest.mark.parametrize("criterion", MAKERS)
@pytest.mark.parametrize("arm", ARMS)
def test_poses_are_within_the_limits(arm: str, criterion: str) -> None:
    mechanism = load_mechanism(arm)
    q = MAKERS[criterion](mechanism, 25, np.random.default_rng(0))
    assert q.shape == (25, len(mechanism.joints))
    for joint, values in zip(mechanism.joints, q.T, strict=True):
        assert (values >= joint.lower).all()
        assert (values <= joint.upper).all()


@pytest.mark.parametrize("arm", ARMS)
def test_each_criterion_beats_random_poses_and_the_other_one_at_its_own(arm: str) -> None:
    mechanism = load_mechanism(arm)
    rng = np.random.default_rng(1)
    random = candidates(mechanism, 30, rng)
    spread, observable = spread_poses(mechanism, 30, rng), observable_poses(mechanism, 30, rng)
    reference = candidates(mechanism, 200, rng)
    assert spacing(mechanism, spread) > 1.25 * max(spacing(mechanism, random), spacing(mechanism, observable))
    value = {n: log_determinant(mechanism, q, reference) for n, q in (("r", random), ("s", spread), ("o", observable))}
    assert value["o"] > value["s"]
    assert value["o"] > value["r"] + 0.1


def test_tips_stay_above_the_plane() -> None:
    mechanism = load_mechanism("ur5")
    q = spread_poses(mechanism, 30, np.random.default_rng(0), 0.1)
    assert chain(mechanism.transforms(q))[-1][:, 2, 3].min() >= 0.1
    with pytest.raises(InputError, match="above"):
        spread_poses(mechanism, 30, np.random.default_rng(0), 5.0)


def test_too_few_poses_to_determine_the_errors() -> None:
    with pytest.raises(InputError, match="expected more poses"):
        observable_poses(load_mechanism("irb6400r"), 9, np.random.default_rng(0))


def test_command_writes_a_table_that_is_read_again(tmp_path: Path) -> None:
    assert run("poses", "--mechanism", "ur5", "-n", 12, "--out", tmp_path).exit_code == 0
    data = read_table(tmp_path / "poses.csv", load_mechanism("ur5"), need_measurement=False)
    assert data.q.shape == (12, 6)
    printed = run("poses", "--mechanism", "ur5", "-n", 12).stdout
    assert printed == (tmp_path / "poses.csv").read_text()
    assert "--criterion" in one_line(run("poses", "--mechanism", "ur5", "--criterion", "beauty"), 2)
